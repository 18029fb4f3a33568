"""Starts of turns from a landmark that creeps: least squares over the starts and the landmark's own directions.

The landmark is seen at its direction less the start. Starts lie about 0; the direction changes little from slice to
slice and is 0 on average. Outliers of either count less and less.
"""

import numpy as np
from scipy.linalg import solveh_banded

from endoct.stitching.arrays import Coordinates

ROBUST_STEPS = 5
MEAN_WEIGHT = 1e3  # of the landmark's mean direction, which is defined as 0


def separated(
    moved_rad: Coordinates, sigma_rad: Coordinates, usual_rad: float, creep_rad: float
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations, float64 (n,).

    ``moved_rad``: where the landmark is seen, with the standard deviation ``sigma_rad``, infinite where it is not seen.
    Starts scatter by ``usual_rad``, the landmark creeps by ``creep_rad`` a slice. Starts are eliminated, so that only
    neighbouring directions and their mean are coupled: memory and time grow linearly with the number of slices.
    """
    n = moved_rad.size
    of_starts, of_sights = np.full(n, usual_rad**-2.0), sigma_rad**-2.0
    to_next, mean = creep_rad**-2.0, np.full(n, MEAN_WEIGHT / n)
    neighbours = np.minimum(np.arange(n), 1) + np.minimum(np.arange(n)[::-1], 1)
    start_weight, sight_weight = np.ones(n), np.ones(n)
    for _ in range(ROBUST_STEPS):  # a turn that was measured wrongly is an outlier to its neighbours too
        known, seen = of_starts * start_weight**2, of_sights * sight_weight**2
        held = known * seen / (known + seen)
        bands = np.full((2, n), -to_next)
        bands[1] = held + to_next * neighbours
        free, by_mean = solveh_banded(bands, np.stack([held * moved_rad, mean], axis=1)).T
        direction = free - by_mean * (mean @ free) / (1 + mean @ by_mean)
        start = seen / (known + seen) * (direction - moved_rad)
        variance = _variances(held, to_next) - by_mean**2 / (1 + mean @ by_mean)
        spread = np.sqrt(1 / (known + seen) + (seen / (known + seen)) ** 2 * variance)
        start_weight = 1 / np.sqrt(1 + (start / usual_rad / 2) ** 2)
        sight_weight = 1 / np.sqrt(1 + ((direction - start - moved_rad) / sigma_rad / 2) ** 2)
    return start, spread


def _variances(held: Coordinates, to_next: float) -> Coordinates:
    """Return the diagonal of the inverse, (n,): every node is tied to the ground, and to its neighbours on both sides.

    As conductances in series and in parallel: only positive terms are added, so that nothing cancels.
    """

    def from_before(each: Coordinates) -> Coordinates:
        through, last = np.zeros(each.size), 0.0
        for i, own in enumerate(each[:-1]):
            last = float(own) + last
            last = through[i + 1] = to_next * last / (to_next + last)
        return through

    return np.asarray(1 / (held + from_before(held) + from_before(held[::-1])[::-1]))
