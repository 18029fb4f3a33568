"""The capillary's glass: how it bends the beams and lengthens their path.

A beam that passes the axis at the distance b keeps n·b through every face about that axis (Bouguer). So it leaves
the glass with the b it came with, turned by δ = asin(b/Rᵢ) − asin(b/nRᵢ) − asin(b/Rₒ) + asin(b/nRₒ).
For a catheter far off the axis that is up to two degrees. Radii beyond the glass do not change, only angles. The
glass's thickness is read off the distance between the lines of its two faces, n·t.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures

GLASS_INDEX = 1.46  # fused silica and borosilicate near 1300 nm
THICKNESS_MM = (0.04, 0.45)
STEP_MM = 0.0025
WIDTH_MM = 0.008
"""Half width of the inner face's line."""
LEAST_OFFSET_MM = 0.05
"""Nearer to the axis than this, the wobble of a sheath's line looks the same, and nothing bends."""
LEAST_SHARE = 0.07
"""At least this part of the columns must show the inner face."""
LEAST_PRESENCE = 0.5
"""At least this part of the slices must show it."""


@dataclass(frozen=True)
class Glass:
    """The capillary's wall: ``outer_radius_mm``, ``thickness_mm`` (0 where not known), index of the medium around."""

    outer_radius_mm: float
    thickness_mm: float = 0.0
    medium_index: float = 1.0

    @property
    def path_mm(self) -> float:
        """How far the inner face's line lies before the outer one's, as lengths in the medium; 0 where not known."""
        return GLASS_INDEX / self.medium_index * self.thickness_mm

    def bend_rad(self, passing_mm: Coordinates) -> Coordinates:
        """Return by how much beams that pass the axis at ``passing_mm`` (signed) are turned back, rad.

        0 where the thickness is not known.
        """
        if not self.thickness_mm:
            return np.zeros_like(passing_mm)
        index, inner_radius_mm = GLASS_INDEX / self.medium_index, self.outer_radius_mm - self.thickness_mm
        inner = np.clip(passing_mm / inner_radius_mm, -0.95, 0.95)
        outer = np.clip(passing_mm / self.outer_radius_mm, -0.95, 0.95)
        turned = np.arcsin(inner) - np.arcsin(inner / index) - np.arcsin(outer) + np.arcsin(outer / index)
        return np.asarray(turned)


@compiled
def face_distance(
    cosine: float, sine: float, x_mm: float, y_mm: float, outer_radius_mm: float, thickness_mm: float
) -> float:
    """Return the optical path to the outer face, less the glass's delay where a beam meets it squarely, mm.

    The beam's direction has that ``cosine`` and ``sine``; the catheter is off the axis by (x, y). An oblique beam is
    refracted, which changes its path by micrometres.
    """
    across = x_mm * sine - y_mm * cosine
    inner_mm = outer_radius_mm - thickness_mm
    within = (across / GLASS_INDEX) ** 2
    to_inner = math.sqrt(max(inner_mm**2 - across**2, 1e-6)) - (x_mm * cosine + y_mm * sine)
    through = math.sqrt(outer_radius_mm**2 - within) - math.sqrt(max(inner_mm**2 - within, 1e-6))
    return to_inner + GLASS_INDEX * through - (GLASS_INDEX - 1) * thickness_mm


def measure_glass(slices: Sequence[SliceFeatures], faces: Faces, medium_index: float) -> Glass:
    """Return the capillary's glass; its thickness is unknown where no off-axis catheter sees its inner face."""
    capillary = faces.capillary
    return Glass(capillary.radius_mm, _thickness_mm(slices, faces, GLASS_INDEX / medium_index), medium_index)


def _thickness_mm(slices: Sequence[SliceFeatures], faces: Faces, index: float) -> float:
    """The thickness at which most points lie where the inner face would be; 0 where too few slices show it there.

    What does not move along with the outer face, as the sheath, is met at one thickness in a few directions only.
    """
    capillary = faces.capillary
    tried_mm = np.arange(*THICKNESS_MM, STEP_MM)
    off_axis = np.flatnonzero(~faces.bridged & (capillary.offset_mm > LEAST_OFFSET_MM))
    shares = [_share_with_points(slices[i], capillary.circle(i), tried_mm, index) for i in map(int, off_axis)]
    if not shares:
        return 0.0
    share = np.array(shares)
    best = int(np.argmax(share.sum(axis=0)))
    near = slice(max(best - 1, 0), best + 2)
    if np.mean(share[:, near].max(axis=1) > LEAST_SHARE) < LEAST_PRESENCE:
        return 0.0
    return float(np.average(tried_mm[near], weights=share[:, near].sum(axis=0)))


def _share_with_points(features: SliceFeatures, face: Circle, tried_mm: Coordinates, index: float) -> Coordinates:
    """The share of columns with a point where the inner face would be, for each thickness of the glass."""
    points = features.points
    across = face.x_mm * np.sin(points.angle_rad) - face.y_mm * np.cos(points.angle_rad)
    before_mm = -points.beyond_mm(face)
    of_points = before_mm > 0
    before_mm, within = before_mm[of_points], (across[of_points] / GLASS_INDEX) ** 2
    on_face = _on_inner_face(before_mm, within, points.strength[of_points], tried_mm, face.radius_mm, index)
    return on_face / features.n_columns


@compiled
def _on_inner_face(
    before_mm: Coordinates,
    within_mm2: Coordinates,
    strength: Coordinates,
    tried_mm: Coordinates,
    radius_mm: float,
    index: float,
) -> Coordinates:
    """The strength of all points on the inner face, float64 (n_tried,), by Tukey's weights, for each thickness.

    Points lie ``before_mm`` the outer face; ``within_mm2`` is the square of how far off the axis their beams pass in
    the glass.
    """
    total = np.zeros(tried_mm.size)
    for i in range(before_mm.size):
        to_outer = math.sqrt(radius_mm**2 - within_mm2[i])
        for k in range(tried_mm.size):
            to_inner = math.sqrt(max((radius_mm - tried_mm[k]) ** 2 - within_mm2[i], 1e-6))
            away = (before_mm[i] - index * (to_outer - to_inner)) / WIDTH_MM
            total[k] += max(1 - away**2, 0.0) ** 2 * strength[i]
    return total
