"""Minimum cross-entropy threshold after Li and Tam (1998), from a histogram."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.stitching.compiled import compiled
from endoct.stitching.errors import EndoctError
from endoct.stitching.parallel import at_once

N_BINS = 65_536
TOGETHER = 512
"""Samples whose bins are worked out at once, as vectors of the processor."""
MOST_ROUNDS = 1000


def li_threshold(values: NDArray[np.generic]) -> float:
    """Return the threshold of ``values`` (any shape, any real dtype, valid samples only) that Li's iteration finds.

    Foreground is what lies above it. The histogram has 65 536 bins between the extremes, or one a count where
    integers span less; each bin also knows the mean of its samples. The iteration is that of
    ``skimage.filters.threshold_li``, started from the mean, and agrees with it to within a bin.

    Raises :class:`EndoctError` where there are no finite samples or all are equal.
    """
    flat = np.asarray(values).ravel()
    whole = flat.dtype.kind in "iub"
    if flat.dtype.kind == "b" or flat.dtype == np.float16:
        flat = flat.astype(np.uint8 if whole else np.float32)
    if flat.size and not np.isfinite([flat.min(), flat.max()]).all():
        flat = flat[np.isfinite(flat)]
    if not flat.size:
        raise EndoctError("nothing to threshold", found="no valid sample")
    least, most = float(flat.min()), float(flat.max())
    if least == most:
        raise EndoctError(
            "nothing to threshold", found=f"every valid sample is {least:g}", expected="wall and cells that differ"
        )
    width = max((most - least) / N_BINS, 1.0 if whole else 0.0)
    halves = np.array_split(flat, 2)
    count, total = np.add(*at_once(*(partial(_binned, half, least, width) for half in halves)))
    filled = count > 0
    centre, count, total = total[filled] / count[filled], count[filled], total[filled]
    below_count, below_total = np.cumsum(count), np.cumsum(total)
    threshold, before = below_total[-1] / below_count[-1], -np.inf
    tolerance = 0.5 if whole else width * 1e-3
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


@compiled
def _binned(flat: NDArray[Any], least: float, width: float) -> Coordinates:
    """Return how many samples each bin has, and by how much they lie above ``least`` together, (2, N_BINS + 1)."""
    sums = np.zeros((N_BINS + 1, 2))
    above, bins = np.empty(TOGETHER), np.empty(TOGETHER, np.int32)
    for first in range(0, flat.size, TOGETHER):
        some = flat[first : first + TOGETHER]
        for i in range(some.size):
            above[i] = np.float64(some[i]) - least
            bins[i] = np.int32(above[i] / width)
        for i in range(some.size):
            k = min(bins[i], N_BINS)
            sums[k, 0] += 1
            sums[k, 1] += above[i]
    return sums.T.copy()
