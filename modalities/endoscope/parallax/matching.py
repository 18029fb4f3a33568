"""Depths that fit best together, by semi-global matching (Hirschmüller 2008), and how sure each is.

Neighbours mostly lie equally deep. Paths lead to each block along z and around, where they close upon themselves.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.base.numeric.least_squares import vertex_in_loops
from endoct.modalities.endoscope.parallax.sweeping import Costs

WARMING = 128
"""A path around, which has no beginning, starts so many blocks early to find what it brings along."""
_ROOM = Room()


def best_depths(costs: Costs, step: int, jump: int, depths_mm: Coordinates) -> Image:
    """Return the depths that fit best together, between those that were tried, float32 (n_z, n_theta), mm.

    ``step`` and ``jump``: what it costs to lie one depth or more behind a neighbour.
    """
    total = _ROOM.array("total", costs.shape, np.uint16)
    total[:] = 0
    _add_paths(costs, step, jump, total)
    places = np.empty(costs.shape[:2])
    _least(total, places)
    return np.asarray(np.interp(places, np.arange(depths_mm.size), depths_mm), dtype=np.float32)


def spread(costs: Costs, depth_mm: Image, depths_mm: Coordinates, doubt: float) -> Image:
    """Return the standard deviation from ``depth_mm`` of depths as probable as their costs say, mm, of its shape.

    A depth that costs ``doubt`` more than the cheapest is 1/e as probable.
    """
    table = np.exp(-np.arange(256) / doubt).astype(np.float32)
    spread_mm = np.empty_like(depth_mm)
    _spread(costs, depth_mm, depths_mm.astype(np.float32), np.gradient(depths_mm).astype(np.float32), table, spread_mm)
    return spread_mm


@compiled
def _add_paths(costs: Costs, step: int, jump: int, total: NDArray[np.uint16]) -> None:
    """Add to ``total``, of the shape of ``costs``, what depths cost along the four paths that lead to each block."""
    n_z, n_theta, n = costs.shape
    for turn in range(2):  # the way there and the way back
        for i in range(n_z):
            before = np.zeros(n, np.int32)
            least = 0
            for k in range(-min(WARMING, n_theta), n_theta):
                j = k % n_theta if turn == 0 else (n_theta - 1 - k) % n_theta
                least = _step(costs[i, j], before, least, step, jump)
                if k >= 0:
                    _add(before, total[i, j])
    for turn in range(2):
        behind = np.zeros((n_theta, n), np.int32)
        leasts = np.zeros(n_theta, np.int64)
        for k in range(n_z):
            i = k if turn == 0 else n_z - 1 - k
            for j in range(n_theta):
                leasts[j] = _step(costs[i, j], behind[j], leasts[j], step, jump)
                _add(behind[j], total[i, j])


@compiled
def _step(costs: NDArray[np.uint8], before: NDArray[np.int32], least: int, step: int, jump: int) -> int:
    """Replace what depths cost up to the block before by what they cost up to this one; return the least."""
    n = before.size
    left = before[0]
    new_least = 1 << 30
    for d in range(n):
        here = before[d]
        best = min(here, least + jump)
        if d > 0:
            best = min(best, left + step)
        if d + 1 < n:
            best = min(best, before[d + 1] + step)
        left = here
        before[d] = best - least + costs[d]
        new_least = min(new_least, before[d])
    return new_least


@compiled
def _add(path: NDArray[np.int32], total: NDArray[np.uint16]) -> None:
    for d in range(total.size):
        total[d] += path[d]


@compiled
def _least(total: NDArray[np.uint16], places: Coordinates) -> None:
    """Write at which depth each total is least, between depths by a parabola."""
    for i in range(total.shape[0]):
        for j in range(total.shape[1]):
            best = 1
            for d in range(2, total.shape[2] - 1):
                if total[i, j, d] < total[i, j, best]:
                    best = d
            beyond = vertex_in_loops(
                -float(total[i, j, best - 1]), -float(total[i, j, best]), -float(total[i, j, best + 1])
            )
            places[i, j] = best + min(max(beyond, -0.5), 0.5)


@compiled
def _spread(costs: Costs, depth_mm: Image, depths_mm: Image, shares: Image, table: Image, spread_mm: Image) -> None:
    for i in range(costs.shape[0]):
        for j in range(costs.shape[1]):
            least = costs[i, j].min()
            whole, square = np.float32(0), np.float32(0)
            for d in range(costs.shape[2]):
                probable = table[costs[i, j, d] - least] * shares[d]
                whole += probable
                square += probable * (depths_mm[d] - depth_mm[i, j]) ** 2
            spread_mm[i, j] = np.sqrt(square / whole)
