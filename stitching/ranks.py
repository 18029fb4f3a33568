"""Order statistics of the columns of an array."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Mask


def medians(samples: NDArray[Any]) -> NDArray[Any]:
    """Return the median of the finite ``samples`` (n, n_columns) of every column, in their type; NaN where none is."""
    finite = np.isfinite(samples)
    count = np.count_nonzero(finite, axis=0)
    ordered, column = _ordered(samples, finite), np.arange(count.size)
    lower, upper = (
        ordered[column, np.maximum(count - 1, 0) // 2],
        ordered[column, np.minimum(count // 2, len(samples) - 1)],
    )
    return np.where(count > 0, (lower + upper) / 2, np.nan).astype(samples.dtype)


def ranked(samples: NDArray[Any], counted: Mask, rank: NDArray[np.intp]) -> NDArray[Any]:
    """Return of every column of ``samples`` (n, n_columns) the ``counted`` one with so many smaller ones as ``rank``.

    ``rank`` is (n_columns,), less than n. Infinite where fewer count.
    """
    return np.asarray(_ordered(samples, counted)[np.arange(rank.size), rank])


def _ordered(samples: NDArray[Any], counted: Mask) -> NDArray[Any]:
    """The ``counted`` samples of each column in their order, then infinity, (n_columns, n).

    Sorting along rows that lie in one piece takes a fifth of the time of sorting along columns.
    """
    ordered = np.where(counted.T, samples.T, samples.dtype.type(np.inf))
    ordered = np.ascontiguousarray(ordered)
    ordered.sort(axis=1)
    return ordered
