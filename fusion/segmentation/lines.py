"""Shallow cells: what thin dark lines enclose.

Light that bounces makes the floor of a shallow cell as bright as the wall. What remains of it is its shadowed rim, a
thin dark line. A blob or the grain of the bone is as dark, but not long: so the image is filtered for dark lines in
every direction, along which the filter is much longer than across (an elongated second derivative, as in oriented
filters for vessels). Each direction counts in multiples of what the wall itself answers in it, since seams between
frames and the drill's traces run around the bore. What lines of a level enclose is a cell where its outline is
strong all along, and its floor no brighter than the wall: drops and the wall between cells are. From the highest
level down, a cell with a gap in its line is found as soon as a level closes it.
"""

from dataclasses import replace

import cv2
import numpy as np

from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.segmentation.outlines import LARGEST_FLOOR_MM2
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.regions import (
    eroded,
    highest_within,
    label,
    looked_up,
    morphology,
    quantiles,
    remove_small,
    within,
)
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.circle import gaussian, pad_circle

STEP_MM = 0.01
COARSEST_MM = 0.03
"""With samples farther apart than this a line cannot be distinguished from a grain."""
ACROSS_MM, ALONG_MM = 0.012, 0.06
N_DIRECTIONS = 12
LEVELS = (6.0, 5.2, 4.5, 4.0, 3.5)
"""In multiples of what the wall answers. Of a thousand samples of the wall one answers 4."""
MOST = 10.0
LEAST_OUTLINE = 7.5
"""What an outline answers in the mean, each sample counted up to ``MOST``."""
OFF_LINE_MM = 0.03
"""An outline is held against the strongest line within this; within this of a dark cell it is that cell's."""
LEAST_DARKNESS = 0.01
"""Of the floor, in the median."""
FLOOR_SIGMA_MM = 0.015


def enclosed_by_lines(behind: Evidence, cells: Mask, parameters: SegmentParameters) -> Mask:
    """Return what thin dark lines of ``behind`` enclose, bool (n_z, n_theta).

    ``cells``: those known by their darkness; their rims speak for nothing else. Empty where samples lie too far apart
    to tell a line.
    """
    wall = behind.valid & (behind.values < 0)
    if max(behind.dz_mm, behind.column_mm) > COARSEST_MM or not wall.any():
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
    """Return what lines enclose on even samples ``STEP_MM`` apart, besides the ``known`` cells."""
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
