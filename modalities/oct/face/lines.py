"""Bright lines in one reduced B-scan: the catheter's sheath, the inner and the outer face of the capillary.

Each is taken for a circle of the capillary's radius, seen from off its axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.modalities.oct.bscan import Raster
from endoct.modalities.oct.face.circle import Circle, circle_distance_mm
from endoct.modalities.oct.face.points import Points, tukey_weight
from endoct.stitching.arrays import Coordinates, Image, Mask

MOST_LINES = 10
LEAST_SUPPORT = 0.12
SCORED_COLUMNS = 64
FARTHEST = 0.8  # of the radius: an offset of the catheter beyond that is no fit
LEAST_POINTS = 30


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one slice or of several, as circles of one radius.

    Attributes: ``x_mm``, ``y_mm``, ``axis_depth_mm``, float64 (n,), see :class:`Circle`; ``support``, float64 (n,), the
    mean strength of the points on each line over all columns; ``radius_mm``.
    """

    x_mm: Coordinates
    y_mm: Coordinates
    axis_depth_mm: Coordinates
    support: Coordinates
    radius_mm: float

    @classmethod
    def of(cls, circles: Sequence[Circle], support: Sequence[float], radius_mm: float) -> "Lines":
        """Return the lines of ``circles`` with their ``support``."""
        rows = [(circle.x_mm, circle.y_mm, circle.axis_depth_mm) for circle in circles]
        x, y, depth = np.array(rows, dtype=np.float64).reshape(-1, 3).T.copy()
        return cls(x, y, depth, np.array(support, dtype=np.float64), radius_mm)

    @classmethod
    def together(cls, several: Sequence["Lines"]) -> "Lines":
        """Return the lines of several slices, one after the other."""
        return cls(
            np.concatenate([lines.x_mm for lines in several]),
            np.concatenate([lines.y_mm for lines in several]),
            np.concatenate([lines.axis_depth_mm for lines in several]),
            np.concatenate([lines.support for lines in several]),
            several[0].radius_mm,
        )

    def __len__(self) -> int:
        return self.support.size

    @property
    def offset_mm(self) -> Coordinates:
        """Distance of the catheter from each line's axis, float64 (n,), mm."""
        return np.hypot(self.x_mm, self.y_mm)

    def circle(self, k: int) -> Circle:
        """Return the circle of one line."""
        return Circle(float(self.x_mm[k]), float(self.y_mm[k]), float(self.axis_depth_mm[k]), self.radius_mm)

    def where(self, good: Mask) -> "Lines":
        """Return the lines that are ``good``, bool (n,)."""
        return Lines(self.x_mm[good], self.y_mm[good], self.axis_depth_mm[good], self.support[good], self.radius_mm)

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
        return Lines.of([], [], radius_mm)
    scored = np.linspace(0, angle_rad.size, SCORED_COLUMNS, endpoint=False).astype(int)
    rows = np.round(
        (circles[:, 2:] + circle_distance_mm(angle_rad[scored], circles[:, :1], circles[:, 1:2], radius_mm)) / mm_per_px
    ).astype(int)
    inside = (rows >= 2) & (rows < n_rows - 2)
    rows = np.clip(rows, 0, n_rows - 1)
    left = np.ones(len(points), bool)
    lines: list[Circle] = []
    supports: list[float] = []
    for _ in range(MOST_LINES):
        support = np.where(inside, _widened(strength)[scored, rows], 0).mean(axis=1)
        best = int(np.argmax(support))
        if support[best] < LEAST_SUPPORT:
            break
        x, y, depth = (float(value) for value in circles[best])
        line = fit_circle(points.where(left), Circle(x, y, depth, radius_mm), width_mm=3 * mm_per_px)
        on = left & (np.abs(points.beyond_mm(line)) < 3.5 * mm_per_px)
        if line.offset_mm < FARTHEST * radius_mm:
            lines.append(line)
            supports.append(float(points.strength[on].sum() / angle_rad.size))
        left &= ~on
        strength[column[on], np.minimum(row[on], n_rows - 1)] = 0
        if not on.any():
            break
    return Lines.of(lines, supports, radius_mm)


def _widened(strength: Image) -> Image:
    """The largest of each sample and of its two neighbours before and behind it."""
    wide = strength.copy()
    for shift in (1, 2):
        wide[:, shift:] = np.maximum(wide[:, shift:], strength[:, :-shift])
        wide[:, :-shift] = np.maximum(wide[:, :-shift], strength[:, shift:])
    return wide


def fit_circle(
    points: Points,
    start: Circle,
    *,
    width_mm: float,
    axis_depth_mm: float | None = None,
    axis_weight: float = 0.0,
) -> Circle:
    """Return the circle near ``start``, of its radius, through ``points``.

    Reweighted least squares with Tukey's weights of half width ``width_mm``. ``axis_depth_mm`` is an expectation of
    the axis' depth that counts as much as ``axis_weight`` points.
    """
    x, y, depth, radius_mm = start.x_mm, start.y_mm, start.axis_depth_mm, start.radius_mm
    cosine, sine = np.cos(points.angle_rad), np.sin(points.angle_rad)
    for _ in range(8):
        residual = points.beyond_mm(Circle(x, y, depth, radius_mm))
        weight = tukey_weight(residual, width_mm) * points.strength
        if np.count_nonzero(weight) < 6:
            break
        across = x * sine - y * cosine
        slope = across / np.sqrt(np.maximum(radius_mm**2 - across**2, 1e-6))
        jacobian = np.stack([-cosine - slope * sine, -sine + slope * cosine, np.ones_like(cosine)], axis=1)
        normal = jacobian.T @ (weight[:, None] * jacobian) + 1e-6 * np.eye(3)
        gradient = jacobian.T @ (weight * residual)
        if axis_depth_mm is not None:
            normal[2, 2] += axis_weight
            gradient[2] += axis_weight * (axis_depth_mm - depth)
        step = np.linalg.solve(normal, gradient)
        x, y, depth = x + step[0], y + step[1], depth + step[2]
        if np.hypot(x, y) > 0.9 * radius_mm:
            return start
    return Circle(float(x), float(y), float(depth), radius_mm)


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
    angle, depth = points.angle_rad[index], points.depth_mm[index]
    matrix = np.stack([-np.cos(angle), -np.sin(angle), np.ones(angle.shape)], axis=-1)
    circle = np.linalg.solve(matrix, depth[..., None])[..., 0]
    for _ in range(2):  # the square root departs from the radius in second order only: iterate
        inside = np.hypot(circle[:, 0], circle[:, 1]) < FARTHEST * radius_mm
        circle, matrix, angle, depth = circle[inside], matrix[inside], angle[inside], depth[inside]
        across = circle[:, :1] * np.sin(angle) - circle[:, 1:2] * np.cos(angle)
        root = np.sqrt(np.maximum(radius_mm**2 - across**2, 0))
        circle = np.linalg.solve(matrix, (depth - root)[..., None])[..., 0]
    return np.asarray(circle[np.hypot(circle[:, 0], circle[:, 1]) < FARTHEST * radius_mm])
