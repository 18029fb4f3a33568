"""Cells of an image without depth: each as large as its outline is clearest.

One threshold for all cells is too low for a deep one, which then takes in the blur around it, and too high for a
shallow one, whose floor is nearly as bright as the wall. Stains of the bone are as dark as that floor, but fade
slowly. So the regions above many levels are held against the slope of the image: a region counts what its outline has
of slopes steeper than those of the wall. From the highest level down, a region is taken where it counts more than
what was taken within it (as in maximally stable regions, Matas 2004, but by the outline's contrast). Only outlines
that lie close to each other compete, since one of them is blur: a dark core deep within a cell with a clear outline
does not stand against that cell. What is darker than the cap counts as no darker: noise in the dark, which the
logarithm magnifies, has no outline. What is enclosed by a region belongs to it, however bright. Last, where a region
fades, it is cut at half its darkness.
"""

import numpy as np

from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.regions import clean, eroded, highest_within, label, looked_up, within
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.circle import masked_gaussian

COARSEST_MM = 0.06
"""With samples farther apart than this an outline cannot be distinguished from a fading."""
N_LEVELS = 9
LOWEST_LEVEL = 0.5
"""As part of Li's threshold; the highest is a step below the cap."""
SLOPE_SIGMA_MM = 0.02
LEAST_SLOPE = 2.75
MOST_SLOPE = 8.0
"""Slopes count from the one to the other times the wall's median slope."""
LONGEST_FADE_MM = 0.1
"""What takes longer than this to fade to the wall has no outline, however even the wall."""
MOST_AGAINST = np.float32(0.4)
"""By no more than this does a stretch that is less steep count against its outline: where the view is slanted, one rim
of every cell is blurred, and the other alone must do."""
LEAST_COUNT_MM = 0.6
"""Length of outline times what its slope has above ``LEAST_SLOPE``; specks of an uneven wall have less."""
LARGEST_FLOOR_MM2 = 3.0
HALF = 0.5
BLUR_MM = 0.06
"""Outlines within this of each other may be one, blurred; so far from an outline what is less than half is cut."""


def clearest_regions(behind: Evidence, prepared: Image, threshold: float, parameters: SegmentParameters) -> Mask | None:
    """Return the regions of ``behind`` with the clearest outlines, bool (n_z, n_theta), or None.

    ``prepared``: its values smoothed, floored at 0 and capped, float32; ``threshold``: Li's. None where samples lie too
    far apart to judge an outline, or no region has a clear one.
    """
    if max(behind.dz_mm, behind.column_mm) > COARSEST_MM:
        return None
    slope, arc_mm = _slope(behind, parameters.contrast_cap)
    # in front of the wall is nothing but wall; just behind it lie the shoulders of cells
    wall = behind.valid & (prepared <= 0)
    typical = float(np.median(slope[wall])) if wall.any() else 0.0
    if not typical > 0:
        return None
    steepness = np.minimum(slope / np.float32(typical), np.float32(MOST_SLOPE))
    observed = eroded(behind.valid)
    taken, counted = np.zeros(prepared.shape, np.bool_), np.zeros(prepared.shape, np.float32)
    for level in np.geomspace(parameters.contrast_cap, LOWEST_LEVEL * threshold, N_LEVELS + 1)[1:]:
        region = _cleaned(behind.valid & (prepared > level), behind, parameters)
        labels, n = label(region)
        outline = region & ~eroded(region)
        at = np.flatnonzero(outline)
        least = max(LEAST_SLOPE, level / (LONGEST_FADE_MM * typical))
        clearness = np.maximum(steepness.flat[at] - np.float32(least), -MOST_AGAINST)
        count = np.where(observed.flat[at], clearness * arc_mm.flat[at], np.float32(0))
        own = np.bincount(labels.flat[at], count, n + 1)
        rival = np.flatnonzero((counted != 0) & _within(outline, behind))
        rivals = np.bincount(labels.flat[rival], counted.flat[rival], n + 1)
        clear = own >= np.maximum(rivals, LEAST_COUNT_MM)
        clear[0] = False
        clearer = looked_up(clear, labels)
        taken |= clearer
        counted[clearer] = 0
        counted.flat[at[clear[labels.flat[at]]]] = count[clear[labels.flat[at]]]
    if not taken.any():
        return None
    return _cleaned(_cut_at_half(behind, prepared, taken), behind, parameters) & behind.valid


def _cut_at_half(behind: Evidence, prepared: Image, mask: Mask) -> Mask:
    """Return ``mask`` without what, near its outline, is less than half as dark as the darkest near it."""
    darkest = _highest(prepared, behind)
    return np.asarray(mask & ~(_within(~mask, behind) & (prepared < HALF * darkest)))


def _within(mask: Mask, behind: Evidence) -> Mask:
    """Return what lies within ``BLUR_MM`` of ``mask``."""
    return within(mask, BLUR_MM / behind.dz_mm, BLUR_MM / behind.column_mm)


def _highest(image: Image, behind: Evidence) -> Image:
    """Return the highest value within ``BLUR_MM``."""
    return highest_within(image, BLUR_MM / behind.dz_mm, BLUR_MM / behind.column_mm)


def _cleaned(mask: Mask, behind: Evidence, parameters: SegmentParameters) -> Mask:
    """Return ``mask`` cleaned, and with what its regions enclose."""
    return clean(mask, behind.dz_mm, behind.column_mm, parameters, largest_hole_mm2=LARGEST_FLOOR_MM2)


def _slope(behind: Evidence, cap: float) -> tuple[Image, Image]:
    """Return (steepness of ``behind``, capped, 1/mm; length of a level line per sample that it crosses, mm)."""
    capped = np.minimum(behind.values, np.float32(cap))
    smooth = masked_gaussian(capped, behind.valid, SLOPE_SIGMA_MM / behind.dz_mm, SLOPE_SIGMA_MM / behind.column_mm)
    along = np.gradient(smooth, behind.dz_mm, axis=0) if smooth.shape[0] > 1 else np.zeros_like(smooth)
    around = (np.roll(smooth, -1, axis=1) - np.roll(smooth, 1, axis=1)) / (2 * behind.column_mm)
    slope = np.hypot(along, around)
    # a line along θ crosses a sample each column, one along z a sample each row
    crossed = np.maximum(np.abs(along) / behind.column_mm, np.abs(around) / behind.dz_mm)
    arc = np.divide(slope, crossed, out=np.zeros_like(slope), where=crossed > 0)
    return np.asarray(slope, dtype=np.float32), np.asarray(arc, dtype=np.float32)
