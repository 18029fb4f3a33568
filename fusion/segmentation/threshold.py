"""Minimum cross-entropy threshold after Li and Tam (1998), from a histogram."""

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError

N_BINS = 65_536
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
    if not whole:
        flat = flat[np.isfinite(flat)]
    if flat.size == 0:
        raise EndoctError("nothing to threshold", found="no valid sample")
    least, most = float(flat.min()), float(flat.max())
    if least == most:
        raise EndoctError(
            "nothing to threshold", found=f"every valid sample is {least:g}", expected="wall and cells that differ"
        )
    width = max((most - least) / N_BINS, 1.0 if whole else 0.0)
    above = flat.astype(np.float64) - least
    bins = np.minimum((above / width).astype(np.intp), N_BINS)
    count = np.bincount(bins).astype(np.float64)
    total = np.bincount(bins, weights=above)
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
