"""Minimum cross-entropy threshold after Li and Tam (1998), from a histogram."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled
from endoct.base.compute.parallel import at_once
from endoct.base.errors import EndoctError

N_BINS = 65_536
TOGETHER = 128
"""Number of bins worked out at once, by vector instructions, while the last ones are counted."""
LEAST_RANGE = 1e-300
MOST_ROUNDS = 1000


def li_threshold(values: NDArray[np.generic]) -> float:
    """Return the threshold of ``values`` (any shape, any real dtype, valid samples only) that Li's iteration finds.

    Foreground is what lies above it. The histogram has 65 536 bins between the extremes, or one for each integer where
    these span less. Each bin also knows the mean of its samples. The iteration is that of
    ``skimage.filters.threshold_li``, started from the mean, and agrees with it to within a bin.

    Raises :class:`EndoctError` where there are no finite samples or all are equal.
    """
    flat = np.asarray(values).ravel()
    whole = flat.dtype.kind in "iub"
    if flat.dtype.kind == "b" or flat.dtype == np.float16:
        flat = flat.astype(np.uint8 if whole else np.float32)
    least, most = _extremes(flat)
    if not np.isfinite(most - least):
        flat = flat[np.isfinite(flat)]
        least, most = _extremes(flat)
    if not flat.size:
        raise EndoctError("nothing to threshold", found="no valid sample")
    if least == most:
        raise EndoctError(
            "nothing to threshold", found=f"every valid sample is {least:g}", expected="wall and cells that differ"
        )
    if most - least < LEAST_RANGE:  # bins that no number counts in a unit
        return li_threshold(flat * 2.0**600) / 2.0**600
    bins_per_unit = min(N_BINS / (most - least), 1.0 if whole else np.inf)
    halves = at_once(*(partial(_binned, half, least, bins_per_unit) for half in np.array_split(flat, 2)))
    centre, below_count, below_total = _running(*halves)
    threshold, before = below_total[-1] / below_count[-1], -np.inf
    tolerance = 0.5 if whole else (most - least) / N_BINS * 1e-3
    for _ in range(MOST_ROUNDS):
        if abs(threshold - before) <= tolerance:
            break
        before = threshold
        k = int(np.searchsorted(centre, threshold, side="right")) - 1
        mean_below = below_total[k] / below_count[k]
        mean_above = (below_total[-1] - below_total[k]) / (below_count[-1] - below_count[k])
        if mean_below <= 0:  # everything below is the least value itself, whose logarithm is infinite
            break
        threshold = (mean_above - mean_below) / (np.log(mean_above) - np.log(mean_below))
    return float(threshold + least)


def _extremes(flat: NDArray[Any]) -> tuple[float, float]:
    """Return the least and the most of ``flat``: NaN where one sample is, 0 where there is none."""
    least, most = at_once(flat.min, flat.max) if flat.size else (0, 0)
    return float(least), float(most)


@compiled
def _binned(flat: NDArray[Any], least: float, bins_per_unit: float) -> Coordinates:
    """Return how many samples each bin has, and by how much they lie above ``least`` together, (N_BINS + 1, 2)."""
    sums = np.zeros((N_BINS + 1, 2))
    above, bins = np.empty(TOGETHER), np.empty(TOGETHER, np.uint32)
    for first in range(0, flat.size, TOGETHER):
        some = flat[first : first + TOGETHER]
        for i in range(some.size):
            above[i] = np.float64(some[i]) - least
            bins[i] = min(np.uint32(np.int32(above[i] * bins_per_unit)), np.uint32(N_BINS))
        for i in range(some.size):
            k = bins[i]
            sums[k, 0] += 1
            sums[k, 1] += above[i]
    return sums


@compiled
def _running(first: Coordinates, second: Coordinates) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return (centre, count, total) of the bins that have samples: their mean, and sums of them and all bins below.

    ``first`` and ``second``: histograms of two halves, as from :func:`_binned`.
    """
    centre, count, total = np.empty(N_BINS + 1), np.empty(N_BINS + 1), np.empty(N_BINS + 1)
    n_filled, count_so_far, total_so_far = 0, 0.0, 0.0
    for k in range(N_BINS + 1):
        here, above = first[k, 0] + second[k, 0], first[k, 1] + second[k, 1]
        count_so_far += here
        total_so_far += above
        centre[n_filled], count[n_filled], total[n_filled] = above / here, count_so_far, total_so_far
        n_filled += here > 0  # a bin without samples is written over by the next
    return centre[:n_filled], count[:n_filled], total[:n_filled]
