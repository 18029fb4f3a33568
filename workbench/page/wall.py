"""The wall as tiles: which part of it every tile shows, at every level, and which samples a pixel shows.

The wall is a cylinder unrolled, θ from 0 across, z down, in square pixels. At level k its circle is 256 · 2ᵏ pixels
wide. That is a whole number of tiles, so that tiles go on endlessly around it. Tiles reach one pixel into their
neighbours, around the circle too, so that no seam shows where they are drawn scaled.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import FARTHEST_ROW
from endoct.stitching.grid import SurfaceGrid

TILE_PX = 256
OVERLAP_PX = 1
FINEST_LEVEL = 8
"""It has 65 536 pixels around: a pixel of a 2.5 mm bore has 0.1 µm."""
Indices = NDArray[np.int64]


class NoSuchTile(EndoctError):
    """A tile, or a place, that the wall does not have."""


@dataclass(frozen=True)
class TileWall:
    """The cylinder that tiles show: ``radius_mm``, and z from ``top_mm`` down to ``bottom_mm``.

    Raises :class:`EndoctError` where it has no extent, or is so long that its tiles could not be counted.
    """

    radius_mm: float
    top_mm: float
    bottom_mm: float

    def __post_init__(self) -> None:
        length_mm = self.bottom_mm - self.top_mm
        if not (self.radius_mm > 0 and 0 < length_mm < 10_000 * self.radius_mm):
            found = f"{length_mm:g} mm at a radius of {self.radius_mm:g} mm"
            raise EndoctError("a wall cannot be shown", found=found, expected="a bore of some length")

    @property
    def circumference_mm(self) -> float:
        """Length of the circle, mm."""
        return 2 * math.pi * self.radius_mm

    def width_px(self, level: int) -> int:
        """Return how many pixels lie around the circle."""
        return TILE_PX << level

    def pixel_mm(self, level: int) -> float:
        """Return the side of a pixel, mm."""
        return self.circumference_mm / self.width_px(level)

    def height_px(self, level: int) -> int:
        """Return how many pixels lie along z; the last one may reach beyond the wall."""
        return math.ceil((self.bottom_mm - self.top_mm) / self.pixel_mm(level) - 1e-6)

    def rows_of_tiles(self, level: int) -> int:
        """Return how many rows of tiles show it."""
        return -(-self.height_px(level) // TILE_PX)

    def level_for(self, sample_mm: float) -> int:
        """Return the coarsest level whose pixels are no larger than ``sample_mm``, or the finest that there is."""
        level = math.ceil(math.log2(self.circumference_mm / (TILE_PX * sample_mm)) - 1e-6)
        return min(max(level, 0), FINEST_LEVEL)


@dataclass(frozen=True)
class Tile:
    """A tile: ``level``, and its ``column`` and ``row`` among the tiles of that level, from 0."""

    level: int
    column: int
    row: int


@dataclass(frozen=True)
class Pixels:
    """Pixels of a level, from first to before stop; columns may lie below 0 or beyond the circle, where θ goes on."""

    rows: tuple[int, int]
    columns: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]


def pixels_of(wall: TileWall, tile: Tile) -> Pixels:
    """Return the pixels of ``tile`` with those by which it reaches into its neighbours.

    Raises :class:`NoSuchTile` for a tile that ``wall`` does not have.
    """
    if not 0 <= tile.level <= FINEST_LEVEL:
        raise NoSuchTile("there is no such tile", found=f"level {tile.level}", expected=f"0 to {FINEST_LEVEL}")
    n_columns, n_rows = wall.width_px(tile.level) // TILE_PX, wall.rows_of_tiles(tile.level)
    if not (0 <= tile.column < n_columns and 0 <= tile.row < n_rows):
        found, expected = f"column {tile.column}, row {tile.row}", f"{n_columns} columns and {n_rows} rows of tiles"
        raise NoSuchTile("there is no such tile", found=found, expected=expected)
    left = tile.column * TILE_PX
    return replace(row_of_tiles(wall, tile.level, tile.row), columns=(left - OVERLAP_PX, left + TILE_PX + OVERLAP_PX))


def row_of_tiles(wall: TileWall, level: int, row: int) -> Pixels:
    """Return the pixels of all tiles of a row together, with those by which they reach into their neighbours."""
    top, height_px = row * TILE_PX, wall.height_px(level)
    rows = max(top - OVERLAP_PX, 0), min(top + TILE_PX + OVERLAP_PX, height_px)
    return Pixels(rows, (-OVERLAP_PX, wall.width_px(level) + OVERLAP_PX))


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


def placing_of(grid: SurfaceGrid, where: Alignment | None = None) -> Placing:
    """Return where the samples on ``grid`` lie, moved by ``where`` into the frame that the wall is shown in.

    Rows that a bend of ``where`` turns must have been turned by it before.
    """
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


def row_spans(placing: Placing, wall: TileWall, level: int, pixels: Pixels) -> Spans:
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


def column_spans(placing: Placing, wall: TileWall, level: int, pixels: Pixels) -> Spans:
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
