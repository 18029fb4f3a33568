"""Where the samples of a panorama lie on the wall, and which of them a pixel shows."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.resample import FARTHEST_ROW
from endoct.stitching.arrays import Coordinates
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.wall import Pixels, Wall

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Placing:
    """Rows and columns of a panorama on the wall, in the order of ascending z and θ.

    ``row_mm`` float64 (n_z,), ascending: centres of rows; ``row_height_mm`` the typical distance of two. Column j, for
    every whole j, has its centre at ``theta0_rad`` + j · ``dtheta_rad``; there are ``n_theta`` around. Where
    ``z_reversed`` the first row is the last one stored, and where ``mirrored`` column j is stored as column −j.
    """

    row_mm: Coordinates
    row_height_mm: float
    n_theta: int
    theta0_rad: float
    mirrored: bool = False
    z_reversed: bool = False

    @property
    def dtheta_rad(self) -> float:
        """Distance of two columns, rad."""
        return 2 * math.pi / self.n_theta

    def dtheta_mm(self, radius_mm: float) -> float:
        """Return the distance of two columns on the wall, mm."""
        return self.dtheta_rad * radius_mm

    def stored_row(self, row: int) -> int:
        """Return where row ``row``, counted along z, is stored."""
        return self.row_mm.size - 1 - row if self.z_reversed else row

    def stored_column(self, column: int) -> int:
        """Return where column ``column``, any whole number along θ, is stored."""
        return (-column if self.mirrored else column) % self.n_theta


def placing_of(grid: SurfaceGrid, where: Alignment | None = None) -> Placing:
    """Return where the samples on ``grid`` lie, moved by ``where`` into the frame that the wall is shown in."""
    if where is None:
        return Placing(grid.z_mm, grid.dz_mm, grid.n_theta, grid.theta0_rad)
    row_mm = where.z_to_a(grid.z_mm)
    return Placing(
        row_mm=row_mm[::-1] if where.z_reversed else row_mm,
        row_height_mm=abs(where.z_scale) * grid.dz_mm,
        n_theta=grid.n_theta,
        theta0_rad=where.theta_shift_rad + (-1 if where.mirrored else 1) * grid.theta0_rad,
        mirrored=where.mirrored,
        z_reversed=where.z_reversed,
    )


@dataclass(frozen=True, eq=False)
class Spans:
    """Samples that each pixel of an axis shows: from ``start`` to before ``stop``, int64 (n,); none where equal."""

    start: Indices
    stop: Indices


def row_spans(placing: Placing, wall: Wall, level: int, pixels: Pixels) -> Spans:
    """Return the rows, counted along z, whose centres lie in every row of ``pixels``.

    Where there is none the nearest is shown, as long as its own height reaches so far.
    """
    edges_mm = wall.top_mm + wall.pixel_mm(level) * np.arange(pixels.rows[0], pixels.rows[1] + 1)
    row_mm, half_mm = placing.row_mm, placing.row_height_mm / 2
    bounds = np.searchsorted(row_mm, edges_mm - 1e-9)
    start, stop = bounds[:-1].astype(np.int64), bounds[1:].astype(np.int64)
    middle_mm = (edges_mm[:-1] + edges_mm[1:]) / 2
    after = np.clip(np.searchsorted(row_mm, middle_mm), 1, row_mm.size - 1) if row_mm.size > 1 else np.zeros(1, int)
    before = np.maximum(after - 1, 0)
    nearest = np.where(middle_mm - row_mm[before] <= row_mm[after] - middle_mm, before, after)
    reach_mm = np.abs(row_mm[nearest] - middle_mm)
    beyond = (middle_mm < row_mm[0] - half_mm) | (middle_mm > row_mm[-1] + half_mm)
    shown = (reach_mm <= 2 * FARTHEST_ROW * half_mm) & ~beyond
    return _filled(start, stop, nearest.astype(np.int64), shown)


def column_spans(placing: Placing, wall: Wall, level: int, pixels: Pixels) -> Spans:
    """Return the columns, any whole numbers along θ, whose centres lie in every column of ``pixels``, else the nearest.

    Columns j and j + n are the same.
    """
    edges_rad = 2 * math.pi / wall.width_px(level) * np.arange(pixels.columns[0], pixels.columns[1] + 1)
    places = (edges_rad - placing.theta0_rad) / placing.dtheta_rad
    bounds = np.ceil(places - 1e-6).astype(np.int64)
    nearest = np.floor((places[:-1] + places[1:]) / 2 + 0.5).astype(np.int64)
    return _filled(bounds[:-1], bounds[1:], nearest, np.ones(nearest.shape, np.bool_))


def _filled(start: Indices, stop: Indices, nearest: Indices, shown: NDArray[np.bool_]) -> Spans:
    """Return the spans with the nearest sample where they are empty, if it is ``shown``."""
    empty = start >= stop
    start = np.where(empty, nearest, start)
    return Spans(start, np.where(empty, start + shown, stop))
