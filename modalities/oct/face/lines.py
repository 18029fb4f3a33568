"""Bright lines with darkness behind them in one reduced B-scan: sheath, inner and outer face of the capillary."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.modalities.oct.face.enhance import equalise, local_threshold, wavelet_denoise
from endoct.modalities.oct.face.sine import circle_distance_mm
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Coordinates, Image, Mask

MOST_LINES = 10
POINTS_PER_COLUMN = 8
LEAST_SUPPORT = 0.12
SCORED_COLUMNS = 64
WEAKEST_POINT_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class Points:
    """Points on bright lines: ``angle_rad``, ``depth_mm`` (from depth sample 0), ``strength`` 0…1, each (n,)."""

    angle_rad: Coordinates
    depth_mm: Coordinates
    strength: Coordinates


def line_points(image: Image, angle_rad: Coordinates, mm_per_px: float, parameters: OctParameters) -> Points:
    """Return where a reduced logarithmic B-scan, float32 (θ, depth), shows a line with darkness behind it.

    The image is enhanced as in the paper; of what remains above the local threshold, each A-scan's ridges count.
    """
    denoised = wavelet_denoise(image, parameters.denoise_threshold)
    equal = equalise(denoised, parameters.clahe_clip_limit, parameters.clahe_tile_mm / mm_per_px)
    bright = local_threshold(equal, parameters.threshold_window_mm / mm_per_px)
    ridge = _ridge(denoised, mm_per_px)
    noise = 1.4826 * float(np.median(np.abs(ridge - np.median(ridge))))
    peak = np.zeros_like(bright)
    peak[:, 1:-1] = (ridge[:, 1:-1] >= ridge[:, :-2]) & (ridge[:, 1:-1] > ridge[:, 2:])
    height = np.where(peak & bright & (ridge > WEAKEST_POINT_SIGMAS * noise), ridge, 0.0)
    kth = np.partition(height, -POINTS_PER_COLUMN, axis=1)[:, -POINTS_PER_COLUMN, None]
    column, row = np.nonzero((height > 0) & (height >= kth))
    before, here, after = ridge[column, row - 1], ridge[column, row], ridge[column, row + 1]
    shift = 0.5 * (before - after) / np.minimum(before - 2 * here + after, -1e-9)
    strength = np.minimum(1.0, height[column, row] / (4 * WEAKEST_POINT_SIGMAS * max(noise, 1e-9)))
    return Points(angle_rad[column], (row + np.clip(shift, -0.5, 0.5)) * mm_per_px, strength.astype(np.float64))


def _ridge(image: Image, mm_per_px: float) -> Image:
    """How much brighter than behind it, and by half its weight than before it, each sample is."""
    half, near, far = round(0.004 / mm_per_px), max(2, round(0.018 / mm_per_px)), max(5, round(0.055 / mm_per_px))
    n = image.shape[1]
    total = np.concatenate([np.zeros((image.shape[0], 1)), np.cumsum(image, axis=1, dtype=np.float64)], axis=1)

    def mean(first: int, last: int) -> Coordinates:
        low, high = np.clip(np.arange(n) + first, 0, n - 1), np.clip(np.arange(n) + last, 0, n - 1)
        return np.asarray((total[:, high + 1] - total[:, low]) / (high + 1 - low))

    here = mean(-half, half)
    behind, before = here - mean(near, far), here - mean(-far, -near)
    ridge = 0.5 * behind + 0.5 * np.minimum(behind, before)
    ridge[:, n - far :] = 0
    return np.asarray(ridge, dtype=np.float32)


def find_lines(
    points: Points,
    angle_rad: Coordinates,
    depth_mm: float,
    mm_per_px: float,
    radius_mm: float,
    trials: int,
    rng: Generator,
) -> Coordinates:
    """Return the lines through ``points`` as circles seen from off their axis, strongest first.

    float64 (n_lines, 4): offset x and y, depth of the axis (where ρ = 0), mm, and the support: the mean strength
    of points on the line over all A-scans. Random sample consensus, one line after another.
    """
    step = 2 * np.pi / angle_rad.size
    column = np.round((points.angle_rad - angle_rad[0]) / step).astype(np.intp) % angle_rad.size
    row = np.round(points.depth_mm / mm_per_px).astype(np.intp)
    n_rows = int(np.ceil(depth_mm / mm_per_px)) + 1
    evidence = np.zeros((angle_rad.size, n_rows), np.float32)
    evidence[column, np.minimum(row, n_rows - 1)] = points.strength
    circles = _circles_through_triples(points, column, angle_rad.size, radius_mm, trials, rng)
    if not circles.size:
        return np.empty((0, 4))
    scored = np.linspace(0, angle_rad.size, SCORED_COLUMNS, endpoint=False).astype(int)
    rows = np.round(
        (circles[:, 2:] + circle_distance_mm(angle_rad[scored], circles[:, :1], circles[:, 1:2], radius_mm)) / mm_per_px
    ).astype(int)
    inside = (rows >= 2) & (rows < n_rows - 2)
    rows = np.clip(rows, 0, n_rows - 1)
    left = np.ones(points.strength.size, bool)
    found: list[tuple[float, float, float, float]] = []
    for _ in range(MOST_LINES):
        wide = evidence.copy()
        for shift in (1, 2):
            wide[:, shift:] = np.maximum(wide[:, shift:], evidence[:, :-shift])
            wide[:, :-shift] = np.maximum(wide[:, :-shift], evidence[:, shift:])
        support = np.where(inside, wide[scored, rows], 0).mean(axis=1)
        best = int(np.argmax(support))
        if support[best] < LEAST_SUPPORT:
            break
        x, y, zero = fit_circle(points, left, circles[best, :3], radius_mm, width_mm=3 * mm_per_px)
        distance = circle_distance_mm(points.angle_rad, x, y, radius_mm)
        on = left & (np.abs(points.depth_mm - zero - distance) < 3.5 * mm_per_px)
        if np.hypot(x, y) < 0.8 * radius_mm:
            found.append((x, y, zero, float(points.strength[on].sum() / angle_rad.size)))
        left &= ~on
        evidence[column[on], np.minimum(row[on], n_rows - 1)] = 0
        if not on.any():
            break
    return np.asarray(found).reshape(-1, 4)


def fit_circle(
    points: Points,
    use: Mask,
    start: Coordinates,
    radius_mm: float,
    *,
    width_mm: float,
    zero_mm: float | None = None,
    zero_sigma_points: float = 0.0,
) -> tuple[float, float, float]:
    """Return offset x, y and depth of the axis, mm, of the circle near ``start`` through the points in ``use``.

    Reweighted least squares with Tukey's weights of half width ``width_mm``. ``zero_mm`` is an expectation of
    the axis' depth that counts as much as ``zero_sigma_points`` points.
    """
    x, y, zero = (float(v) for v in start)
    angle, depth = points.angle_rad[use], points.depth_mm[use]
    cosine, sine = np.cos(angle), np.sin(angle)
    for _ in range(8):
        residual = depth - zero - circle_distance_mm(angle, x, y, radius_mm)
        weight = np.maximum(1 - (residual / width_mm) ** 2, 0) ** 2 * points.strength[use]
        if np.count_nonzero(weight) < 6:
            break
        across = x * sine - y * cosine
        slope = across / np.sqrt(np.maximum(radius_mm**2 - across**2, 1e-6))
        jacobian = np.stack([-cosine - slope * sine, -sine + slope * cosine, np.ones_like(angle)], axis=1)
        normal = jacobian.T @ (weight[:, None] * jacobian) + 1e-6 * np.eye(3)
        gradient = jacobian.T @ (weight * residual)
        if zero_mm is not None:
            normal[2, 2] += zero_sigma_points
            gradient[2] += zero_sigma_points * (zero_mm - zero)
        step = np.linalg.solve(normal, gradient)
        x, y, zero = x + step[0], y + step[1], zero + step[2]
        if np.hypot(x, y) > 0.9 * radius_mm:
            return float(start[0]), float(start[1]), float(start[2])
    return float(x), float(y), float(zero)


def _circles_through_triples(
    points: Points, column: NDArray[np.intp], n_columns: int, radius_mm: float, trials: int, rng: Generator
) -> Coordinates:
    """Circles through three points about a third of a turn apart, float64 (n, 3): x, y, depth of the axis."""
    if points.strength.size < 30:
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
    for _ in range(2):  # the square root's departure from R_c is of second order: iterate
        inside = np.hypot(circle[:, 0], circle[:, 1]) < 0.8 * radius_mm
        circle, matrix, angle, depth = circle[inside], matrix[inside], angle[inside], depth[inside]
        across = circle[:, :1] * np.sin(angle) - circle[:, 1:2] * np.cos(angle)
        root = np.sqrt(np.maximum(radius_mm**2 - across**2, 0))
        circle = np.linalg.solve(matrix, (depth - root)[..., None])[..., 0]
    return np.asarray(circle[np.hypot(circle[:, 0], circle[:, 1]) < 0.8 * radius_mm])
