"""Which pixels a tile shows: by hand, and for every wall."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.workbench.page.wall import FINEST_LEVEL, TILE_PX, NoSuchTile, Tile, TileWall, pixels_of

TURN = TileWall(radius_mm=256 / (2 * math.pi), top_mm=-10.0, bottom_mm=590.0)  # 1 mm is a pixel of level 0


def test_a_circle_is_a_whole_number_of_tiles_wide():
    assert [TURN.width_px(level) for level in (0, 1, 3)] == [256, 512, 2048]
    assert TURN.pixel_mm(0) == pytest.approx(1.0)
    assert [TURN.height_px(level) for level in (0, 1)] == [600, 1200]


def test_tiles_reach_a_pixel_into_their_neighbours_around_the_circle_too():
    assert pixels_of(TURN, Tile(0, 0, 0)).rows == (0, 257)
    assert pixels_of(TURN, Tile(0, 0, 1)).rows == (255, 513)
    assert pixels_of(TURN, Tile(0, 0, 2)).rows == (511, 600)
    assert pixels_of(TURN, Tile(0, 0, 0)).columns == (-1, 257)
    assert pixels_of(TURN, Tile(1, 1, 0)).columns == (255, 513)


@pytest.mark.parametrize(
    "tile",
    [Tile(0, 1, 0), Tile(0, -1, 0), Tile(0, 0, 3), Tile(-1, 0, 0), Tile(FINEST_LEVEL + 1, 0, 0), Tile(10**9, 0, 0)],
)
def test_a_tile_that_is_not_there_is_refused(tile: Tile):
    with pytest.raises(NoSuchTile, match="there is no such tile"):
        pixels_of(TURN, tile)


@pytest.mark.parametrize("part", [(0.0, 0.0, 1.0), (1.0, 2.0, 2.0), (1.0, 0.0, 1e9), (1.0, 0.0, math.nan)])
def test_a_wall_without_extent_is_refused(part: tuple[float, float, float]):
    with pytest.raises(EndoctError, match="a wall cannot be shown"):
        TileWall(*part)


def test_the_finest_level_shows_every_sample():
    wall = TileWall(1.25, 0.0, 60.0)
    assert wall.level_for(wall.circumference_mm / 2048) == 3
    assert wall.level_for(wall.circumference_mm / 2049) == 4
    assert wall.level_for(wall.circumference_mm / 14_000) == 6
    assert wall.level_for(1e-9) == FINEST_LEVEL
    assert wall.level_for(100.0) == 0


@given(
    radius_mm=st.floats(0.1, 20),
    length_mm=st.floats(0.05, 150),
    level=st.integers(0, 3),
)
def test_the_tiles_of_a_level_hold_each_of_its_pixels_once(radius_mm: float, length_mm: float, level: int):
    wall = TileWall(radius_mm, 0.0, length_mm)
    height = wall.height_px(level)
    assert wall.pixel_mm(level) * height >= length_mm * (1 - 1e-9)
    assert wall.pixel_mm(level) * (height - 1) < length_mm
    rows = np.zeros(height, int)
    last = -(-height // TILE_PX) - 1
    for row in range(last + 1):
        first, stop = pixels_of(wall, Tile(level, 0, row)).rows
        inner = slice(first + (row > 0), stop - (row < last))
        rows[inner] += 1
    assert (rows == 1).all()
