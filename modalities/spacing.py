"""How far frames lie apart by numbers that count them or say when they were taken: evenly, with gaps, or unevenly."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from endoct.stitching.arrays import Coordinates

LEAST_REGULAR = 0.8
"""Share of equal steps from which on they are the usual step; else it is the median."""
WITHIN = 0.25
"""Of the usual step, by which a step may differ from a whole number of them."""
MOST_DRIFT = 0.5
"""Of the usual step, by which a frame may lie off its place where all lie evenly."""


@dataclass(frozen=True, eq=False)
class Spacing:
    """``usual``: the step between neighbours; ``places``: float64 (n,), in usual steps from the first."""

    kind: Literal["even", "gaps", "uneven"]
    usual: float
    places: Coordinates


def spacing_of(values: Sequence[float] | Coordinates) -> Spacing:
    """Return how ``values``, one a frame in their order, are spaced; fewer than three are even.

    Values that do not ascend are uneven, and so are steps that are no multiples of the usual one.
    """
    along = np.asarray(values, dtype=np.float64)
    n = along.size
    if n < 3:
        return Spacing("even", float(np.ptp(along)) if n > 1 else 0.0, np.arange(n, dtype=np.float64))
    steps = np.diff(along)
    usual = _usual(steps)
    if not np.isfinite(along).all() or usual <= 0 or (steps <= 0).any():
        return Spacing("uneven", max(usual, 0.0), np.arange(n, dtype=np.float64))
    places = (along - along[0]) / usual
    whole = np.rint(steps / usual)
    slope = (along[-1] - along[0]) / (n - 1)
    off_line = np.abs(along - along[0] - slope * np.arange(n)) / slope
    if (whole == 1).all() and off_line.max() <= MOST_DRIFT and (np.abs(steps / usual - 1) <= MOST_DRIFT).all():
        return Spacing("even", usual, np.arange(n, dtype=np.float64))
    if (whole >= 1).all() and (np.abs(steps / usual - whole) <= WITHIN).all():
        drift = np.abs(places - np.concatenate([[0], np.cumsum(whole)]))
        if drift.max() <= max(MOST_DRIFT, 0.01 * n):
            return Spacing("gaps", usual, places)
    return Spacing("uneven", usual, places)


def _usual(steps: Coordinates) -> float:
    values, counts = np.unique(steps, return_counts=True)
    if counts.max() >= LEAST_REGULAR * steps.size:
        return float(values[np.argmax(counts)])
    return float(np.median(steps))
