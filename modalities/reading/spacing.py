"""How far frames lie apart by numbers that count them or say when they were taken: evenly, with gaps, or unevenly."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from endoct.base.arrays import Coordinates

LEAST_REGULAR = 0.8
"""Share of equal steps from which on they are the usual step; else it is the median."""
WITHIN = 0.25
"""Of the usual step, by which a step may differ from a whole number of them."""
FINE = 20
"""Times the resolution: steps from there on may jitter, as times and measured places do."""
EXACT = 1e-6
LEAST_USUAL = 0.5
"""Share of the steps that are no gap."""
MOST_DRIFT_SHARE = 0.01
MOST_DRIFT = 0.5
"""Of the usual step, by which a frame may lie off its place where all lie evenly."""


@dataclass(frozen=True, eq=False)
class Spacing:
    """``usual``: the step between neighbours; ``places``: float64 (n,), in usual steps from the first.

    Even places, and those with gaps, are whole numbers: what neighbours jitter is that of a clock.
    """

    kind: Literal["even", "gaps", "uneven"]
    usual: float
    places: Coordinates


def spacing_of(values: Sequence[float] | Coordinates, resolution: float = 0.0, within: float = WITHIN) -> Spacing:
    """Return how ``values``, one a frame in their order, are spaced; fewer than three are even.

    Values that do not ascend are uneven, and so are steps that are no multiples of the usual one. ``resolution``: the
    least difference that values can have; where the usual step is not much more, it is counted exactly. ``within``: by
    how much of the usual step one may differ from a whole number of them.
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
    exact = usual < FINE * resolution
    within, most_drift = (EXACT, EXACT) if exact else (within, within if within < WITHIN else MOST_DRIFT)
    slope = (along[-1] - along[0]) / (n - 1)
    off_line = np.abs(along - along[0] - slope * np.arange(n)) / slope
    if (whole == 1).all() and off_line.max() <= most_drift and (np.abs(steps / usual - 1) <= 2 * within).all():
        return Spacing("even", usual, np.arange(n, dtype=np.float64))
    if (whole >= 1).all() and (np.abs(steps / usual - whole) <= within).all() and (whole == 1).mean() >= LEAST_USUAL:
        counted = np.concatenate([[0.0], np.cumsum(whole)])
        if np.abs(places - counted).max() <= max(most_drift, MOST_DRIFT_SHARE * n):
            return Spacing("gaps", usual, counted)
    return Spacing("uneven", usual, places)


def _usual(steps: Coordinates) -> float:
    values, counts = np.unique(steps, return_counts=True)
    if counts.max() >= LEAST_REGULAR * steps.size:
        return float(values[np.argmax(counts)])
    return float(np.median(steps))
