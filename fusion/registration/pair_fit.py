"""The turn, shift and scale that lay the landmarks of one side on those of the other best, by weighted least squares.

Around the bore landmarks lie on a circle. There the sum of squared distances has a minimum for every way of cutting it
open, so that all of them are tried (Hotz and Huckemann 2015, Intrinsic means on the circle): the answer does not depend
on where θ = 0 is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.fusion.geometry.alignment import Alignment, Orientation, as_covariance
from endoct.fusion.geometry.landmarks import LandmarkPair, columns, residuals_mm
from endoct.fusion.registration.stretch import FARTHEST
from endoct.stitching.arrays import Coordinates


@dataclass(frozen=True)
class Scale:
    """What is known of the scale along the bore before any pair: ``value`` and ``variance``, 0 where it is given."""

    value: float = 1.0
    variance: float = 0.0


@dataclass(frozen=True)
class PairFit:
    """The ``alignment`` that fits pairs best in one orientation, with its covariance.

    Attributes: ``chi2``, the sum of squared distances in standard errors; ``freedom``, how many distances are more than
    was fitted; ``scale_share``, how much of the scale is by the pairs, 0 to 1: the rest is by what was known before.
    """

    alignment: Alignment
    chi2: float
    freedom: float
    scale_share: float

    @property
    def misfit(self) -> float | None:
        """How many times as far as expected pairs lie apart; None where they decide too little to say."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom else None


def fit_pairs(pairs: Sequence[LandmarkPair], orientation: Orientation, radius_mm: float, scale: Scale) -> PairFit:
    """Return the alignment of one ``orientation`` that fits one or more ``pairs`` best.

    The scale is the mean of what the pairs say and what was known before, weighted by precision: pairs that lie close
    together along the bore, or a single one, leave it as it was, and those far apart decide it. It stays within
    ``FARTHEST``. The covariance is that of the places pointed out, larger by as much as pairs lie farther apart than
    their ``sigma_mm`` says.
    """
    mirrored, z_reversed = orientation
    a, b = columns(pairs)
    weight = np.array([pair.sigma_mm for pair in pairs], np.float64) ** -2.0
    turn_rad = mean_turn_rad(a[:, 0] - (-b[:, 0] if mirrored else b[:, 0]), weight)
    along_mm = -b[:, 1] if z_reversed else b[:, 1]
    middle_mm, there_mm = (float(np.average(z_mm, weights=weight)) for z_mm in (along_mm, a[:, 1]))
    precision = float(weight @ (along_mm - middle_mm) ** 2)
    share = precision * scale.variance / (1 + precision * scale.variance)
    value = scale.value
    if share:
        by_pairs = float(weight @ ((along_mm - middle_mm) * (a[:, 1] - there_mm))) / precision
        value = float(np.clip(share * by_pairs + (1 - share) * scale.value, *FARTHEST))
    alignment = Alignment(turn_rad, there_mm - value * middle_mm, value, mirrored, z_reversed)
    chi2 = float(weight @ (residuals_mm(pairs, alignment, radius_mm) ** 2).sum(axis=1))
    freedom = 2 * len(pairs) - 2 - share if len(pairs) > 1 else 0.0
    excess = max(1.0, chi2 / freedom) if freedom else 1.0
    of_scale = scale.variance / (1 + precision * scale.variance / excess)
    of_places = excess / float(weight.sum())
    covariance = covariance_about(middle_mm, of_places / radius_mm**2, of_places, of_scale)
    return PairFit(replace(alignment, covariance=as_covariance(covariance)), chi2, freedom, share)


def mean_turn_rad(turns_rad: Coordinates, weight: Coordinates) -> float:
    """Return the angle in [0, 2π) from which ``turns_rad``, (n,), differ by the least sum of squares, weighted."""
    turn = 2 * np.pi
    sorted_rad = np.sort(np.mod(turns_rad, turn))
    weight = weight[np.argsort(np.mod(turns_rad, turn))]
    # cut open before the k-th: those before it go on beyond the turn
    share = np.concatenate([[0.0], np.cumsum(weight)[:-1]]) / weight.sum()
    means = np.mod(float(np.average(sorted_rad, weights=weight)) + turn * share, turn)
    apart = np.mod(sorted_rad[np.newaxis] - means[:, np.newaxis] + np.pi, turn) - np.pi
    return float(means[np.argmin(apart**2 @ weight)])


def covariance_about(middle_mm: float, of_turn: float, of_place: float, of_scale: float) -> Coordinates:
    """Return the covariance of (turn, shift, scale), float64 (3, 3), of independent errors with these variances.

    ``of_place``: of the place of ``middle_mm``, on B's z as the alignment's scale multiplies it.
    """
    common = -middle_mm * of_scale
    rows = [[of_turn, 0, 0], [0, of_place + middle_mm**2 * of_scale, common], [0, common, of_scale]]
    return np.array(rows, np.float64)
