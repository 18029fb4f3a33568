"""The wall as tiles: which part of it every tile shows, at every level.

The wall is a cylinder unrolled, θ from 0 across, z down, in square pixels. At level k its circle is 256 · 2ᵏ pixels
wide: a whole number of tiles at every level, so that tiles go on endlessly around it. Tiles reach one pixel into their
neighbours, around the circle too, so that no seam shows where they are drawn scaled.
"""

import math
from dataclasses import dataclass, replace

from endoct.stitching.errors import EndoctError

TILE_PX = 256
OVERLAP_PX = 1
FINEST_LEVEL = 8
"""Of 65 536 pixels around: a pixel of a 2.5 mm bore has 0.1 µm."""


class NoSuchTile(EndoctError):
    """A tile, or a place, that the wall does not have."""


@dataclass(frozen=True)
class Wall:
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


def pixels_of(wall: Wall, tile: Tile) -> Pixels:
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


def row_of_tiles(wall: Wall, level: int, row: int) -> Pixels:
    """Return the pixels of all tiles of a row together, with those by which they reach into their neighbours."""
    top, height_px = row * TILE_PX, wall.height_px(level)
    rows = max(top - OVERLAP_PX, 0), min(top + TILE_PX + OVERLAP_PX, height_px)
    return Pixels(rows, (-OVERLAP_PX, wall.width_px(level) + OVERLAP_PX))
