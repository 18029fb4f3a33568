"""How sure a figure is: bootstrap intervals, limits of agreement, and how well a score repeats.

All are over things that were drawn independently: cells, patches of wall, specimens. Never over pixels.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.fusion.result import Limits

RESAMPLES = 2000
SEED = 2019
LEVEL = 0.95
FEWEST = 5
"""With fewer things than this no interval is given: a bootstrap of so few is far too narrow."""
FEWEST_PAIRS = 3
FEWEST_SPECIMENS = 2

Interval = tuple[float, float] | None


@lru_cache(maxsize=4)
def weights(n: int) -> NDArray[np.float64]:
    """Return how often each of ``n`` things is drawn in every resample, (RESAMPLES, n); always the same."""
    drawn = np.random.default_rng(SEED).multinomial(n, np.full(n, 1 / n), size=RESAMPLES).astype(np.float64)
    drawn.flags.writeable = False
    return drawn


def ratio(part: float, whole: float) -> float | None:
    """Return ``part`` over ``whole``; None where there is nothing."""
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


def bland_altman(a: Coordinates, b: Coordinates) -> Limits | None:
    """Return how far ``b`` differs from ``a``, pairs of measurements (n,) each; None for fewer than three.

    After Bland and Altman 1986 (doi:10.1016/S0140-6736(86)90837-8). ``bias`` is the mean of b − a. ``low`` and
    ``high`` are the limits bias ± 1.96 SD, within which 95 % of differences lie if they are normal. ``bias_interval``
    is bootstrapped over pairs.
    """
    if a.size < FEWEST_PAIRS:
        return None
    differs = b - a
    bias, spread = float(differs.mean()), 1.96 * float(differs.std(ddof=1))
    return Limits(
        pairs=int(a.size), bias=bias, low=bias - spread, high=bias + spread, bias_interval=interval_of(differs, np.mean)
    )


def repeatability(groups: Sequence[Sequence[float]]) -> dict[str, float | int | None] | None:
    """Return how well a score repeats when one specimen is recorded or drawn again; None where none was.

    ``groups`` are the values of each specimen. From the one-way analysis of variance with specimens as the factor:

    - ``within_sd`` is the root of the mean square within specimens;
    - ``repeatability`` = 1.96 √2 within_sd. 95 % of differences of two repeats lie below it (Bland and Altman 1999,
      doi:10.1177/096228029900800204);
    - ``between_sd`` is None with one specimen;
    - ``icc`` is the intraclass correlation ICC(1,1) (Shrout and Fleiss 1979, doi:10.1037/0033-2909.86.2.420). Unequal
      numbers of repeats count by their mean size k₀. It is None with one specimen or where nothing varies.
    """
    values = [np.asarray(group, dtype=np.float64) for group in groups if len(group)]
    n, total = len(values), sum(group.size for group in values)
    if total <= n:
        return None
    within = sum(float(((group - group.mean()) ** 2).sum()) for group in values) / (total - n)
    figures: dict[str, float | int | None] = {
        "specimens": n,
        "comparisons": total,
        "within_sd": float(np.sqrt(within)),
        "repeatability": float(1.96 * np.sqrt(2 * within)),
        "between_sd": None,
        "icc": None,
    }
    if n >= FEWEST_SPECIMENS:
        mean = float(np.concatenate(values).mean())
        between = sum(group.size * (float(group.mean()) - mean) ** 2 for group in values) / (n - 1)
        size = (total - sum(group.size**2 for group in values) / total) / (n - 1)
        figures["between_sd"] = float(np.sqrt(max(between - within, 0.0) / size))
        if between + within > 0:
            figures["icc"] = float((between - within) / (between + (size - 1) * within))
    return figures
