"""Opening of an image by a disc: what is bright and narrower than the disc goes, all else stays.

A disc is a stack of chords of few different lengths. Least values along the longer ones come from those along the
shorter ones, so that a sample takes part in few comparisons, not in one for each pixel of the disc.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.base.compute.compiled import compiled


def opened(image: Image, size: int) -> Image:
    """Return the opening of ``image`` by a disc that is ``size`` pixels wide, an odd number; beyond the edges is none.

    To the bit what OpenCV's morphologyEx gives with an ellipse of that size, for samples that are finite.
    """
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    half_px = disc.sum(axis=1, dtype=np.int64) // 2
    return -_least(-_least(image, half_px), half_px)


@compiled
def _least(image: Image, half_px: NDArray[np.int64]) -> Image:
    """Return the least sample of the disc around every pixel; ``half_px``: how far its rows reach to either side."""
    n_rows, n_columns = image.shape
    reach = half_px.size // 2
    length = n_columns + 2 * reach
    least = np.full_like(image, np.inf)
    chord, pair = np.empty(length, np.float32), np.empty(length, np.float32)
    for k in range(n_rows):
        chord[:] = np.inf
        for i in range(n_columns):
            chord[reach + i] = image[k, i]
        half = 0
        for j in range(reach + 1):
            while half < half_px[j]:  # from the disc's edge to its middle, chords become longer
                step = min(half_px[j] - half, 2 * half + 1)
                _lower(chord[: length - step], chord[step:], pair[: length - step])
                _lower(pair[: length - 2 * step], pair[step : length - step], chord[step : length - step])
                half += step
            for row in (k + j - reach, k + reach - j):
                if 0 <= row < n_rows:
                    _lower_all(least[row], chord[reach : reach + n_columns])
    return least


@compiled
def _lower(first: Image, other: Image, result: Image) -> None:
    for i in range(result.size):
        result[i] = first[i] if first[i] < other[i] else other[i]


@compiled
def _lower_all(values: Image, to: Image) -> None:
    for i in range(values.size):
        values[i] = to[i] if to[i] < values[i] else values[i]
