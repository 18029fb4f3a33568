"""Where the surface of a tube's wall lies, by the mean power of all beams about it.

Unrolling finds the wall of a beam as a whole sample, sooner where it is bright, later where it is faint. The mean of
many beams, each from where a model has the wall on, rises within the axial resolution, and half of that rise marks the
surface, however bright it is. What is found of bore, rings and grooves differs from there by a constant each.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.oct.tube_fit import TubeModel
from endoct.modalities.oct.tube_marks import Marks, every_depth

N_KINDS = 4
"""Bore and groove, and both within a ring."""
BEFORE_MM = 0.0015
"""By how much half of the rise lies before the surface, as what returns falls off behind it: 0.0011 in the preset
`tube`, seeds 30–43, 0.0017 in independent recordings, seeds 10–23."""
LEAST_BEAMS = 200
BINS_PER_PX = 4
DARK_MM = -0.1, -0.03
"""Before the surface, where only noise is; and behind it, how far the brightest lies at most:"""
BRIGHT_MM = 0.04
MOST_POWER = 10.0
"""Times the median behind the surface: a glint counts for no more."""
NEAR_MM = 0.05
"""Beams whose wall is found farther off the model than that see something else."""


def kinds(marks: Marks) -> NDArray[np.intp]:
    """Return of which of ``N_KINDS`` surfaces points are, (n,)."""
    return 2 * marks.in_ring.astype(np.intp) + marks.in_groove


def at_surface(marks: Marks, late_mm: Coordinates) -> Marks:
    """Return marks whose depths are those of surfaces that are found ``late_mm`` (``N_KINDS``,) too deep.

    Depths of a kind of which that is not known are NaN.
    """
    return replace(marks, gap_mm=marks.gap_mm - late_mm[kinds(marks)])


def late_mm(model: TubeModel, values: Coordinates) -> Coordinates:
    """Return by how much the wall is found too deep, by kind, float64 (``N_KINDS``,), in stated mm.

    NaN where few beams show a kind, or it does not stand out.
    """
    beams = model.beams
    marks, number = every_depth(beams, model.pose, model.target)
    every = TubeModel(beams, marks, model.target, model.pose)
    off_px = every.distances_mm(values) / beams.depth_mm
    near = np.abs(off_px) * beams.depth_mm < NEAR_MM
    kind = kinds(marks)
    late = np.full(N_KINDS, np.nan)
    for k in range(N_KINDS):
        which = np.flatnonzero(near & (kind == k))
        if which.size >= LEAST_BEAMS:
            power = beams.around[marks.slice_index[which], number[which]]
            surface_px = half_rise_px(power, off_px[which], beams.depth_mm)
            late[k] = (float(np.median(off_px[which])) - surface_px) * beams.depth_mm - BEFORE_MM
    return late


def half_rise_px(power: Image, off_px: Coordinates, depth_mm: float) -> float:
    """Return where the mean of A-scans rises to half of its brightest, samples from where the wall is expected.

    ``power`` (n, n_samples), NaN where nothing was recorded; the sample in the middle lies ``off_px`` (n,) behind the
    expected place, samples ``depth_mm`` apart. NaN where nothing rises.
    """
    n_samples = power.shape[1]
    place = off_px[:, None] + np.arange(n_samples) - n_samples // 2
    behind = (place > 0) & (place * depth_mm < BRIGHT_MM)
    known = np.isfinite(power)
    clipped = np.minimum(power[known], MOST_POWER * np.nanmedian(power[behind]))
    first = -(n_samples // 2)
    number = np.rint((place[known] - first) * BINS_PER_PX).astype(np.intp)
    n_bins = BINS_PER_PX * (n_samples - 1) + 1
    inside = (number >= 0) & (number < n_bins)
    total = np.bincount(number[inside], weights=clipped[inside], minlength=n_bins)
    count = np.bincount(number[inside], minlength=n_bins)
    wide = np.ones(BINS_PER_PX)
    with np.errstate(invalid="ignore"):
        mean = np.convolve(total, wide, "same") / np.convolve(count, wide, "same")
    # an even number of bins taken together lies half a bin before the one it is written to
    at_px = first + (np.arange(n_bins) - 0.5) / BINS_PER_PX
    dark = float(np.nanmedian(mean[(at_px * depth_mm > DARK_MM[0]) & (at_px * depth_mm < DARK_MM[1])]))
    bright = np.flatnonzero(np.abs(at_px * depth_mm) < BRIGHT_MM)
    top = int(bright[np.nanargmax(mean[bright])])
    half = (dark + mean[top]) / 2
    below = np.flatnonzero(mean[:top] < half)
    if not below.size or not np.isfinite(half) or mean[top] < 2 * dark:
        return float("nan")
    low = int(below[-1])
    return float(at_px[low] + (half - mean[low]) / (mean[low + 1] - mean[low]) / BINS_PER_PX)
