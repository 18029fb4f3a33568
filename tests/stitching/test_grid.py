"""The surface grid: the only converter between index and place."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(3, 8, z0_mm=10.0, dz_mm=0.5, radius_mm=2.0)

grids = st.builds(
    lambda n_z, n_theta, z0, dz, theta0: SurfaceGrid.full_circle(
        n_z, n_theta, z0_mm=z0, dz_mm=dz, radius_mm=1.25, theta0_rad=theta0
    ),
    st.integers(1, 50),
    st.integers(1, 4096),
    st.floats(-100, 100),
    st.floats(0.01, 2),
    st.floats(-7, 7),
)


def test_rows_and_columns_by_hand() -> None:
    assert GRID.shape == (3, 8)
    np.testing.assert_allclose(GRID.z_mm, [10.0, 10.5, 11.0])
    np.testing.assert_allclose(np.rad2deg(GRID.theta_rad), [0, 45, 90, 135, 180, 225, 270, 315])
    assert GRID.dtheta_mm == pytest.approx(2 * np.pi * 2.0 / 8)
    assert GRID.row_of(10.25) == pytest.approx(0.5)
    assert GRID.row_of(9.0) == pytest.approx(-2.0)  # not limited to the grid
    assert GRID.column_of(np.pi / 2) == pytest.approx(2.0)
    assert GRID.column_of(-np.pi / 4) == pytest.approx(7.0)


def test_a_hair_below_zero_is_column_zero_not_n() -> None:
    assert GRID.column_of(-1e-18) == 0.0


@given(grids, st.data())
def test_index_to_world_and_back(grid: SurfaceGrid, data: st.DataObject) -> None:
    row = data.draw(st.integers(0, grid.n_z - 1))
    column = data.draw(st.integers(0, grid.n_theta - 1))
    assert grid.row_of(grid.z_mm[row]) == pytest.approx(row, abs=1e-6)
    away = grid.column_of(grid.theta_rad[column]) - column
    assert abs((away + grid.n_theta / 2) % grid.n_theta - grid.n_theta / 2) < 1e-6


@given(grids, st.floats(-20, 20), st.integers(-3, 3))
def test_columns_are_periodic(grid: SurfaceGrid, theta_rad: float, turns: int) -> None:
    here = grid.column_of(theta_rad)
    there = grid.column_of(theta_rad + 2 * np.pi * turns)
    assert 0 <= here < grid.n_theta
    away = (there - here + grid.n_theta / 2) % grid.n_theta - grid.n_theta / 2
    assert abs(away) < COORDINATE_ATOL * grid.n_theta


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"dz_mm": 0.0}, "dz_mm"),
        ({"dz_mm": float("nan")}, "dz_mm"),
        ({"radius_mm": -1.0}, "radius_mm"),
        ({"n_z": 0}, "rows and columns"),
        ({"dtheta_rad": 0.1}, "close the circle"),
    ],
)
def test_impossible_grids_are_refused(changes: dict[str, float], says: str) -> None:
    with pytest.raises(EndoctError, match=says):
        replace(GRID, **changes)


@pytest.mark.parametrize("z_mm", [[0.0, 0.1, 0.1], [0.3, 0.2, 0.1], [0.0, 0.1], [0.0, np.nan, 0.2], [0.0, 0.1, np.inf]])
def test_rows_must_ascend(z_mm: list[float]) -> None:
    with pytest.raises(EndoctError, match="ascending"):
        GRID.with_rows(z_mm)


def test_rows_need_not_be_even() -> None:
    uneven = GRID.with_rows([10.0, 10.1, 11.0])
    np.testing.assert_array_equal(uneven.z_mm, [10.0, 10.1, 11.0])
    assert uneven != GRID
    assert uneven.with_rows(GRID.z_mm) == GRID
    np.testing.assert_allclose(uneven.row_of([10.05, 10.1, 10.55, 12.0, 9.5]), [0.5, 1.0, 1.5, 4.0, -1.0])
