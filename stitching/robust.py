"""Spread of samples that may hold outliers."""

import numpy as np
from numpy.typing import ArrayLike

from endoct.stitching.arrays import Coordinates
from endoct.stitching.ranks import median

SIGMA_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute deviations."""


def robust_sigma(deviations: ArrayLike) -> float:
    """Return the standard deviation that the median of absolute ``deviations`` (any shape) stands for.

    ``deviations`` are those from a centre that the caller knows: a median, a fit, or 0. For a normal distribution this
    is its standard deviation; a minority of outliers hardly moves it.
    """
    return SIGMA_PER_MEDIAN * median(np.abs(np.asarray(deviations)))


def robust_sigmas(deviations: ArrayLike) -> Coordinates:
    """Return :func:`robust_sigma` of every column of ``deviations`` (n, k), float64 (k,)."""
    return np.asarray(SIGMA_PER_MEDIAN * np.median(np.abs(np.asarray(deviations, np.float64)), axis=0))
