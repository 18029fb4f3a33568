"""Bright lines in one reduced B-scan: the catheter's sheath, the inner and the outer face of the capillary.

Each is taken for a circle of the capillary's radius, seen from off its axis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve
from endoct.modalities.oct.bscan import Raster
from endoct.modalities.oct.face.face_circle import Circle, Circles
from endoct.modalities.oct.face.points import Points

MOST_LINES = 10
LEAST_SUPPORT = 0.12
SCORED_COLUMNS = 64
FARTHEST = 0.8  # of the radius: an offset of the catheter beyond that is no fit
LEAST_POINTS = 30


@dataclass(frozen=True, eq=False)
class Lines(Circles):
    """Lines of one slice or of several, as circles.

    ``support``, float64 (n,): the mean strength of the points on each line over all columns.
    """

    support: Coordinates

    @classmethod
    def together(cls, several: Sequence["Lines"]) -> "Lines":
        """Return the lines of several slices, one after the other."""
        return cls(
            np.concatenate([lines.x_mm for lines in several]),
            np.concatenate([lines.y_mm for lines in several]),
            np.concatenate([lines.axis_depth_mm for lines in several]),
            several[0].radius_mm,
            np.concatenate([lines.support for lines in several]),
        )

    def where(self, good: Mask) -> "Lines":
        """Return the lines that are ``good``, bool (n,)."""
        return Lines(self.x_mm[good], self.y_mm[good], self.axis_depth_mm[good], self.radius_mm, self.support[good])

    def strongest_near(self, axis_depth_mm: float, within_mm: float) -> Circle | None:
        """Return the line of most support whose axis lies ``within_mm`` of ``axis_depth_mm``; None where none does."""
        near = self.where(np.abs(self.axis_depth_mm - axis_depth_mm) < within_mm)
        return near.circle(int(np.argmax(near.support))) if len(near) else None


def find_lines(points: Points, raster: Raster, radius_mm: float, trials: int, rng: Generator) -> Lines:
    """Return the lines through ``points`` as circles of ``radius_mm``, by random sample consensus one after another."""
    angle_rad, mm_per_px = raster.angle_rad, raster.mm_per_px
    step = 2 * np.pi / angle_rad.size
    column = np.round((points.angle_rad - angle_rad[0]) / step).astype(np.intp) % angle_rad.size
    row = np.round(points.depth_mm / mm_per_px).astype(np.intp)
    n_rows = int(np.ceil(raster.depth_mm / mm_per_px)) + 1
    strength = np.zeros((angle_rad.size, n_rows), np.float32)
    strength[column, np.minimum(row, n_rows - 1)] = points.strength
    circles = _circles_through_triples(points, column, angle_rad.size, radius_mm, trials, rng)
    if not circles.size:
        nothing = np.empty(0)
        return Lines(nothing, nothing, nothing, radius_mm, nothing)
    scored = np.linspace(0, angle_rad.size, SCORED_COLUMNS, endpoint=False).astype(int)
    cosine, sine = np.cos(angle_rad[scored]), np.sin(angle_rad[scored])
    rows = _rows_of_circles(circles, cosine, sine, radius_mm, mm_per_px, n_rows)
    found = _strongest(
        circles,
        _Crossings(scored, rows),
        strength,
        (column, np.minimum(row, n_rows - 1)),
        _beams_to(points),
        radius_mm,
        mm_per_px,
    )
    x, y, depth, support = found.T.copy()
    return Lines(x, y, depth, radius_mm, support)


class _Beams(NamedTuple):
    """Points as beams that end there, each (n,): cosine and sine of their directions, depths, and strengths."""

    cosine: Coordinates
    sine: Coordinates
    depth_mm: Coordinates
    strength: Coordinates


class _Crossings(NamedTuple):
    """At which ``rows`` (n_circles, n_columns) circles cross the ``columns`` (n_columns,) of a B-scan; −1: at none."""

    columns: NDArray[np.intp]
    rows: NDArray[np.int32]


def _beams_to(points: Points) -> _Beams:
    """The beams to ``points``, with strengths of their own."""
    return _Beams(np.cos(points.angle_rad), np.sin(points.angle_rad), points.depth_mm, points.strength.copy())


@compiled
def _strongest(
    circles: Coordinates,
    crossings: _Crossings,
    strength: Image,
    places: tuple[NDArray[np.intp], NDArray[np.intp]],
    beams: _Beams,
    radius_mm: float,
    mm_per_px: float,
) -> Coordinates:
    """Lines, one after another the strongest that is left: x, y, depth of the axis and support, float64 (n, 4).

    ``crossings`` are those of ``circles`` in ``strength`` (column, row), where ``beams`` end at ``places``. What lies
    on a line is taken out of both.
    """
    lines = np.empty((MOST_LINES, 4))
    count = 0
    cosine, sine, depth_mm, left = beams
    column, row = places
    for _ in range(MOST_LINES):
        support = _support(strength, crossings)
        best = np.argmax(support)
        if support[best] < LEAST_SUPPORT:
            break
        circle = _fit(circles[best], beams, radius_mm, 3 * mm_per_px, 0.0, 0.0)
        x, y, axis = circle[0], circle[1], circle[2]
        total, none = 0.0, True
        for i in range(depth_mm.size):
            across = x * sine[i] - y * cosine[i]
            distance = math.sqrt(max(radius_mm**2 - across**2, 0.0)) - (x * cosine[i] + y * sine[i])
            if left[i] > 0 and abs(depth_mm[i] - axis - distance) < 3.5 * mm_per_px:
                total += left[i]
                left[i] = 0
                strength[column[i], row[i]] = 0
                none = False
        if math.hypot(x, y) < FARTHEST * radius_mm:
            lines[count, 0], lines[count, 1], lines[count, 2] = x, y, axis
            lines[count, 3] = total / len(strength)
            count += 1
        if none:
            break
    return lines[:count]


@compiled
def _rows_of_circles(
    circles: Coordinates, cosine: Coordinates, sine: Coordinates, radius_mm: float, mm_per_px: float, n_rows: int
) -> NDArray[np.int32]:
    """The rows, (n, n_columns), at which columns see ``circles`` (n, 3); −1 where that is at no row well inside."""
    rows = np.empty((len(circles), cosine.size), np.int32)
    for i in range(len(circles)):
        x, y, depth = circles[i, 0], circles[i, 1], circles[i, 2]
        for k in range(cosine.size):
            across = x * sine[k] - y * cosine[k]
            distance = np.sqrt(max(radius_mm**2 - across**2, 0.0)) - (x * cosine[k] + y * sine[k])
            row = np.rint((depth + distance) / mm_per_px)
            rows[i, k] = int(row) if 2 <= row < n_rows - 2 else -1
    return rows


@compiled
def _support(strength: Image, crossings: _Crossings) -> Image:
    """The mean of ``strength`` at each circle's ``crossings``, or up to two rows from there, float32 (n_circles,)."""
    scored, rows = crossings
    n_columns, n_rows = scored.size, strength.shape[1]
    wide = np.empty((n_columns, n_rows), np.float32)
    for column in range(n_columns):
        each = strength[scored[column]]
        for row in range(2, n_rows - 2):
            wide[column, row] = max(each[row], each[row - 2], each[row - 1], each[row + 1], each[row + 2])
    support = np.empty(len(rows), np.float32)
    part = np.empty(8, np.float32)
    for i in range(len(rows)):
        part[:] = 0
        for k in range(n_columns):
            if rows[i, k] >= 0:
                part[k % 8] += wide[k, rows[i, k]]
        total = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]))
        support[i] = total / np.float32(n_columns)
    return support


def fit_circle(
    points: Points, start: Circle, *, width_mm: float, axis_depth_mm: float | None = None, axis_weight: float = 0.0
) -> Circle:
    """Return the circle near ``start``, of its radius, through ``points``.

    Reweighted least squares with Tukey's weights of half width ``width_mm``. ``axis_depth_mm`` is an expectation of
    the axis' depth that counts as much as ``axis_weight`` points.
    """
    begin = np.array([start.x_mm, start.y_mm, start.axis_depth_mm])
    expected_mm, weight = (0.0, 0.0) if axis_depth_mm is None else (axis_depth_mm, axis_weight)
    x, y, depth = _fit(begin, _beams_to(points), start.radius_mm, width_mm, expected_mm, weight)
    return Circle(float(x), float(y), float(depth), start.radius_mm)


@compiled
def _fit(
    begin: Coordinates, beams: _Beams, radius_mm: float, width_mm: float, expected_mm: float, expected_weight: float
) -> Coordinates:
    """The circle's x, y and axis depth after reweighted least squares; ``begin`` where they leave the radius."""
    cosine, sine, depth_mm, strength = beams
    circle = begin.copy()
    matrix, step = np.empty((3, 3)), np.empty(3)
    for _ in range(8):
        x, y, axis = circle[0], circle[1], circle[2]
        n_used = 0
        matrix[:] = 0
        step[:] = 0
        for i in range(depth_mm.size):
            across = x * sine[i] - y * cosine[i]
            squared = radius_mm**2 - across**2
            distance = np.sqrt(max(squared, 0.0)) - (x * cosine[i] + y * sine[i])
            residual = depth_mm[i] - axis - distance
            share = 1 - (residual / width_mm) ** 2
            if share <= 0 or strength[i] == 0:
                continue
            n_used += 1
            weight = share**2 * strength[i]
            slope = across / np.sqrt(max(squared, 1e-6))
            by_x, by_y = -cosine[i] - slope * sine[i], -sine[i] + slope * cosine[i]
            matrix[0, 0] += weight * by_x * by_x
            matrix[0, 1] += weight * by_x * by_y
            matrix[0, 2] += weight * by_x
            matrix[1, 1] += weight * by_y * by_y
            matrix[1, 2] += weight * by_y
            matrix[2, 2] += weight
            step[0] += weight * residual * by_x
            step[1] += weight * residual * by_y
            step[2] += weight * residual
        if n_used < 6:
            break
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
        for k in range(3):
            matrix[k, k] += 1e-6
        matrix[2, 2] += expected_weight
        step[2] += expected_weight * (expected_mm - axis)
        solve(matrix, step)
        for k in range(3):
            circle[k] += step[k]
        if np.hypot(circle[0], circle[1]) > 0.9 * radius_mm:
            return begin
    return circle


def _circles_through_triples(
    points: Points, column: NDArray[np.intp], n_columns: int, radius_mm: float, trials: int, rng: Generator
) -> Coordinates:
    """Circles through three points about a third of a turn apart, float64 (n, 3): x, y, depth of the axis."""
    if len(points) < LEAST_POINTS:
        return np.empty((0, 3))
    order = np.argsort(column, kind="stable")
    start = np.searchsorted(column[order], np.arange(n_columns + 1))
    first = rng.integers(0, n_columns, trials)
    third = n_columns // 3
    spread = rng.integers(-third // 4, third // 4 + 1, (trials, 3))
    columns = (first[:, None] + third * np.arange(3) + spread) % n_columns
    count = start[columns + 1] - start[columns]
    full = (count > 0).all(axis=1)
    columns, count = columns[full], count[full]
    index = order[start[columns] + np.minimum((rng.random(columns.shape) * count).astype(int), count - 1)]
    angle = points.angle_rad[index]
    return _circles(np.cos(angle), np.sin(angle), points.depth_mm[index], radius_mm)


@compiled
def _circles(cosine: Coordinates, sine: Coordinates, depth_mm: Coordinates, radius_mm: float) -> Coordinates:
    """The circles through three points each, all arguments (n, 3), that are not too far off, (at most n, 3)."""
    circles = np.empty((len(depth_mm), 3))
    matrix, circle = np.empty((3, 3)), np.empty(3)
    count = 0
    for i in range(len(depth_mm)):
        for rounds in range(3):  # the square root departs from the radius in second order only: iterate
            for k in range(3):
                matrix[k, 0], matrix[k, 1], matrix[k, 2] = -cosine[i, k], -sine[i, k], 1
                if rounds:
                    across = circles[count, 0] * sine[i, k] - circles[count, 1] * cosine[i, k]
                    circle[k] = depth_mm[i, k] - np.sqrt(max(radius_mm**2 - across**2, 0.0))
                else:
                    circle[k] = depth_mm[i, k]
            solve(matrix, circle)
            for k in range(3):
                circles[count, k] = circle[k]
            if np.hypot(circle[0], circle[1]) >= FARTHEST * radius_mm:
                break
        else:
            count += 1
    return circles[:count]
