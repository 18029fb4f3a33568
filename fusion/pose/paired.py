"""Two ways of finding bores, compared over several bores: limits of agreement, and a test of equivalence."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError

FEWEST_BORES = 3
LEVEL = 0.95


@dataclass(frozen=True)
class Agreement:
    """Limits of agreement of paired differences (Bland and Altman 1986, doi:10.1016/S0140-6736(86)90837-8).

    ``bias`` is the mean difference; 95 % of differences lie between ``low`` and ``high`` if they are normal. Each has
    its 95 % interval; those of the limits are approximated as by Bland and Altman 1999
    (doi:10.1177/096228029900800204).
    """

    bores: int
    bias: float
    bias_interval: tuple[float, float]
    low: float
    low_interval: tuple[float, float]
    high: float
    high_interval: tuple[float, float]


@dataclass(frozen=True)
class Equivalence:
    """Two one-sided tests (Schuirmann 1987, doi:10.1007/BF01068419) of a mean difference against ± ``bound``.

    ``p`` is the larger of both; the two are ``equivalent`` where it is below 0.05.
    """

    bound: float
    p: float
    equivalent: bool


def limits_of_agreement(differences: Coordinates) -> Agreement:
    """Return how far paired ``differences`` (n,) scatter. Raises :class:`EndoctError` where they are too few."""
    values = _checked(differences)
    n, bias, deviation = values.size, float(values.mean()), float(values.std(ddof=1))
    t = float(stats.t.ppf((1 + LEVEL) / 2, n - 1))
    reach = float(stats.norm.ppf((1 + LEVEL) / 2))
    of_bias = t * deviation / np.sqrt(n)
    of_limit = t * deviation * np.sqrt(1 / n + reach**2 / (2 * (n - 1)))
    low, high = bias - reach * deviation, bias + reach * deviation
    return Agreement(
        bores=n,
        bias=bias,
        bias_interval=(bias - of_bias, bias + of_bias),
        low=low,
        low_interval=(low - of_limit, low + of_limit),
        high=high,
        high_interval=(high - of_limit, high + of_limit),
    )


def equivalence(differences: Coordinates, bound: float) -> Equivalence:
    """Return whether the mean of paired ``differences`` (n,) lies within ± ``bound``, both in one unit.

    Raises :class:`EndoctError` where there are too few, or the bound is not positive.
    """
    values = _checked(differences)
    if not (np.isfinite(bound) and bound > 0):
        raise EndoctError("a bound of equivalence must be positive", found=f"{bound:g}")
    if np.ptp(values) == 0:  # no scatter: a t test has nothing to go by
        p = 0.0 if abs(float(values[0])) < bound else 1.0
    else:
        above = stats.ttest_1samp(values, -bound, alternative="greater").pvalue
        below = stats.ttest_1samp(values, bound, alternative="less").pvalue
        p = float(max(above, below))
    return Equivalence(bound, p, p < 1 - LEVEL)


def _checked(differences: Coordinates) -> Coordinates:
    values = np.asarray(differences, dtype=np.float64)
    if values.ndim != 1 or values.size < FEWEST_BORES or not np.isfinite(values).all():
        raise EndoctError(
            "differences of two sides cannot be summarised",
            found=f"{values.size} of them" if values.ndim == 1 else f"shape {values.shape}",
            expected=f"{FEWEST_BORES} bores at least, a finite number each",
        )
    return values
