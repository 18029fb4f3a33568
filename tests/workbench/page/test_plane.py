"""What a pixel shows of the samples on disk: by hand, and for every place of the seam."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.base.zarr.window import ChunkCache, stored_image
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page import plane as plane_module
from endoct.workbench.page.layers import wall_of
from endoct.workbench.page.plane import Plane, thinning
from endoct.workbench.page.wall import Pixels, Tile, TileWall, pixels_of, placing_of

Make = Callable[..., Plane]


@pytest.fixture
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Write an image and return it as a plane."""

    def made(grid: SurfaceGrid, values: np.ndarray, valid: np.ndarray | None = None, **placing: object) -> Plane:
        store = tmp_path_factory.mktemp("plane") / "image.zarr"
        known = np.ones(values.shape, bool) if valid is None else valid
        chunks = (max(1, values.shape[0] // 3), max(1, values.shape[1] // 2))
        dims = ("z", "theta")
        arrays = {
            "intensity": Named(dims, values.astype(np.float32), {}, chunks),
            "valid": Named(dims, known, {}, chunks),
        }
        write_arrays(store, arrays, {})
        cache = ChunkCache()
        image, observed = (stored_image(store / name, cache) for name in arrays)
        return Plane(image, observed, placing_of(grid, **placing), grid.radius_mm)

    return made


def whole(wall: TileWall, level: int) -> Pixels:
    return Pixels((0, wall.height_px(level)), (0, wall.width_px(level)))


# four columns of samples around 256 pixels; rows as high as 64 pixels
COARSE = SurfaceGrid.full_circle(2, 4, z0_mm=0.0, dz_mm=64.0, radius_mm=256 / (2 * math.pi))


def test_where_samples_are_coarse_every_pixel_shows_the_nearest(make: Make):
    plane = make(COARSE, np.array([[1, 2, 3, 4], [5, 6, 7, 8]]))
    shown = plane.means(wall_of(COARSE), 0, whole(wall_of(COARSE), 0)).values
    assert shown.shape == (128, 256)
    # column 0 has its centre at θ = 0: half of it lies at the other end of the circle
    np.testing.assert_array_equal(
        shown[0, [0, 31, 32, 95, 96, 159, 160, 223, 224, 255]], [1, 1, 2, 2, 3, 3, 4, 4, 1, 1]
    )
    np.testing.assert_array_equal(shown[[0, 63, 64, 127], 0], [1, 1, 5, 5])


def test_where_samples_are_fine_a_pixel_is_the_mean_of_the_observed_ones_in_it(make: Make):
    grid = SurfaceGrid.full_circle(2, 1024, z0_mm=0.0, dz_mm=0.5, radius_mm=256 / (2 * math.pi))
    values = np.zeros((2, 1024))
    values[:, 4:8] = [[1, 2, 3, 4], [5, 6, 7, 100]]
    valid = np.ones(values.shape, bool)
    valid[1, 7] = False
    valid[:, 8:12] = [[True, False, False, False], [False, False, False, False]]
    found = make(grid, values, valid).means(wall_of(grid), 0, whole(wall_of(grid), 0))
    assert found.values[0, 1] == pytest.approx((1 + 2 + 3 + 4 + 5 + 6 + 7) / 7)
    assert found.observed[0, 1] == pytest.approx(7 / 8)
    assert found.known[0, 1]
    assert not found.known[0, 2]
    assert found.observed[0, 2] == pytest.approx(1 / 8)


def test_uneven_rows_are_shown_where_they_lie_and_gaps_are_not_filled(make: Make):
    grid = SurfaceGrid.full_circle(3, 4, z0_mm=0.0, dz_mm=10.0, radius_mm=256 / (2 * math.pi)).with_rows([0, 10, 40])
    shown = make(grid, np.repeat([[1], [2], [3]], 4, axis=1)).means(wall_of(grid), 0, whole(wall_of(grid), 0))
    assert wall_of(grid).top_mm == -5
    assert shown.values[2, 0] == 1  # z −2.5
    assert shown.values[14, 0] == 2
    assert not shown.known[30, 0]  # 25 mm: 15 mm from either row
    assert shown.values[44, 0] == 3


@given(turned=st.integers(0, 9), mirrored=st.booleans(), z_reversed=st.booleans())
def test_a_placed_side_is_shown_where_the_alignment_puts_it(turned: int, mirrored: bool, z_reversed: bool):
    grid = SurfaceGrid.full_circle(6, 10, z0_mm=0.0, dz_mm=0.5, radius_mm=1.25)
    where = Alignment(turned * grid.dtheta_rad, 1.0, mirrored=mirrored, z_reversed=z_reversed)
    placing = placing_of(grid, where)
    for row in range(grid.n_z):
        for column in range(grid.n_theta):
            stored = placing.stored_row(row), (-column if placing.mirrored else column) % placing.n_theta
            z_mm, theta_rad = placing.row_mm[row], placing.theta0_rad + column * placing.dtheta_rad
            assert where.z_to_a(grid.z_mm[stored[0]]) == pytest.approx(z_mm)
            apart = where.theta_to_a(grid.theta_rad[stored[1]]) - theta_rad
            assert math.remainder(float(apart), 2 * math.pi) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("mirrored", "z_reversed"), [(False, False), (True, False), (False, True), (True, True)])
def test_a_sample_is_read_where_it_is_drawn(make: Make, mirrored: bool, z_reversed: bool):
    grid = SurfaceGrid.full_circle(12, 100, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
    values = np.arange(1200.0).reshape(12, 100)
    where = Alignment(2.345, 0.7, z_scale=1.1, mirrored=mirrored, z_reversed=z_reversed)
    plane = make(grid, values, where=where)
    rng = np.random.default_rng(3)
    wall = TileWall(1.25, -0.2, 1.6)
    pixels = whole(wall, 0)
    shown = plane.means(wall, 0, pixels)
    for y, x in rng.integers(0, pixels.shape, (200, 2)):
        z_mm, theta_rad = wall.top_mm + (y + 0.5) * wall.pixel_mm(0), (x + 0.5) * 2 * math.pi / 256
        value = plane.at(theta_rad, z_mm)
        stored = values[
            int(np.argmin(np.abs(where.z_to_a(grid.z_mm) - z_mm))),
            round(float(grid.column_of(where.theta_to_b(theta_rad)))) % 100,
        ]
        if value is not None:
            assert value == stored
        if shown.known[y, x] and value is not None:
            assert shown.values[y, x] == stored


def test_tiles_of_every_level_meet_at_the_seam(make: Make):
    grid = SurfaceGrid.full_circle(40, 1000, z0_mm=0.0, dz_mm=0.01, radius_mm=1.25, theta0_rad=0.3)
    plane = make(grid, np.random.default_rng(0).normal(size=(40, 1000)))
    wall = wall_of(grid)
    for level in range(3):
        first, last = Tile(level, 0, 0), Tile(level, wall.width_px(level) // 256 - 1, 0)
        left = plane.means(wall, level, pixels_of(wall, first)).values
        right = plane.means(wall, level, pixels_of(wall, last)).values
        np.testing.assert_array_equal(right[:, -2:], left[:, :2])


def test_the_overview_shows_what_the_store_does(make: Make, monkeypatch: pytest.MonkeyPatch):
    grid = SurfaceGrid.full_circle(96, 960, z0_mm=0.0, dz_mm=0.005, radius_mm=1.25)
    smooth = np.sin(grid.theta_rad)[np.newaxis] + np.cos(grid.z_mm)[:, np.newaxis]
    valid = np.ones(smooth.shape, bool)
    valid[:10] = False
    exact = make(grid, smooth, valid)
    assert (exact.overview().down, exact.overview().across) == (1, 1)
    monkeypatch.setattr(plane_module, "MOST_OVERVIEW_SAMPLES", 8000)
    thinned = make(grid, smooth, valid)
    assert thinned.overview().down * thinned.overview().across > 4
    wall = wall_of(grid)
    one, other = (each.means(wall, 0, pixels_of(wall, Tile(0, 0, 0))) for each in (exact, thinned))
    both = one.known & other.known
    assert both.mean() > 0.75
    assert np.abs(one.values - other.values)[both].max() < 0.05


def test_an_overview_is_thinned_where_samples_are_finer():
    assert thinning((450, 2048), 0.02, 0.004) == (1, 1)
    assert thinning((3000, 14_000), 0.02, 0.00056) == (1, 32)
    # long, and yet no coarser than the pixels of level 0
    assert thinning((200_000, 512), 0.02, 0.0153) == (1, 2)


def test_an_overview_that_does_not_divide_the_circle_meets_at_the_seam(make: Make, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(plane_module, "MOST_OVERVIEW_SAMPLES", 3000)
    grid = SurfaceGrid.full_circle(4, 4099, z0_mm=0.0, dz_mm=0.03, radius_mm=1.25)  # a prime
    plane = make(grid, np.repeat(np.cos(grid.theta_rad)[np.newaxis], 4, axis=0))
    assert plane.overview().across == 8
    wall = wall_of(grid)
    shown = plane.means(wall, 0, pixels_of(wall, Tile(0, 0, 0))).values[0]
    expected = np.cos((np.arange(-1, 257) + 0.5) * 2 * np.pi / 256)
    assert np.abs(shown - expected).max() < 0.02


def test_a_damaged_chunk_is_one_line(make: Make):
    plane = make(COARSE, np.ones((2, 4)))
    next(plane.image.declared.folder.glob("c/0/0")).write_bytes(b"nonsense")
    with pytest.raises(EndoctError, match=r"cannot be read|no chunk|damaged"):
        plane.means(wall_of(COARSE), 0, whole(wall_of(COARSE), 0))


def test_a_chunk_elsewhere_is_not_read(make: Make, tmp_path: Path):
    plane = make(COARSE, np.ones((2, 4)))
    chunk = next(plane.image.declared.folder.glob("c/0/0"))
    chunk.rename(tmp_path / "elsewhere")
    chunk.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(EndoctError, match="is not whole"):
        plane.at(0.0, 0.0)


def test_chunks_are_let_go_of():
    cache = ChunkCache(most_bytes=1000)
    for k in range(10):
        cache.put((Path("a"), str(k)), np.zeros(400, np.uint8))
    assert [cache.get((Path("a"), str(k))) is not None for k in (0, 7, 8, 9)] == [False, False, True, True]


def test_texts_are_no_image(tmp_path: Path):
    write_arrays(tmp_path / "x.zarr", {"side": Named(("side",), np.array(["a", "b"], object))}, {})
    assert zarr.open_group(tmp_path / "x.zarr", mode="r")["side"].shape == (2,)
    with pytest.raises(EndoctError, match="holds no image"):
        stored_image(tmp_path / "x.zarr" / "side", ChunkCache())
