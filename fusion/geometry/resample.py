"""Bringing images of the bore wall onto other rows and columns, knowing what was observed.

Rows and columns are resampled separately, each by a sparse matrix: linear interpolation where the new
samples lie closer than the old ones, the mean over the new sample's extent where they lie farther apart.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.base.arrays import Coordinates, Image, Mask, read_view
from endoct.base.compute.compiled import compiled

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
    # equally many taps for every column, so that they can be taken one after the other
    taps, weights = (part.reshape(columns.shape[0], -1).T for part in (columns.indices, columns.data))
    across = np.ascontiguousarray(taps, dtype=np.int32), np.ascontiguousarray(weights)
    down = rows.indptr.astype(np.int32), rows.indices.astype(np.int32), rows.data  # int64 where SciPy likes
    filled = np.diff(rows.indptr) > 0
    first = rows.indptr[:-1][filled]
    reach = np.maximum.reduceat(rows.indices, first) - np.minimum.reduceat(rows.indices, first) if first.size else [0]
    image, valid = read_view(image.astype(np.float32, copy=False)), read_view(valid)
    return _resampled(image, valid, across, down, int(np.max(reach)) + 1, np.float32(at_least - 1e-6))


@compiled
def _resampled(
    image: Image,
    valid: Mask,
    across: tuple[NDArray[np.int32], Image],
    down: tuple[NDArray[np.int32], NDArray[np.int32], Image],
    n_held: int,
    at_least: np.float32,
) -> tuple[Image, Mask]:
    """What :func:`resample` returns; the last ``n_held`` old rows are kept as they are on new columns."""
    starts, old_rows, down_weights = down
    n_to, n = starts.size - 1, across[0].shape[1]
    new, observed = np.empty((n_to, n), np.float32), np.empty((n_to, n), np.bool_)
    held, held_row = np.empty((2, n_held, n), np.float32), np.full(n_held, -1)
    total, share = np.empty(n, np.float32), np.empty(n, np.float32)
    for row in range(n_to):
        total[:], share[:] = 0, 0
        for k in range(starts[row], starts[row + 1]):
            old, weight = old_rows[k], down_weights[k]
            value, known = held[0, old % n_held], held[1, old % n_held]
            if held_row[old % n_held] != old:
                held_row[old % n_held] = old
                _row_across(image[old], valid[old], across, value, known)
            for column in range(n):
                total[column] += weight * value[column]
                share[column] += weight * known[column]
        for column in range(n):
            observed[row, column] = share[column] >= at_least
            mean = total[column] / share[column]
            new[row, column] = mean if share[column] >= at_least else np.float32(0)
    return new, observed


@compiled
def _row_across(row: Image, valid: Mask, across: tuple[NDArray[np.int32], Image], value: Image, known: Image) -> None:
    """Fill ``value`` and ``known`` with sums of weights times valid samples, and of these weights, on new columns."""
    taps, weights = across
    observed, masked = np.empty(row.size, np.float32), np.empty(row.size, np.float32)
    for column in range(row.size):
        observed[column] = valid[column]
        masked[column] = row[column] if valid[column] else np.float32(0)
    value[:], known[:] = 0, 0
    for k in range(taps.shape[0]):
        for column in range(value.size):  # innermost, since this loop can be made of vectors
            value[column] += weights[k, column] * masked[taps[k, column]]
            known[column] += weights[k, column] * observed[taps[k, column]]


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
