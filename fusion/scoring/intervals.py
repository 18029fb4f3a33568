"""Bootstrap intervals over things that were drawn independently: cells, patches of wall, specimens. Never pixels."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates

RESAMPLES = 2000
SEED = 2019
LEVEL = 0.95
FEWEST = 5
"""Of fewer things than this no interval is given: a bootstrap of so few is far too narrow."""

Interval = tuple[float, float] | None


@lru_cache(maxsize=4)
def weights(n: int) -> NDArray[np.float64]:
    """Return how often each of ``n`` things is drawn in every resample, (RESAMPLES, n); always the same."""
    drawn = np.random.default_rng(SEED).multinomial(n, np.full(n, 1 / n), size=RESAMPLES).astype(np.float64)
    drawn.flags.writeable = False
    return drawn


def ratio(part: float, whole: float) -> float | None:
    """Return ``part`` of ``whole``, or None where there is nothing: the one convention for two empty masks."""
    return float(part / whole) if whole else None


def ratio_interval(numerators: Coordinates, denominators: Coordinates) -> Interval:
    """Return the percentile bootstrap interval of Σ numerators / Σ denominators over their n things, (n,) each."""
    if numerators.size < FEWEST:
        return None
    drawn = weights(numerators.size)
    below = drawn @ denominators
    above = drawn @ numerators
    return percentiles(above[below > 0] / below[below > 0])


def interval_of(values: Coordinates, statistic: Callable[..., object] = np.median) -> Interval:
    """Return the percentile bootstrap interval of ``statistic`` (with an ``axis``) of ``values`` (n,)."""
    if values.size < FEWEST:
        return None
    drawn = np.random.default_rng(SEED).integers(values.size, size=(RESAMPLES, values.size))
    return percentiles(np.asarray(statistic(values[drawn], axis=1)))


def percentiles(estimates: Coordinates) -> Interval:
    """Return the middle ``LEVEL`` of ``estimates`` (m,); None where there are none."""
    if not estimates.size:
        return None
    low, high = np.quantile(estimates, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)
