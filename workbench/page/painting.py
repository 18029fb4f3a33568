"""What was painted on a wall, as a mask: strokes of a brush and polygons, in mm and rad, on the circle of θ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import fill
from endoct.modalities.acquisition import MOST_PLACE_MM
from endoct.stitching.grid import SurfaceGrid

MOST_SHAPES, MOST_POINTS = 5000, 20_000
MOST_RADIUS_MM = 2.0
MOST_TURNS = 3
LARGEST = 1e9
"""Of any number; a larger one is no float, or none that means a place."""
MOST_STROKED = 400_000_000
"""Samples that all strokes of a drawing look at: some seconds."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A stroke of a brush with ``radius_mm``, or a polygon where that is None; it ``adds`` cell, or takes it away.

    ``points``: float64 (n, 2), θ in rad, which runs on over the seam, and z in mm, in the frame of the side.
    """

    points: Coordinates
    adds: bool
    radius_mm: float | None


def shapes_from(posted: object) -> tuple[Shape, ...]:
    """Return shapes as a page sends them. Raises :class:`EndoctError` for anything else."""
    if not isinstance(posted, list) or len(posted) > MOST_SHAPES:
        raise EndoctError("what was drawn cannot be used", expected=f"{MOST_SHAPES} shapes at most")
    return tuple(_shape(each) for each in posted)


def painted(shapes: Sequence[Shape], grid: SurfaceGrid, ground: Mask | None = None) -> Mask:
    """Return ``ground``, bool (n_z, n_theta), nothing where None, with ``shapes`` painted on it, one over the other."""
    mask = np.zeros(grid.shape, np.bool_) if ground is None else ground.copy()
    for shape in shapes:
        if shape.radius_mm is None:
            rows = np.interp(shape.points[:, 1], grid.z_mm, np.arange(grid.n_z), left=-1, right=grid.n_z)
            columns = (shape.points[:, 0] - grid.theta0_rad) / grid.dtheta_rad
            mask[fill(np.stack([rows, columns], axis=1), grid.shape)] = shape.adds
        else:
            _stroke(mask, shape.points, shape.radius_mm, grid, shape.adds)
    return mask


def _stroke(mask: Mask, points: Coordinates, radius_mm: float, grid: SurfaceGrid, value: bool) -> None:
    """Set what lies within ``radius_mm`` of the line through ``points`` on the wall.

    Raises :class:`EndoctError` for a stroke so long that nobody drew it.
    """
    z_mm, step_mm = grid.z_mm, grid.dtheta_mm
    line = np.stack([(points[:, 0] - grid.theta0_rad) * grid.radius_mm, points[:, 1]], axis=1)
    pieces = _pieces(line, radius_mm)
    low, high = pieces.min(axis=1) - radius_mm, pieces.max(axis=1) + radius_mm
    samples = np.prod(np.ceil((high - low) / (step_mm, grid.dz_mm)), axis=1)
    if samples.sum() > MOST_STROKED:
        raise EndoctError("a stroke is too long for its radius", expected="several shorter ones, or an outline")
    for (start, end), (left, top), (right, bottom) in zip(pieces, low, high, strict=True):
        rows = slice(*np.searchsorted(z_mm, [top, bottom]))
        columns = np.arange(int(np.ceil(left / step_mm)), int(np.floor(right / step_mm)) + 1)
        along = end - start
        x = columns[None, :] * step_mm - start[0]
        y = z_mm[rows, None] - start[1]
        share = np.clip((x * along[0] + y * along[1]) / max(float(along @ along), 1e-12), 0, 1)
        near = np.hypot(x - share * along[0], y - share * along[1]) <= radius_mm
        row, column = np.nonzero(near)
        mask[row + rows.start, columns[column] % grid.n_theta] = value


def _pieces(line: Coordinates, radius_mm: float) -> Coordinates:
    """Return a line, float64 (n, 2) in mm, as pieces (m, 2, 2) no longer than the brush is wide.

    Points that change its course by less than a twentieth of the radius are left out.
    """
    course = cv2.approxPolyDP(line.astype(np.float32), radius_mm / 20, closed=False)[:, 0].astype(np.float64)
    course = line[:1] if len(line) == 1 else np.concatenate([line[:1], course[1:-1], line[-1:]])
    if len(course) == 1:
        return np.stack([course, course], axis=1)
    lengths_mm = np.hypot(*np.diff(course, axis=0).T)
    counts = np.maximum(1, np.ceil(lengths_mm / (2 * radius_mm)))
    if counts.sum() > MOST_POINTS:
        raise EndoctError("a stroke is too long for its radius", expected="several shorter ones, or an outline")
    ends = [np.linspace(one, other, int(n) + 1) for one, other, n in zip(course[:-1], course[1:], counts, strict=True)]
    return np.concatenate([np.stack([points[:-1], points[1:]], axis=1) for points in ends])


def _shape(posted: Any) -> Shape:
    if not isinstance(posted, Mapping) or not isinstance(posted.get("adds"), bool):
        raise EndoctError("what was drawn cannot be used", found=repr(posted)[:80], expected="a stroke or a polygon")
    radius_mm = posted.get("radius_mm")
    if radius_mm is not None and not (_is_number(radius_mm) and 0 < radius_mm <= MOST_RADIUS_MM):
        raise EndoctError("a brush cannot be used", found=repr(radius_mm)[:40], expected=f"up to {MOST_RADIUS_MM:g} mm")
    points = posted.get("points")
    listed = points if isinstance(points, list) and len(points) <= MOST_POINTS else []
    if not listed or not all(map(_is_point, listed)):
        raise EndoctError("a shape has points that cannot be used", expected=f"1 to {MOST_POINTS} of θ and z")
    places = np.asarray(listed, np.float64)
    farthest = np.abs(places).max(axis=0)
    if not np.isfinite(places).all() or farthest[0] > MOST_TURNS * 2 * np.pi or farthest[1] > MOST_PLACE_MM:
        raise EndoctError("a shape lies far outside the wall", found=f"{farthest[0]:g} rad, {farthest[1]:g} mm")
    if radius_mm is None and len(places) < 3:
        raise EndoctError("an outline encloses nothing", found=f"{len(places)} points", expected="three at least")
    return Shape(places, posted["adds"], None if radius_mm is None else float(radius_mm))


def _is_point(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
