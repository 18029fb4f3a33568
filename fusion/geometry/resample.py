"""Bringing images of the bore wall onto other rows and columns, knowing what was observed.

Rows and columns are resampled separately, each by a sparse matrix: linear interpolation where the new
samples lie closer than the old ones, the mean over the new sample's extent where they lie farther apart.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.stitching.arrays import Coordinates, Image, Mask

FARTHEST_ROW = 0.75
"""How far, in row spacings, a place may lie from the nearest row and still count as observed."""


def row_weights(from_mm: Coordinates, spacing_mm: float, to_mm: Coordinates, extent_mm: float) -> sparse.csr_array:
    """Return the matrix (n_to, n_from) that takes rows at ``from_mm`` (ascending) to rows at ``to_mm``.

    ``spacing_mm`` is the nominal distance of the old rows, ``extent_mm`` the height of a new one. Rows of the
    matrix sum to one inside, to less where the new row lies partly beyond the ends, to zero in gaps.
    """
    index = np.arange(from_mm.size, dtype=np.float64)
    low, high = (_index_of(to_mm + side * extent_mm / 2, from_mm, spacing_mm, index) for side in (-1, 1))
    middle = _index_of(to_mm, from_mm, spacing_mm, index)
    taps, weights = _taps(low, middle, high)
    inside = (taps >= 0) & (taps < from_mm.size)
    nearest = from_mm[np.clip(np.rint(middle).astype(np.intp), 0, from_mm.size - 1)]
    near = np.abs(nearest - to_mm) <= max(FARTHEST_ROW * spacing_mm, extent_mm / 2)
    return _matrix(np.clip(taps, 0, from_mm.size - 1), weights * inside * near[:, np.newaxis], from_mm.size)


def column_weights(n_from: int, to_columns: Coordinates, extent: float) -> sparse.csr_array:
    """Return the matrix (n_to, n_from) that takes ``n_from`` columns of a circle to ``to_columns``.

    ``to_columns`` are fractional indices of the old columns; ``extent`` is the width of a new column in old ones.
    """
    taps, weights = _taps(to_columns - extent / 2, to_columns, to_columns + extent / 2)
    return _matrix(np.mod(taps, n_from), weights, n_from)


def resample(
    image: Image, valid: Mask, rows: sparse.csr_array, columns: sparse.csr_array, *, at_least: float = 0.5
) -> tuple[Image, Mask]:
    """Return (image, valid) on new rows and columns, from valid samples only.

    A new sample is valid where ``at_least`` that share of it was observed; elsewhere the image is 0.
    """
    weight = valid.astype(np.float32)
    share = _apply(weight, rows, columns)
    total = _apply(np.where(valid, image, np.float32(0)).astype(np.float32, copy=False), rows, columns)
    observed = share >= at_least - 1e-6
    return np.divide(total, share, out=np.zeros_like(total), where=observed), observed


def _apply(image: Image, rows: sparse.csr_array, columns: sparse.csr_array) -> Image:
    across = columns @ cv2.transpose(image)
    return np.asarray(
        rows @ cv2.transpose(across), dtype=np.float32
    )  # numpy's transposed copies take six times as long


def _index_of(z_mm: Coordinates, from_mm: Coordinates, spacing_mm: float, index: Coordinates) -> Coordinates:
    """Return the fractional row index of ``z_mm``, continued with the nominal spacing beyond the ends."""
    inner = np.interp(z_mm, from_mm, index)
    beyond = z_mm - np.clip(z_mm, from_mm[0], from_mm[-1])
    return np.asarray(inner + beyond / spacing_mm, dtype=np.float64)


def _taps(low: Coordinates, middle: Coordinates, high: Coordinates) -> tuple[NDArray[np.intp], Coordinates]:
    """Return old indices and their weights (n_to, k) for new samples that reach from ``low`` to ``high``."""
    if float(np.median(high - low)) <= 1.0:
        first = np.floor(middle)
        fraction = middle - first
        taps = first[:, np.newaxis] + np.arange(2)
        return taps.astype(np.intp), np.stack([1 - fraction, fraction], axis=1)
    first = np.floor(low + 0.5)  # old sample k reaches from k − ½ to k + ½
    n_taps = int(np.ceil(np.max(high - low))) + 1
    taps = first[:, np.newaxis] + np.arange(n_taps)
    reach = np.minimum(high[:, np.newaxis], taps + 0.5) - np.maximum(low[:, np.newaxis], taps - 0.5)
    return taps.astype(np.intp), np.clip(reach, 0, None) / (high - low)[:, np.newaxis]


def _matrix(taps: NDArray[np.intp], weights: Coordinates, n_from: int) -> sparse.csr_array:
    n_to, n_taps = taps.shape
    starts = np.arange(0, n_to * n_taps + 1, n_taps)
    return sparse.csr_array((weights.ravel().astype(np.float32), taps.ravel(), starts), shape=(n_to, n_from))
