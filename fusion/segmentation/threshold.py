"""Minimum cross-entropy threshold after Li and Tam (1998), from a histogram."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.stitching.compiled import compiled
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
    if flat.dtype.kind == "b" or flat.dtype == np.float16:
        flat = flat.astype(np.uint8 if whole else np.float32)
    n_finite, least, most = _extremes(flat)
    if n_finite == 0:
        raise EndoctError("nothing to threshold", found="no valid sample")
    if least == most:
        raise EndoctError(
            "nothing to threshold", found=f"every valid sample is {least:g}", expected="wall and cells that differ"
        )
    width = max((most - least) / N_BINS, 1.0 if whole else 0.0)
    count, total = np.zeros(N_BINS + 1), np.zeros(N_BINS + 1)
    _fill(flat, least, width, count, total)
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
def _extremes(flat: NDArray[Any]) -> tuple[int, float, float]:
    """Return how many samples are finite, and the least and the largest of them."""
    n_finite, least, most = 0, np.inf, -np.inf
    for value in flat:
        number = np.float64(value)
        if np.isfinite(number):
            n_finite += 1
            least, most = min(least, number), max(most, number)
    return n_finite, least, most


@compiled
def _fill(flat: NDArray[Any], least: float, width: float, count: Coordinates, total: Coordinates) -> None:
    """Add up the finite samples of each bin: how many, and by how much they lie above ``least``."""
    for value in flat:
        above = np.float64(value) - least
        if np.isfinite(above):
            k = min(int(above / width), N_BINS)
            count[k] += 1
            total[k] += above
