"""The circle that most of some points agree with, by trying circles through three of them (RANSAC)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.stitching.compiled import compiled

MOST_GROWTH = 3.0
"""Of a circle's radius from what it was thought to be."""
PICKS = 200
"""Circles that are tried."""
NUMBERS = 512
"""Of points, as many as there are rays, for which it is held which three each circle goes through."""


def consensus_circle(x_px: Coordinates, y_px: Coordinates, start: Coordinates) -> Coordinates:
    """Return (x, y, radius), float64 (3,), of the circle through three of the points that most of them agree with.

    Tried are always the same ones of so many points; a radius counts that is about that of ``start``, which is the
    answer where none does.
    """
    circles = np.empty((3, PICKS))
    n = _through_three(x_px, y_px, _picks(x_px.size), start[2], circles)
    if not n:
        return start
    x, y, radius = circles[:, :n]
    tolerance = max(0.75, 0.004 * float(start[2]))
    k = int(np.argmax(_agreeing(x_px, y_px, x, y, radius, tolerance)))
    return circles[:, k].copy()


@lru_cache(NUMBERS)
def _picks(n: int) -> NDArray[np.int64]:
    """Return which three of ``n`` points each of the circles goes through, (PICKS, 3)."""
    picks = np.random.default_rng(0).integers(0, n, (PICKS, 3))
    picks.flags.writeable = False
    return picks


@compiled
def _through_three(
    x_px: Coordinates, y_px: Coordinates, picks: NDArray[np.int64], radius_px: float, circles: Coordinates
) -> int:
    """Write (x, y, radius) of the circles through three points each that have about a radius; return how many do."""
    n = 0
    for i in range(len(picks)):
        a, b, c = picks[i]
        ax, bx, cx = x_px[a], x_px[b], x_px[c]
        ay, by, cy = y_px[a], y_px[b], y_px[c]
        twice_area = 2 * (ax * (by - cy) + bx * (cy - ay) + cx * (ay - by))
        if not abs(twice_area) > 1e-6 * radius_px**2:
            continue
        a2, b2, c2 = ax**2 + ay**2, bx**2 + by**2, cx**2 + cy**2
        x = (a2 * (by - cy) + b2 * (cy - ay) + c2 * (ay - by)) / twice_area
        y = (a2 * (cx - bx) + b2 * (ax - cx) + c2 * (bx - ax)) / twice_area
        radius = np.hypot(ax - x, ay - y)
        if radius_px / MOST_GROWTH < radius < MOST_GROWTH * radius_px:
            circles[0, n], circles[1, n], circles[2, n] = x, y, radius
            n += 1
    return n


@compiled
def _agreeing(
    x_px: Coordinates, y_px: Coordinates, x: Coordinates, y: Coordinates, radius: Coordinates, tolerance: float
) -> Coordinates:
    """Return how many points each circle has within ``tolerance``, those farther from it counting less."""
    score = np.zeros(x.size)
    for i in range(x_px.size):
        for k in range(x.size):  # inside, where each adds to a score of its own: so several are added at once
            dx, dy = x_px[i] - x[k], y_px[i] - y[k]
            away = (np.sqrt(dx * dx + dy * dy) - radius[k]) / tolerance
            score[k] += max(1 - away * away, 0.0)
    return score
