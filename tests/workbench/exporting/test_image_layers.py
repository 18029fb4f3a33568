"""Levels of images, means over samples and where these lie: by hand."""

from typing import Any

import numpy as np
import pytest

from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.image_layers import (
    PyramidLevel,
    averaged,
    blocks,
    contrast_of,
    levels_of,
    read_level,
    thinned,
)


class Rows:
    """A layer that is an array."""

    def __init__(self, values: np.ndarray) -> None:
        self.values, self.rows = values.astype(np.float32), np.arange(len(values))

    def read(self, start: int, stop: int) -> Any:
        return self.values[start:stop]


def test_means_are_over_what_was_observed_of_half_a_sample_or_more_and_go_on_around() -> None:
    nan = np.nan
    image = np.array([[1, 2, 3, 4, 5], [3, 4, nan, nan, 7], [9, nan, nan, nan, 11]], np.float32)
    # the third column of the second level: 5, 7 and, around the circle, 1 and 3; the last row has nothing below it
    expected = [[2.5, 3.5, 4.0], [9.0, nan, 10.0]]
    np.testing.assert_allclose(averaged(image, 2, 2), expected)
    np.testing.assert_allclose(averaged(image, 1, 3)[0], [2, (4 + 5 + 1) / 3])
    assert averaged(image, 1, 1) is image
    np.testing.assert_allclose(averaged(np.array([[1, nan, nan]], np.float32), 1, 3), [[nan]])


def test_long_samples_are_halved_less_often_until_the_level_is_small() -> None:
    square = SurfaceGrid.full_circle(300, 1030, z0_mm=0.0, dz_mm=0.01, radius_mm=1030 * 0.01 / (2 * np.pi))
    assert [(level.rows, level.columns, level.shape) for level in levels_of(square)] == [
        (1, 1, (300, 1030)), (2, 2, (150, 515)), (4, 4, (75, 258)),
    ]  # fmt: skip
    tall = SurfaceGrid.full_circle(600, 1100, z0_mm=0.0, dz_mm=0.04, radius_mm=1100 * 0.01 / (2 * np.pi))
    assert [(level.rows, level.columns, level.shape) for level in levels_of(tall)] == [
        (1, 1, (600, 1100)), (1, 2, (600, 550)), (1, 4, (600, 275)), (2, 8, (300, 138)),
    ]  # fmt: skip
    few = SurfaceGrid.full_circle(600, 8, z0_mm=0.0, dz_mm=0.01, radius_mm=1.0)
    assert [level.shape for level in levels_of(few)] == [(600, 8), (300, 8)]


def test_a_level_lies_in_the_middle_of_what_it_averages() -> None:
    grid = SurfaceGrid.full_circle(8, 64, z0_mm=0.5, dz_mm=0.1, radius_mm=2.0, theta0_rad=0.25)
    level = PyramidLevel(2, 4, (4, 16))
    assert level.step_mm(grid) == pytest.approx((0.2, 4 * grid.dtheta_mm))
    assert level.origin_mm(grid) == pytest.approx((0.55, 0.5 + 1.5 * grid.dtheta_mm))
    ids = np.arange(8 * 64).reshape(8, 64)
    np.testing.assert_array_equal(thinned(ids, level), ids[1::2, 2::4])
    odd = thinned(ids[:3, :6], PyramidLevel(2, 4, (2, 2)))
    np.testing.assert_array_equal(odd, [[64 + 2, 64 + 0], [2 * 64 + 2, 2 * 64 + 0]])  # the last row, around the circle


def test_a_level_is_read_as_if_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    layer, level = Rows(np.random.default_rng(1).normal(size=(37, 6))), PyramidLevel(3, 2, (13, 3))
    whole = averaged(layer.values, 3, 2)
    monkeypatch.setattr("endoct.workbench.exporting.image_layers._BLOCK_ROWS", 6)
    np.testing.assert_array_equal(read_level(layer, level, 0, 13), whole)  # type: ignore[arg-type]
    np.testing.assert_array_equal(read_level(layer, level, 11, 13), whole[11:])  # type: ignore[arg-type]
    assert list(blocks(2, 9, 3)) == [(2, 5), (5, 8), (8, 9)]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.tile(np.arange(1001.0), (3, 1)), (5, 995)),
        (np.full((2, 4), 7.0), (7, 8)),
        (np.full((2, 4), np.nan), (0, 1)),
        (np.repeat([[0.0], [np.nan], [1000.0]], 500, axis=1), (0, 1000)),
    ],
)
def test_a_layer_is_shown_between_its_outer_percentiles(values: np.ndarray, expected: tuple[float, float]) -> None:
    assert contrast_of(Rows(values)) == pytest.approx(expected)  # type: ignore[arg-type]
