"""Cells of an image without depth: regions with the clearest outlines, and what thin dark lines enclose.

One threshold for all cells is too low for a deep cell, which then takes in the blur around it. It is too high for a
shallow cell, whose floor is nearly as bright as the wall. Stains of the bone are as dark as that floor, but fade
slowly. So the regions above many levels are held against the slope of the image. A region counts what its outline
has of slopes steeper than those of the wall. From the highest level down, a region is taken where it counts more
than what was taken within it. This is as in maximally stable regions (Matas 2004), but by the outline's contrast.

Only outlines that lie close to each other compete, since one of them is blur. A dark core deep within a cell with a
clear outline does not stand against that cell. What is darker than the cap counts as no darker: noise in the dark,
which the logarithm magnifies, has no outline. What is enclosed by a region belongs to it, however bright. Last,
where a region fades, it is cut at half its darkness.

Light that bounces makes the floor of a shallow cell as bright as the wall. What remains of it is its shadowed rim,
a thin dark line. A blob or the grain of the bone is as dark, but not long. So the image is filtered for dark lines
in every direction. The filter is much longer along a line than across it (an elongated second derivative, as in
oriented filters for vessels). Each direction counts in multiples of what the wall itself answers in it, since seams
between frames and the drill's traces run around the bore.

What the lines of a level enclose is a cell where its outline is strong all along, and its floor no brighter than
the wall. Drops, and the wall between cells, are brighter. From the highest level down, a cell with a gap in its
line is found as soon as a level closes it.
"""

from dataclasses import replace

import cv2
import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import gaussian, masked_gaussian, pad_circle
from endoct.base.numeric.regions import (
    eroded,
    highest_within,
    label,
    looked_up,
    morphology,
    quantiles,
    remove_small,
    within,
)
from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.parameters import SegmentParameters

COARSEST_MM = 0.06
"""Where samples lie farther apart than this, an outline looks like a fading."""
N_LEVELS = 9
LOWEST_LEVEL = 0.5
"""The lowest level as a share of Li's threshold; the highest is a step below the cap."""
SLOPE_SIGMA_MM = 0.02
LEAST_SLOPE = 2.75
MOST_SLOPE = 8.0
"""Slopes count from the least to the most, as multiples of the wall's median slope."""
LONGEST_FADE_MM = 0.1
"""A region that takes longer than this to fade to the wall has no outline, however even the wall."""
MOST_AGAINST = np.float32(0.4)
"""A stretch that is less steep counts against its outline by no more than this. Where the view is slanted, one rim of
every cell is blurred, and the other alone must do."""
LEAST_COUNT_MM = 0.6
"""Least count of an outline, its length times its slope above ``LEAST_SLOPE``; specks of an uneven wall have less."""
LARGEST_FLOOR_MM2 = 3.0
HALF = 0.5
BLUR_MM = 0.06
"""Outlines that lie within this of each other may be one, blurred. What is less than half as dark is cut as far from an
outline."""
STEP_MM = 0.01
COARSEST_LINES_MM = 0.03
"""Where samples lie farther apart than this, a line looks like grain."""
ACROSS_MM, ALONG_MM = 0.012, 0.06
N_DIRECTIONS = 12
LEVELS = (6.0, 5.2, 4.5, 4.0, 3.5)
"""Levels of a line, in multiples of what the wall answers. One in a thousand samples of the wall answers 4."""
MOST = 10.0
LEAST_OUTLINE = 7.5
"""An outline answers this in the mean at least, each sample counted up to ``MOST``."""
OFF_LINE_MM = 0.03
"""An outline is held against the strongest line within this. Within this of a dark cell it belongs to that cell."""
LEAST_DARKNESS = 0.01
"""Least darkness of a floor, in the median."""
FLOOR_SIGMA_MM = 0.015


def clearest_regions(behind: Evidence, prepared: Image, threshold: float, parameters: SegmentParameters) -> Mask | None:
    """Return the regions of ``behind`` with the clearest outlines, bool (n_z, n_theta), or None.

    ``prepared`` are its values smoothed, floored at 0 and capped, float32; ``threshold`` is Li's. None where samples
    lie too far apart to judge an outline, or no region has a clear one.
    """
    if max(behind.dz_mm, behind.column_mm) > COARSEST_MM:
        return None
    slope, arc_mm = _slope(behind, parameters.contrast_cap)
    # only wall lies in front of the wall; the shoulders of cells lie just behind it
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
    """Return ``mask`` without samples near its outline that are less than half as dark as the darkest near them."""
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


def enclosed_by_lines(behind: Evidence, cells: Mask, parameters: SegmentParameters) -> Mask:
    """Return what thin dark lines of ``behind`` enclose, bool (n_z, n_theta).

    ``cells`` are those known by their darkness; their rims speak for nothing else. The mask is empty where samples lie
    too far apart to tell a line.
    """
    wall = behind.valid & (behind.values < 0)
    if max(behind.dz_mm, behind.column_mm) > COARSEST_LINES_MM or not wall.any():
        return np.zeros(cells.shape, np.bool_)
    n_theta = round(2 * np.pi * behind.radius_mm / STEP_MM)
    z_mm = np.linspace(behind.z_mm[0], behind.z_mm[-1], 1 + round(float(np.ptp(behind.z_mm)) / STEP_MM))
    fine = on_grid(behind, z_mm, n_theta)
    known = on_grid(replace(behind, values=cells.astype(np.float32)), z_mm, n_theta).values > 0.5
    enclosed = _enclosed(fine, known, parameters)
    rows = np.rint((behind.z_mm - z_mm[0]) / fine.dz_mm).astype(np.intp)
    columns = np.rint((behind.theta0_rad / (2 * np.pi) + np.arange(cells.shape[1]) / cells.shape[1]) * n_theta)
    return np.asarray(enclosed[rows[:, None], columns.astype(np.intp) % n_theta] & behind.valid)


def _enclosed(fine: Evidence, known: Mask, parameters: SegmentParameters) -> Mask:
    """Return what lines enclose apart from the ``known`` cells, on even samples at a distance of ``STEP_MM``."""
    strength = _line_strength(fine, parameters.contrast_cap)
    nearby_px = OFF_LINE_MM / STEP_MM
    outline_strength = highest_within(np.minimum(strength, np.float32(MOST)), nearby_px, nearby_px)
    apart = ~within(known, nearby_px, nearby_px)
    floor = gaussian(fine.values, FLOOR_SIGMA_MM / STEP_MM, FLOOR_SIGMA_MM / STEP_MM)
    open_px = parameters.open_mm / STEP_MM
    taken = np.zeros(known.shape, np.bool_)
    for level in LEVELS:
        line = fine.valid & (strength > level)
        filled = ~remove_small(~line, LARGEST_FLOOR_MM2 / STEP_MM**2)
        opened = morphology(filled, "open", open_px, open_px)
        labels, n = label(remove_small(opened, parameters.smallest_mm2 / STEP_MM**2))
        outline = (labels > 0) & ~eroded(labels > 0) & apart
        length = np.bincount(labels[outline], minlength=n + 1)
        mean = np.bincount(labels[outline], outline_strength[outline], n + 1) / np.maximum(length, 1)
        new = (labels > 0) & ~line & ~taken & ~known
        darkness = quantiles(floor[new], labels[new], n, 0.5)
        clear = (mean >= LEAST_OUTLINE) & (darkness > LEAST_DARKNESS)
        clear[0] = False
        taken |= looked_up(clear, labels)
    return taken


def _line_strength(fine: Evidence, cap: float) -> Image:
    """Return how much a dark line through each sample stands out, in multiples of what the wall answers, float32."""
    values = np.clip(fine.values, np.float32(-cap), np.float32(cap))
    wall = fine.valid & (values < 0)
    strongest = np.zeros(values.shape, np.float32)
    reach = int(np.ceil(3 * ALONG_MM / STEP_MM))
    padded = np.pad(pad_circle(values, reach), ((reach, reach), (0, 0)), mode="symmetric")
    for angle_rad in np.pi / N_DIRECTIONS * np.arange(N_DIRECTIONS):
        answer = cv2.filter2D(padded, -1, _line(float(angle_rad), reach))[reach:-reach, reach:-reach]
        typical = np.abs(answer[wall]).mean()
        if typical > 0:
            strongest = np.maximum(strongest, answer / typical)
    return strongest


def _line(angle_rad: float, reach_px: int) -> Image:
    """Return the filter for a dark line in this direction: its mean answer to an even wall is 0."""
    y, x = STEP_MM * np.mgrid[-reach_px : reach_px + 1, -reach_px : reach_px + 1]
    along, across = x * np.cos(angle_rad) + y * np.sin(angle_rad), y * np.cos(angle_rad) - x * np.sin(angle_rad)
    of_width = (across / ACROSS_MM) ** 2
    kernel = np.exp(-0.5 * (along / ALONG_MM) ** 2) * (1 - of_width) * np.exp(-0.5 * of_width)
    line = kernel > 0
    balanced = np.where(line, kernel / kernel[line].sum(), -kernel / kernel[~line].sum())
    return np.asarray(balanced, dtype=np.float32)
