"""The catheter's own sheath as a landmark that does not turn with the optics.

The sheath is drawn from off its axis: lines and bands of speckle whose depth wavers once a turn, by some pixels. Where
it does so stays put while the catheter is pulled, so that in a turn that starts later it is seen earlier. All that is
bright before the capillary makes one pattern over angle and depth; each slice is turned so that its points are
likeliest in the pattern of all. Lines that cross, fade or run into the speckle behind them need not be told apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.neighbours import LEAST_OFFSET_MM
from endoct.modalities.oct.face.outer_line import SAME_LINE_MM, line_depths_mm
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.turning.sheath_pattern import BIN_MM, N_ANGLES, Likelihood, Pattern, Sight
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.stitching.kept import Kept
from endoct.stitching.robust import robust_sigma

LEAST_PRESENCE = 0.6
FEWEST_LINES = 2  # one alone may be anything
CLEAR_MM = 0.04  # before the capillary's inner face
BLURS = ((0.012, 0.2), (0.008, 0.15), (0.005, 0.1), (0.004, 0.08), (0.003, 0.05))
"""Of the pattern, round by round: standard deviations along depth, mm, and around the turn, rad."""
RIGID_RAD = 0.08


@dataclass(frozen=True, eq=False)
class Mark:
    """Direction (n,) of a landmark in each slice's own frame, NaN where it is not seen, with its standard deviation."""

    direction_rad: Coordinates
    sigma_rad: Coordinates


def sheath_mark(slices: Sequence[SliceFeatures], faces: Faces, glass: Glass, mm_per_px: float) -> Mark | None:
    """Return the direction of the sheath's pattern, or None where fewer than two lines or no clear pattern are seen.

    Its standard deviation is by how much two halves of a slice, in sectors by turns, differ.
    """
    if _n_lines(slices, faces, mm_per_px) < FEWEST_LINES:
        return None
    reach_mm = faces.typical_axis_mm + faces.capillary.radius_mm
    clear_mm = glass.thickness_mm * GLASS_INDEX / glass.medium_index + CLEAR_MM
    depth_mm = np.arange(0, reach_mm - clear_mm, BIN_MM)
    direction = np.zeros((3, len(slices)))
    with Kept[Sight]() as sights:
        for i, features in enumerate(slices):
            sights.append(_seen(features, faces.capillary.circle(i), depth_mm, clear_mm))
        pattern = Pattern.of(depth_mm.size)
        middle = sights[len(sights) // 2]
        pattern.add(middle, middle.halves(depth_mm.size), 0.0)
        for blur in BLURS:
            likelihood = Likelihood.of(pattern.rate(*blur))
            pattern = Pattern.of(depth_mm.size)
            for i, sight in enumerate(sights):
                halves = sight.halves(depth_mm.size)
                direction[:, i] = likelihood.turned(sight, halves)
                pattern.add(sight, halves, direction[0, i])
    apart = wrap_rad(direction[1] - direction[2]) / 2
    usual = robust_sigma(apart)
    return Mark(wrap_rad(direction[0]), np.hypot(usual, apart) / np.sqrt(2)) if usual < RIGID_RAD else None


def _n_lines(slices: Sequence[SliceFeatures], faces: Faces, mm_per_px: float) -> int:
    """How many lines are seen off the axis before the outer face that do not move along with it, as the inner does."""
    lines = [features.lines for features in slices]
    depths = line_depths_mm(Lines.together(lines), mm_per_px)
    count = 0
    for depth in depths[depths < faces.typical_axis_mm - SAME_LINE_MM]:
        found = [of_slice.strongest_near(float(depth), SAME_LINE_MM) for of_slice in lines]
        offset = np.array([complex(np.nan, np.nan) if one is None else complex(one.x_mm, one.y_mm) for one in found])
        seen = np.isfinite(offset)
        if np.mean(seen) < LEAST_PRESENCE or np.median(np.abs(offset[seen])) <= LEAST_OFFSET_MM:
            continue
        along = offset[seen] - (faces.capillary.x_mm + 1j * faces.capillary.y_mm)[seen]
        count += bool(np.median(np.abs(along)) > SAME_LINE_MM)
    return count


def _seen(features: SliceFeatures, face: Circle, depth_mm: Coordinates, clear_mm: float) -> Sight:
    """What is seen before the capillary's inner face."""
    points = features.points.where(features.points.beyond_mm(face) < -clear_mm)
    angle = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
    return Sight(
        column=np.mod(points.angle_rad, 2 * np.pi) * (N_ANGLES / (2 * np.pi)),
        row=points.depth_mm / BIN_MM,
        strength=points.strength,
        n_covered=np.searchsorted(depth_mm, face.depth_mm(angle) - clear_mm),
    )
