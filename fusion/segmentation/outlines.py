"""Cells of an image without depth: each as large as its outline is clearest.

One threshold for all cells is too low for a deep one, which then takes in the blur around it, and too high for a
shallow one, whose floor is nearly as bright as the wall. Stains of the bone are as dark as that floor, but fade
slowly. So the regions above many levels are held against the slope of the image: a region counts what its outline
has of slopes steeper than those of the wall, and of regions that lie in each other the one is taken that counts more
than all within it together (as in maximally stable regions, Matas 2004, but by the outline's contrast). What is
enclosed by a region belongs to it, however bright. Last, where a region fades, it is cut at half its darkness.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.regions import Labels, clean, label
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.circle import masked_gaussian, pad_circle

COARSEST_MM = 0.06
"""With samples farther apart than this an outline cannot be distinguished from a fading."""
N_LEVELS = 9
LEVELS = (0.5, 1.2)
"""The lowest as part of Li's threshold, the highest as it is."""
SLOPE_SIGMA_MM = 0.02
LEAST_SLOPE = 3.5
MOST_SLOPE = 8.0
"""Slopes count from the one to the other times the wall's median slope."""
LARGEST_FLOOR_MM2 = 3.0
HALF = 0.5
HALF_REACH_MM = 0.06
HALF_CAP = 0.8


@dataclass(frozen=True, eq=False)
class _Level:
    """Labels of the regions above one level (0 outside), and by label what their outlines count."""

    labels: Labels
    score: Coordinates


def clearest_regions(behind: Evidence, prepared: Image, threshold: float, parameters: SegmentParameters) -> Mask | None:
    """Return the regions of ``behind`` with the clearest outlines, bool (n_z, n_theta), or None.

    ``prepared``: its values smoothed, floored and capped, float32; ``threshold``: Li's of these. None where samples lie
    too far apart to judge an outline, or no region has a clear one.
    """
    if max(behind.dz_mm, behind.column_mm) > COARSEST_MM:
        return None
    slope = _slope(behind)
    wall = behind.valid & (prepared <= threshold)
    typical = float(np.median(slope[wall])) if wall.any() else 0.0
    if not typical > 0:
        return None
    count = np.minimum(slope / np.float32(typical), np.float32(MOST_SLOPE)) - np.float32(LEAST_SLOPE)
    count[~_eroded(behind.valid)] = 0
    levels = np.geomspace(LEVELS[0] * threshold, max(LEVELS[1], 2 * threshold), N_LEVELS)
    tree = [_level(behind, prepared > level, count, parameters) for level in levels]
    mask = _clearest(tree)
    if not mask.any():
        return None
    return _cleaned(_cut_at_half(behind, prepared, mask), behind, parameters) & behind.valid


def _level(behind: Evidence, above: Mask, count: Image, parameters: SegmentParameters) -> _Level:
    mask = _cleaned(above & behind.valid, behind, parameters)
    labels, n = label(mask)
    outline = mask & ~_eroded(mask)
    score = np.bincount(labels[outline], count[outline], n + 1).astype(np.float64)
    score[0] = 0
    return _Level(labels, score)


def _clearest(tree: list[_Level]) -> Mask:
    """Return the regions that count more than all regions of higher levels within them, from the highest level on."""
    chosen: list[Mask] = []
    best = np.zeros(0)
    for k in range(len(tree) - 1, -1, -1):
        level = tree[k]
        within = np.zeros(level.score.size)
        if best.size:
            higher = tree[k + 1].labels
            inside = higher > 0
            parent = np.zeros(best.size, np.intp)
            parent[higher[inside]] = level.labels[inside]
            within = np.bincount(parent, best, level.score.size).astype(np.float64)
        own = (level.score > 0) & (level.score >= within)
        own[0] = False
        best = np.where(own, level.score, within)
        best[0] = 0
        chosen.append(own[level.labels])
    return np.asarray(np.any(chosen, axis=0))


def _cut_at_half(behind: Evidence, prepared: Image, mask: Mask) -> Mask:
    """Return ``mask`` without what, near its outline, is less than half as dark as the darkest near it."""
    reach = HALF_REACH_MM / behind.dz_mm, HALF_REACH_MM / behind.column_mm
    darkest = np.minimum(_highest(prepared, *reach), np.float32(HALF_CAP))
    near = _near_outside(mask, *reach)
    return np.asarray(mask & ~(near & (prepared < HALF * darkest)))


def _near_outside(mask: Mask, rows_px: float, columns_px: float) -> Mask:
    """Return what of the wall lies within an ellipse of these radii of a sample outside ``mask``."""
    return np.asarray(_highest((~mask).astype(np.float32), rows_px, columns_px) > 0)


def _highest(image: Image, rows_px: float, columns_px: float) -> Image:
    """Return the highest value within an ellipse of these radii, θ a circle."""
    up, across = max(1, round(rows_px)), max(1, round(columns_px))
    y, x = np.mgrid[-up : up + 1, -across : across + 1]
    ellipse = ((y / up) ** 2 + (x / across) ** 2 <= 1).astype(np.uint8)
    padded = pad_circle(image, across)
    return np.asarray(cv2.dilate(padded, ellipse)[:, across:-across], dtype=np.float32)


def _cleaned(mask: Mask, behind: Evidence, parameters: SegmentParameters) -> Mask:
    """Return ``mask`` cleaned, and with what its regions enclose."""
    return clean(mask, behind.dz_mm, behind.column_mm, parameters, largest_hole_mm2=LARGEST_FLOOR_MM2)


def _eroded(mask: Mask) -> Mask:
    """Return the samples of ``mask`` with all eight neighbours in it; beyond the ends of z it goes on."""
    padded = np.pad(pad_circle(mask.astype(np.uint8), 1), ((1, 1), (0, 0)), mode="edge")
    return np.asarray(cv2.erode(padded, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0)


def _slope(behind: Evidence) -> Image:
    """Return the steepness of ``behind``, 1/mm."""
    smooth = masked_gaussian(
        behind.values, behind.valid, SLOPE_SIGMA_MM / behind.dz_mm, SLOPE_SIGMA_MM / behind.column_mm
    )
    along = np.gradient(smooth, behind.dz_mm, axis=0) if smooth.shape[0] > 1 else np.zeros_like(smooth)
    around = (np.roll(smooth, -1, axis=1) - np.roll(smooth, 1, axis=1)) / (2 * behind.column_mm)
    return np.asarray(np.hypot(along, around), dtype=np.float32)
