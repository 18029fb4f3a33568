"""Local contrast of frames: what it keeps of them, and what it leaves out."""

from types import SimpleNamespace

import numpy as np
import pytest

from endoct.base.arrays import Image, Mask
from endoct.base.compute.memory import Room
from endoct.modalities.endoscope.parallax.views import (
    LEAST_SPREAD,
    STEPS_A_SPREAD,
    UNKNOWN,
    FineGrid,
    Strip,
    Texture,
    _box,
    fine_grid,
    stacked,
    texture,
)
from endoct.stitching.grid import SurfaceGrid

N_ROWS, N_COLUMNS = 80, 256
SCALE_MM = 0.01
GRID = SurfaceGrid.full_circle(N_ROWS, N_COLUMNS, z0_mm=0.0, dz_mm=0.005, radius_mm=0.005 * N_COLUMNS / (2 * np.pi))
EVERYWHERE = np.ones((N_ROWS, N_COLUMNS), np.bool_)


def of(logs: Image, known: Mask = EVERYWHERE) -> Image:
    return texture(Strip(7, logs.astype(np.float32), known), SCALE_MM, GRID).contrast.astype(np.float32)


@pytest.fixture
def logs() -> Image:
    return np.random.default_rng(8).normal(-1.5, 3, (N_ROWS, N_COLUMNS)).astype(np.float32)


def test_neither_light_nor_contrast_nor_shade_counts(logs: Image) -> None:
    shade = 0.5 * np.sin(2 * np.pi * np.arange(N_COLUMNS) / N_COLUMNS, dtype=np.float32)
    plain = of(logs)
    assert np.abs(of(logs + 2) - plain).max() <= 1
    assert np.abs(of(4 * logs) - plain).mean() < 0.1 * np.abs(plain).mean()
    assert np.abs(of(logs + shade) - plain).mean() < 0.02 * np.abs(plain).mean()
    assert 0.7 * STEPS_A_SPREAD < plain.std() < 1.3 * STEPS_A_SPREAD


def test_bright_is_above_0_and_turning_turns_it(logs: Image) -> None:
    spot = np.zeros_like(logs)
    spot[40, 2] = 1
    assert of(spot)[40, 2] > STEPS_A_SPREAD
    assert of(spot)[40, 8] < 0
    assert of(spot)[46, 2] < 0
    np.testing.assert_array_equal(of(np.roll(logs, 100, axis=1)), np.roll(of(logs), 100, axis=1))


def test_where_nothing_varies_nothing_stands_out(logs: Image) -> None:
    faint = 0.1 * LEAST_SPREAD * logs
    assert np.abs(of(faint)).mean() < 0.2 * np.abs(of(logs)).mean()


def test_it_is_unknown_where_unseen_and_only_there_and_tells_nothing_of_it(logs: Image) -> None:
    known = EVERYWHERE.copy()
    known[30:50, 250:] = known[30:50, :30] = known[:2] = False
    steps = of(logs, known)
    np.testing.assert_array_equal(steps == UNKNOWN, ~known)
    np.testing.assert_array_equal(of(np.where(known, logs, 40), known), steps)
    assert (of(np.full_like(logs, -2.0), known)[known] != UNKNOWN).all()
    assert np.abs(of(np.full_like(logs, -2.0), known)).max() <= 1  # an edge of what is seen is none of the wall
    assert steps[known].std() == pytest.approx(STEPS_A_SPREAD, rel=0.3)


def test_shorter_strips_end_in_the_unknown() -> None:
    long, short = (Texture(first, np.full((n, 4), n, np.int8)) for first, n in ((3, 5), (9, 2)))
    room = Room()
    room.array("textures", (2, 5, 4), np.int8)[:] = 99
    first, stack = stacked([long, short], 4, room)
    assert first.tolist() == [3, 9]
    assert stack.shape == (2, 5, 4)
    assert (stack[0] == 5).all()
    assert stack[1, :, 0].tolist() == [2, 2, UNKNOWN, UNKNOWN, UNKNOWN]
    assert stacked([], 4, room)[1].shape == (0, 0, 4)


def test_a_block_is_so_many_rows_and_two_columns() -> None:
    fine = FineGrid(SurfaceGrid.full_circle(12, 8, z0_mm=0.5, dz_mm=0.1, radius_mm=1.0), rows=3)
    assert fine.n_blocks == (4, 4)
    assert fine.block_size_mm == pytest.approx((0.3, 2 * np.pi / 4))
    assert fine.z_mm(range(1, 3)) == pytest.approx(np.array([[0.8, 0.9, 1.0], [1.1, 1.2, 1.3]]))
    # rows of the coarser grid lie at 0.3, 0.7, 1.1 … 1.9 mm: before the first block, in it, in the third … beyond all
    coarse = SurfaceGrid.full_circle(5, 4, z0_mm=0.3, dz_mm=0.4, radius_mm=1.0, theta0_rad=0.1)
    along, around = fine.block_of(coarse)
    assert along.tolist() == [0, 0, 2, 3, 3]
    assert around.tolist() == [0, 1, 2, 3]
    turned = SurfaceGrid.full_circle(5, 4, z0_mm=0.3, dz_mm=0.4, radius_mm=1.0, theta0_rad=2 * np.pi - 0.3)
    assert fine.block_of(turned)[1].tolist() == [0, 1, 2, 3], "to the block in which it begins"
    earlier = SurfaceGrid.full_circle(5, 4, z0_mm=0.3, dz_mm=0.4, radius_mm=1.0, theta0_rad=2 * np.pi - 0.5)
    assert fine.block_of(earlier)[1].tolist() == [3, 0, 1, 2]


@pytest.mark.parametrize(("mm_per_px", "rows"), [(0.0055, 4), (0.019, 1), (0.1, 1), (0.002, 5)])
def test_blocks_are_about_20_um_long_of_rows_as_fine_as_the_image(mm_per_px: float, rows: int) -> None:
    """Around, they are half as wide: two of 1600 columns of 4.7 µm."""
    grid = SurfaceGrid.full_circle(5, 1600, z0_mm=0.0, dz_mm=0.2, radius_mm=1.2, theta0_rad=0.3)
    optics, row_z_mm = SimpleNamespace(mm_per_px=mm_per_px), np.array([0.1, 1.0, 2.11])
    fine = fine_grid(SimpleNamespace(grid=grid, optics=optics, row_z_mm=row_z_mm))  # type: ignore[arg-type]
    assert fine.rows == rows
    assert fine.n_blocks == (round(2.01 / 0.02), 800)
    assert fine.block_size_mm == pytest.approx((0.02, 2 * np.pi * 1.2 / 800))
    samples = fine.samples
    assert samples.z0_mm == pytest.approx(0.1 + 0.01 / rows), "the first block begins at the first row"
    assert (samples.radius_mm, samples.theta0_rad) == (1.2, 0.3)


def test_a_box_passed_over_twice_spreads_like_a_gaussian() -> None:
    """A box of w samples has the variance (w² − 1)/12, and two of them twice that."""
    for w in (5, 11, 31):
        assert _box(np.sqrt((w**2 - 1) / 6)) == w
    assert _box(0.1) == 3
