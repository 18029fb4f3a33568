"""Circular edges of an image: a closed contour traced in polar space, then a robust circle through it.

The strongest circle of an image is seldom the one that is looked for, and Hough circles scatter by tens of pixels
on real frames. A contour that runs once around a centre and bends little is rare in texture. A robust circle
through it ignores where a cell, a notch or the image's edge interrupts it. It is the circle that most points agree
with, found by trying circles through three of them (RANSAC).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN, median_in_loops, quantile

MOST_GROWTH = 3.0
"""A circle's radius may differ from its first estimate by at most this factor."""
PICKS = 200
"""Number of circles that are tried."""
NUMBERS = 512
"""The choices of three points are kept for up to this many points, as many as there are rays."""
N_RAYS = 360
TRACE_RAYS = 240
LEAST_SUPPORT = 0.1
MOST_CONTRAST = 1.5
FEWEST_POINTS = 12


def consensus_circle(x_px: Coordinates, y_px: Coordinates, start: Coordinates) -> Coordinates:
    """Return (x, y, radius), float64 (3,), of the circle through three of the points that most of them agree with.

    Of so many points, the same circles are tried every time. Only a radius about that of ``start`` counts; where none
    does, ``start`` is the answer.
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
        a, b, c = picks[i, 0], picks[i, 1], picks[i, 2]
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


@dataclass(frozen=True)
class Ring:
    """A circular edge, in pixels of the image it was found in.

    ``rising``: brighter outside. ``contrast``: mean log ratio of the brightness on both sides; ``coverage``: part
    of the visible circle where there is such an edge; ``visible``: part of the circle inside the image.
    """

    x_px: float
    y_px: float
    radius_px: float
    rising: bool
    contrast: float = 0.0
    coverage: float = 0.0
    visible: float = 1.0

    @property
    def circle(self) -> tuple[float, float, float]:
        """Its x, y and radius."""
        return self.x_px, self.y_px, self.radius_px

    @property
    def support(self) -> float:
        """How clear it is: contrast times coverage."""
        return self.contrast * self.coverage

    def apart_px(self, other: "Ring") -> float:
        """Return how far the centres of two circles lie apart."""
        return float(np.hypot(self.x_px - other.x_px, self.y_px - other.y_px))

    def differs_px(self, other: "Ring") -> float:
        """Return by how much two circles differ, in their centres or in their radii."""
        return max(self.apart_px(other), abs(self.radius_px - other.radius_px))


def rays(image: Image, x_px: float, y_px: float, radii_px: Coordinates, n_rays: int = N_RAYS) -> tuple[Image, Mask]:
    """Return ``image`` along rays from a centre, float32 (n_rays, n_radii), and which samples lie inside it."""
    angle = 2 * np.pi / n_rays * np.arange(n_rays)[:, None]
    x = (x_px + radii_px * np.cos(angle)).astype(np.float32)
    y = (y_px + radii_px * np.sin(angle)).astype(np.float32)
    return sample(image, x, y)


def sample(image: Image, columns: Image, rows: Image) -> tuple[Image, Mask]:
    """Return ``image`` bilinearly at fractional places, and which of them lie inside it."""
    inside = (columns >= 0) & (rows >= 0) & (columns <= image.shape[1] - 1) & (rows <= image.shape[0] - 1)
    samples = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(samples, dtype=np.float32), inside


def find_rings(image: Image, rising: bool, count: int) -> list[Ring]:
    """Return up to ``count`` circular edges of one polarity around the image's middle, the clearest first."""
    height, width = image.shape
    x, y = (width - 1) / 2, (height - 1) / 2
    radii = np.arange(0.04 * min(height, width), 0.75 * max(height, width))
    rings: list[Ring] = []
    dark = dark_level(image)
    response, inside = _response(image, dark, x, y, radii, rising)
    gain = np.where(inside, np.clip(response, 0, MOST_CONTRAST), 0.0).astype(np.float32)
    reach = _reach(image)
    for _ in range(count):
        path = radii[trace_closed(gain)]
        gain[np.abs(radii[None, :] - path[:, None]) <= reach] = 0
        seen = _visible(inside, radii, path)
        if seen.sum() < FEWEST_POINTS:
            break
        ring = fit_circle(*_points(x, y, path, seen), (x, y, float(np.median(path))))
        for _ in range(2):
            ring = _retrace(image, dark, ring, rising)
        described = describe(image, dark, Ring(*ring, rising))
        if described.support < LEAST_SUPPORT and rings:
            break
        rings.append(described)
        gain[np.abs(radii - _distances(ring, x, y, path.size)) <= reach] = 0
    return sorted(rings, key=lambda ring: -ring.support)


def trace_closed(gain: Image, most_step: int = 2, step_cost: float = 0.05) -> NDArray[np.int64]:
    """Return for every row of ``gain`` (n_rays, n_radii) the column of the closed path of greatest gain, int (n_rays,).

    Neighbouring rows differ by at most ``most_step``, each step at ``step_cost``; the last row neighbours the
    first.
    """
    return _traced(gain, most_step, step_cost)


@compiled
def _traced(gain: Image, most_step: int, step_cost: float) -> NDArray[np.int64]:
    """The path, by dynamic programming over two turns, of which the middle one is kept."""
    n, size = gain.shape
    came = np.zeros((2 * n, size), np.int8)
    best, better = np.empty(size), np.empty(size)
    for j in range(size):
        best[j] = gain[0, j]
    for k in range(1, 2 * n):
        for j in range(size):
            top, taken = -np.inf, 0
            for step in range(-min(most_step, j), min(most_step, size - 1 - j) + 1):
                by_step = best[j + step] - step_cost * abs(step)
                if by_step > top:
                    top, taken = by_step, step
            came[k, j] = taken
            better[j] = top + gain[k % n, j]
        best, better = better, best
    at = 0
    for j in range(1, size):
        if best[j] > best[at]:
            at = j
    path, half = np.empty(n, np.int64), n // 2
    for k in range(2 * n - 1, half - 1, -1):
        if k < half + n:
            path[k % n] = at
        at += came[k, at]
    return path


def fit_circle(x_px: Coordinates, y_px: Coordinates, start: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return (x, y, radius) of the circle through most of the points, float64 (n,) each.

    Starts from the best of 200 circles through three points (a fixed sequence, so the answer is always the same),
    then Gauss-Newton with Tukey weights. Where that runs away, as it does from points
    on a line, it is the circle it started from.
    """
    circle = np.array(start, dtype=np.float64)
    if x_px.size >= FEWEST_POINTS:
        circle = consensus_circle(x_px, y_px, circle)
    begun = circle.copy()
    _refine_circle(x_px, y_px, circle)
    if not start[2] / MOST_GROWTH < circle[2] < MOST_GROWTH * start[2]:
        circle = begun
    return float(circle[0]), float(circle[1]), float(circle[2])


@compiled
def _refine_circle(x_px: Coordinates, y_px: Coordinates, circle: Coordinates) -> None:
    """Fit ``circle`` (x, y, radius) to the points by Gauss-Newton with Tukey weights; it is overwritten."""
    residual, away, slope = np.empty(x_px.size), np.empty(x_px.size), np.empty((x_px.size, 3))
    normal, change = np.empty((3, 3)), np.empty(3)
    for _ in range(15):
        for i in range(x_px.size):
            dx, dy = x_px[i] - circle[0], y_px[i] - circle[1]
            distance = max(np.sqrt(dx * dx + dy * dy), 1e-9)
            residual[i] = distance - circle[2]
            away[i] = abs(residual[i])
            slope[i, 0], slope[i, 1], slope[i, 2] = dx / distance, dy / distance, 1.0
        scale = max(0.1, SIGMA_PER_MEDIAN * median_in_loops(away))
        normal[:], change[:] = 0, 0
        for i in range(x_px.size):
            inside = max(1 - (residual[i] / (4.0 * scale)) ** 2, 0.0)
            weight = inside * inside
            for j in range(3):
                change[j] += weight * slope[i, j] * residual[i]
                for k in range(3):
                    normal[j, k] += weight * slope[i, j] * slope[i, k]
        for j in range(3):
            normal[j, j] += 1e-9
        solve(normal, change)
        for j in range(3):
            circle[j] += change[j]
        if max(abs(change[0]), abs(change[1]), abs(change[2])) < 1e-4:
            break


def describe(image: Image, dark: float, ring: Ring) -> Ring:
    """Return ``ring`` with its contrast, coverage and visible part measured in ``image`` of that :func:`dark_level`."""
    reach = _reach(image)
    radii = np.arange(max(1.0, ring.radius_px - 2 * reach), ring.radius_px + 2 * reach + 1)
    response, inside = _response(image, dark, ring.x_px, ring.y_px, radii, ring.rising)
    at = int(np.argmin(np.abs(radii - ring.radius_px)))
    near = response[:, max(0, at - 1) : at + 2].max(axis=1)
    seen = inside[:, at]
    if seen.sum() < 8:
        return replace(ring, contrast=0.0, coverage=0.0, visible=float(seen.mean()))
    near = np.clip(near[seen], -MOST_CONTRAST, MOST_CONTRAST)
    coverage = float(np.mean(near > 0.15))
    return replace(ring, contrast=float(near.mean()), coverage=coverage, visible=float(seen.mean()))


def without_thin_lines(image: Image) -> Image:
    """Return ``image`` without bright lines and spots narrower than a thirtieth of its shorter side; steps stay."""
    size = 2 * round(0.8 * _reach(image)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.morphologyEx(image, cv2.MORPH_OPEN, disc), dtype=np.float32)


def dark_level(image: Image) -> float:
    """Return what is added to the brightness of ``image`` before logarithms are taken, so that noise counts little.

    It is measured on every fourth pixel, which is enough.
    """
    return 0.05 * max(quantile(image[::2, ::2], 0.95), 1e-6)


def lasting_contrast(image: Image, ring: Ring) -> float:
    """Return the log ratio of the brightness well outside ``ring`` to that just inside it, median over the rays.

    Well outside is beyond the width of a bright line, so that it is small for the inner edge of such a line.
    """
    reach = _reach(image)
    levels = []
    for nearest, farthest in ((-1.0, -0.4), (1.5, 3.0)):
        radii = ring.radius_px + reach * np.linspace(nearest, farthest, 9)
        profile, inside = rays(image, ring.x_px, ring.y_px, np.maximum(radii, 0.0))
        levels.append(np.median(np.where(inside, profile, np.nan), axis=1))
    dark = dark_level(image)
    ratio = np.log((levels[1] + dark) / (levels[0] + dark))
    seen = np.isfinite(ratio)
    return float(np.median(ratio[seen])) * (1 if ring.rising else -1) if seen.any() else 0.0


def _reach(image: Image) -> float:
    return max(2.0, 0.02 * float(min(image.shape)))


def _response(
    image: Image, dark: float, x_px: float, y_px: float, radii_px: Coordinates, rising: bool
) -> tuple[Image, Mask]:
    """Return how much brighter (log ratio) it is on one side of each sample of each ray than on the other."""
    profile, inside = rays(image, x_px, y_px, radii_px, TRACE_RAYS)
    light = np.log(profile + dark)
    light = gaussian_filter1d(light, 1.5, axis=0, mode="wrap")
    width = max(2, round(_reach(image)))
    mean = uniform_filter1d(light, width, axis=1, mode="nearest")
    beyond, before = np.roll(mean, -(width // 2 + 1), axis=1), np.roll(mean, (width + 1) // 2, axis=1)
    beyond[:, -(width // 2 + 1) :] = mean[:, -1:]
    before[:, : (width + 1) // 2] = mean[:, :1]
    difference = beyond - before
    # an edge needs both its sides inside the image
    both = np.roll(inside, -width, axis=1) & np.roll(inside, width, axis=1) & inside
    both[:, :width] = inside[:, :width]
    return np.asarray(difference if rising else -difference, dtype=np.float32), both


def _retrace(image: Image, dark: float, ring: tuple[float, float, float], rising: bool) -> tuple[float, float, float]:
    """Trace a ring again around its own centre, near its own radius."""
    x, y, radius = ring
    reach = 3 * _reach(image)
    radii = np.arange(max(1.0, radius - reach), radius + reach)
    response, inside = _response(image, dark, x, y, radii, rising)
    path = radii[
        trace_closed(np.where(inside, np.clip(response, 0, MOST_CONTRAST), 0.0).astype(np.float32), most_step=1)
    ]
    seen = _visible(inside, radii, path)
    if seen.sum() < FEWEST_POINTS:
        return ring
    return fit_circle(*_points(x, y, path, seen), ring)


def _visible(inside: Mask, radii: Coordinates, path: Coordinates) -> Mask:
    return np.asarray(inside[np.arange(path.size), np.searchsorted(radii, path).clip(0, radii.size - 1)])


def _points(x: float, y: float, path: Coordinates, visible: Mask) -> tuple[Coordinates, Coordinates]:
    angle = 2 * np.pi / path.size * np.arange(path.size)
    return (x + path * np.cos(angle))[visible], (y + path * np.sin(angle))[visible]


def _distances(ring: tuple[float, float, float], x: float, y: float, n_rays: int) -> Coordinates:
    """Return how far a circle is from (x, y) along each ray, float64 (n_rays, 1); NaN where a ray misses it."""
    angle = 2 * np.pi / n_rays * np.arange(n_rays)[:, None]
    dx, dy = ring[0] - x, ring[1] - y
    along, across = dx * np.cos(angle) + dy * np.sin(angle), dx * np.sin(angle) - dy * np.cos(angle)
    room = ring[2] ** 2 - across**2
    return np.where(room > 0, along + np.sqrt(np.maximum(room, 0)), np.nan)
