"""Starts of turns from a mark that creeps: least squares over the starts and the mark's own directions.

The mark is seen at its direction less the start. Starts lie about 0, the direction changes little from slice to slice
and is 0 on average; what departs far from either counts less and less.
"""

import numpy as np
from scipy.linalg import solveh_banded

from endoct.stitching.arrays import Coordinates

ROBUST_STEPS = 5
MEAN_WEIGHT = 1e3  # of the mark's mean direction, which is taken for 0
MOST_AS_MATRIX = 400  # slices; beyond, its memory would grow with their square, its time with their cube


def separated(
    moved_rad: Coordinates, sigma_rad: Coordinates, usual_rad: float, creep_rad: float
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations, float64 (n,).

    ``moved_rad``: where the mark is seen, with the standard deviation ``sigma_rad``, which is infinite where it is not
    seen. Starts are about ``usual_rad``, the mark creeps by about ``creep_rad`` a slice.
    """
    solve = _by_matrix if moved_rad.size <= MOST_AS_MATRIX else _by_bands
    return solve(moved_rad, sigma_rad, usual_rad, creep_rad)


def _by_matrix(
    moved_rad: Coordinates, sigma_rad: Coordinates, usual_rad: float, creep_rad: float
) -> tuple[Coordinates, Coordinates]:
    # unknown: n starts, then n directions of the mark
    n = moved_rad.size
    told = np.flatnonzero(np.isfinite(sigma_rad))
    matrix = np.zeros((n + n + told.size, 2 * n))
    matrix[:n, n:] = _creep(n, creep_rad)
    matrix[n : 2 * n, :n] = np.eye(n) / usual_rad
    matrix[2 * n + np.arange(told.size), n + told] = 1 / sigma_rad[told]
    matrix[2 * n + np.arange(told.size), told] = -1 / sigma_rad[told]
    values = np.concatenate([np.zeros(2 * n), moved_rad[told] / sigma_rad[told]])
    weight = np.ones(values.size)
    for _ in range(ROBUST_STEPS):  # a turn that was measured wrongly is an outlier to its neighbours too
        weighted = matrix * weight[:, None]
        covariance = np.linalg.inv(weighted.T @ weighted)
        solution = covariance @ (weighted.T @ (weight * values))
        away = matrix @ solution - values
        weight[n:] = 1 / np.sqrt(1 + (away[n:] / 2) ** 2)
    return solution[:n], np.sqrt(np.diag(covariance)[:n])


def _creep(n: int, creep_rad: float) -> Coordinates:
    """Return rows, float64 (n, n), that say that n unknowns hardly change from one to the next, and add up to 0."""
    rows = (np.eye(n, k=1) - np.eye(n)) / creep_rad
    rows[-1] = MEAN_WEIGHT / n
    return np.asarray(rows)


def _by_bands(
    moved_rad: Coordinates, sigma_rad: Coordinates, usual_rad: float, creep_rad: float
) -> tuple[Coordinates, Coordinates]:
    """The same but for rounding: each start is eliminated, which leaves neighbouring directions, and their mean."""
    n = moved_rad.size
    of_starts, of_sights = np.full(n, usual_rad**-2.0), sigma_rad**-2.0
    to_next, mean = creep_rad**-2.0, np.full(n, MEAN_WEIGHT / n)
    start_weight, sight_weight = np.ones(n), np.ones(n)
    for _ in range(ROBUST_STEPS):
        known, seen = of_starts * start_weight**2, of_sights * sight_weight**2
        held = known * seen / (known + seen)
        bands = np.full((2, n), -to_next)
        bands[1] = held + to_next * np.r_[1.0, np.full(n - 2, 2.0), 1.0]
        free, by_mean = solveh_banded(bands, np.stack([held * moved_rad, mean], axis=1)).T
        direction = free - by_mean * (mean @ free) / (1 + mean @ by_mean)
        start = seen / (known + seen) * (direction - moved_rad)
        variance = _variances(held, to_next) - by_mean**2 / (1 + mean @ by_mean)
        spread = np.sqrt(1 / (known + seen) + (seen / (known + seen)) ** 2 * variance)
        start_weight = 1 / np.sqrt(1 + (start / usual_rad / 2) ** 2)
        sight_weight = 1 / np.sqrt(1 + ((direction - start - moved_rad) / sigma_rad / 2) ** 2)
    return start, spread


def _variances(held: Coordinates, to_next: float) -> Coordinates:
    """Return the diagonal of the inverse, (n,): every node is held by itself and, through its links, from both sides.

    Conductances in series and in parallel: sums of what is positive, so that nothing cancels.
    """

    def from_before(each: Coordinates) -> Coordinates:
        through, last = np.zeros(each.size), 0.0
        for i, own in enumerate(each[:-1]):
            last = float(own) + last
            last = through[i + 1] = to_next * last / (to_next + last)
        return through

    return np.asarray(1 / (held + from_before(held) + from_before(held[::-1])[::-1]))
