"""How the capillary's glass bends the beams.

A beam that passes the axis at the distance b keeps n·b through every face about that axis (Bouguer), so it leaves
the glass with the b it came with, turned by δ = asin(b/Rᵢ) − asin(b/nRᵢ) − asin(b/Rₒ) + asin(b/nRₒ): up to two
degrees for a catheter far off the axis. Radii beyond the glass do not change, only angles. The glass's thickness is
read off the distance between the lines of its two faces, n·t.
"""

from collections.abc import Sequence

import numpy as np

from endoct.modalities.oct.face.capillary import Faces
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.stitching.arrays import Coordinates

GLASS_INDEX = 1.46  # fused silica and borosilicate near 1300 nm
THICKNESS_MM = (0.04, 0.45)
SAME_OFFSET_MM = 0.015
TELLING_OFFSET_MM = 0.05  # nearer to the axis a sheath line's own wobble looks the same, and nothing bends
SAME_DISTANCE_MM = 0.012
LEAST_PRESENCE = 0.5


def glass_mm(slices: Sequence[SliceEvidence], faces: Faces, medium_index: float) -> float:
    """Return the thickness of the capillary's wall, mm; 0 where no inner face is seen with the catheter off axis."""
    index = GLASS_INDEX / medium_index
    distances = []
    seen = np.flatnonzero(~faces.bridged & (np.hypot(faces.x_mm, faces.y_mm) > TELLING_OFFSET_MM))
    for i in map(int, seen):
        lines = slices[i].lines
        moves_along = np.hypot(lines[:, 0] - faces.x_mm[i], lines[:, 1] - faces.y_mm[i]) < SAME_OFFSET_MM
        before = (faces.axis_depth_mm[i] - lines[:, 2]) / index
        within = (before > THICKNESS_MM[0]) & (before < THICKNESS_MM[1])
        distances.append(before[moves_along & within])
    every = np.concatenate(distances) if distances else np.empty(0)
    if not every.size:
        return 0.0
    agreeing = np.zeros(every.size, dtype=np.intp)
    for of_slice in distances:
        agreeing += np.any(np.abs(of_slice[:, None] - every) < SAME_DISTANCE_MM, axis=0)
    best = every[int(np.argmax(agreeing))]
    if agreeing.max() < LEAST_PRESENCE * len(distances):
        return 0.0
    return float(np.median(every[np.abs(every - best) < SAME_DISTANCE_MM]))


def bend_rad(passing_mm: Coordinates, outer_radius_mm: float, thickness_mm: float, medium_index: float) -> Coordinates:
    """Return by how much beams that pass the axis at ``passing_mm`` (signed) are turned back, rad."""
    index, inner_radius_mm = GLASS_INDEX / medium_index, outer_radius_mm - thickness_mm
    inner = np.clip(passing_mm / inner_radius_mm, -0.95, 0.95)
    outer = np.clip(passing_mm / outer_radius_mm, -0.95, 0.95)
    turned = np.arcsin(inner) - np.arcsin(inner / index) - np.arcsin(outer) + np.arcsin(outer / index)
    return np.asarray(turned)
