"""The relief that the page builds the cylinder from: every sample where it belongs, by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from workbench_page import Served

from endoct.base.zarr.window import ChunkCache, stored_image
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.layers import MOST_SAMPLES, relief_bytes, wall_of
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.plane import Plane
from endoct.workbench.page.wall import TileWall, placing_of

GRID = SurfaceGrid.full_circle(5, 512, z0_mm=1.0, dz_mm=0.2, radius_mm=1.25)


def read(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return (z of rows in mm, relief in mm with NaN where it is not known), as the page reads them."""
    rows, columns = np.frombuffer(content, "<u4", 2)
    low, high = np.frombuffer(content, "<f4", 2, 8)
    z_mm = np.frombuffer(content, "<f4", rows, 16)
    codes = np.frombuffer(content, "<u2", offset=16 + 4 * rows).reshape(rows, columns)
    return z_mm, np.where(codes == 0, np.nan, low + (codes - 1.0) / 65_534 * (high - low))


def plane_of(folder: Path, values: np.ndarray, where: Alignment | None = None) -> tuple[Plane, TileWall]:
    arrays = {"depth_mm": Named(("z", "theta"), values.astype(np.float32), {}, values.shape)}
    write_arrays(folder / "relief.zarr", arrays, {})
    placing = placing_of(GRID, where)
    image = stored_image(folder / "relief.zarr" / "depth_mm", ChunkCache())
    return Plane(image, None, placing, GRID.radius_mm), wall_of(GRID)


def peak(shape: tuple[int, int] = GRID.shape) -> np.ndarray:
    """Return a relief with one high column, at θ = 1 rad, in its second row, and one sample that is not known."""
    values = np.zeros(shape)
    values[1, round(1.0 / GRID.dtheta_rad)] = 0.5
    values[3, 100] = np.nan
    return values


def theta_of(relief: np.ndarray, row: int) -> float:
    columns = relief.shape[1]
    return float((np.nanargmax(relief[row]) + 0.5) * 2 * math.pi / columns)


def test_rows_and_columns_are_where_the_samples_are(tmp_path: Path):
    z_mm, relief = read(relief_bytes(*plane_of(tmp_path, peak())))
    assert z_mm == pytest.approx(GRID.z_mm)
    assert relief.shape == (5, 512)
    assert relief[1].max() == pytest.approx(0.5, abs=1e-4)
    assert theta_of(relief, 1) == pytest.approx(1.0, abs=GRID.dtheta_rad)
    assert np.isnan(relief[3]).sum() in (1, 2)
    assert not np.isnan(relief[[0, 1, 2, 4]]).any()


def test_a_side_that_is_turned_and_mirrored_is_moved(tmp_path: Path):
    where = Alignment(0.7, 0.1, mirrored=True, z_reversed=True)
    z_mm, relief = read(relief_bytes(*plane_of(tmp_path, peak(), where)))
    assert z_mm == pytest.approx(np.sort(0.1 - GRID.z_mm))
    assert theta_of(relief, 3) == pytest.approx((0.7 - 1.0) % (2 * math.pi), abs=GRID.dtheta_rad)


def test_many_rows_become_fewer(tmp_path: Path):
    z_mm, relief = read(relief_bytes(*plane_of(tmp_path, peak()), 2 * 512))
    assert relief.shape == (2, 512)
    assert z_mm == pytest.approx([GRID.z_mm[:3].mean(), GRID.z_mm[3:].mean()])
    assert np.nanmax(relief[0]) == pytest.approx(0.5 / 3, abs=1e-4)


def test_a_relief_of_which_nothing_is_known_is_empty(tmp_path: Path):
    _, relief = read(relief_bytes(*plane_of(tmp_path, np.full(GRID.shape, np.nan))))
    assert np.isnan(relief).all()


def test_the_server_has_the_reliefs_and_nothing_else(served: Served, comparison: Path):
    status, content, headers = served.get("/relief/v/oct-relief.bin")
    assert (status, headers["content-type"]) == (200, "application/octet-stream")
    assert content == open_shown(comparison).relief("oct-relief")
    z_mm, relief = read(content)
    assert len(content) <= 16 + 4 * z_mm.size + 2 * MOST_SAMPLES
    assert np.nanmax(relief) == pytest.approx(0.6, abs=0.05)
    assert np.isnan(relief[40:43]).all()  # the mock's rows that were not observed
    for name in ("oct-image", "oct-cells", "nothing", "..%2foct-relief"):
        assert served.get(f"/relief/v/{name}.bin")[0] == 404
