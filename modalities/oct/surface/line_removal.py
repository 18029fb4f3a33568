"""B-scans without the lines that the detector draws, each in one pass over its samples."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.surface.wall_evidence import Background


class Bridges(NamedTuple):
    """What rows are made of: each of ``row`` (n,) of the rows ``low`` and ``high``, of ``high`` by its ``share``."""

    row: NDArray[np.intp]
    low: NDArray[np.intp]
    high: NDArray[np.intp]
    share: Coordinates


def bridges_over(hidden: Mask) -> Bridges:
    """Return how the rows ``hidden``, bool (depth,), are interpolated from their neighbours; none where all are."""
    good, row = np.flatnonzero(~hidden), np.flatnonzero(hidden)
    if not good.size:
        return Bridges(good, good, good, np.empty(0))
    after = np.searchsorted(good, row)
    low, high = good[np.maximum(after - 1, 0)], good[np.minimum(after, good.size - 1)]
    return Bridges(row, low, high, np.where(low == high, 0.5, (row - low) / np.maximum(high - low, 1)))


def bridge_rows(image: Image, hidden: Mask) -> Image:
    """Return ``image`` (θ, depth) with the rows ``hidden``, bool (depth,), interpolated from their neighbours."""
    bridges = bridges_over(hidden)
    if not bridges.row.size:
        return image
    filled = image.copy()
    _bridge(filled, bridges)
    return filled


def without_lines(samples: NDArray[Any], background: Background) -> Image:
    """Return a logarithmic B-scan (θ, depth) as if noise were equally bright at all depths, without fixed lines.

    Where a line is fainter than the wall, the span between line and wall is stretched to that between noise and
    wall. Where it is not, it hides what lies under it, and its rows are interpolated from their neighbours. The levels
    are float32.
    """
    excess = background.line_excess
    contrast, hidden = background.contrast, background.hidden
    gain = contrast / (contrast - np.where(hidden, 0, excess))
    faint = np.flatnonzero(background.lines & ~hidden)
    levels = np.empty(samples.shape, np.float32)
    _level(samples, background.floor, faint, np.float32(background.noise), excess, gain.astype(np.float32), levels)
    _bridge(levels, bridges_over(hidden))
    return levels


@compiled
def _level(
    samples: NDArray[Any],
    floor: Image,
    rows: NDArray[np.intp],
    darkness: np.float32,
    excess: Image,
    gain: Image,
    levels: Image,
) -> None:
    """Write ``samples`` less ``floor`` to ``levels``; in ``rows``, what exceeds ``darkness`` times ``gain``."""
    for column in range(len(samples)):
        own = levels[column]
        for row in range(floor.size):
            own[row] = np.float32(samples[column, row]) - floor[row]
        for row in rows:
            own[row] = darkness + (own[row] - darkness - excess[row]) * gain[row]


@compiled
def _bridge(image: Image, bridges: Bridges) -> None:
    """Fill rows of ``image`` (θ, depth), in place."""
    for column in range(len(image)):
        bridge_ascan(image[column], bridges)


@compiled
def bridge_ascan(samples: Image, bridges: Bridges) -> None:
    """Fill rows of one A-scan (depth,), in place."""
    for k in range(bridges.row.size):
        share = bridges.share[k]
        samples[bridges.row[k]] = (1 - share) * samples[bridges.low[k]] + share * samples[bridges.high[k]]
