"""Spread of samples that may hold outliers."""

import numpy as np
from numpy.typing import ArrayLike

from endoct.stitching.arrays import Coordinates
from endoct.stitching.ranks import median

SIGMA_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute deviations."""
ERROR_PER_SIGMA = 1.25
"""A median errs by so much more than a mean: √(π/2) times, of normal samples."""


def robust_sigma(deviations: ArrayLike) -> float:
    """Return the standard deviation that the median of absolute ``deviations`` (any shape) stands for.

    ``deviations`` are those from a centre that the caller knows: a median, a fit, or 0. For a normal distribution this
    is its standard deviation; a minority of outliers hardly moves it.
    """
    return SIGMA_PER_MEDIAN * median(np.abs(np.asarray(deviations)))


def error_of_median(deviations: ArrayLike) -> float:
    """Return the standard error of the median of normal samples from their ``deviations`` (n,) from it, n > 0."""
    return ERROR_PER_SIGMA * robust_sigma(deviations) / float(np.sqrt(np.size(deviations)))


def robust_sigmas(deviations: ArrayLike) -> Coordinates:
    """Return :func:`robust_sigma` of every column of ``deviations`` (n, k), float64 (k,)."""
    return np.asarray(SIGMA_PER_MEDIAN * np.median(np.abs(np.asarray(deviations, np.float64)), axis=0))
