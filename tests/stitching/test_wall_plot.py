"""Plots of a wall have units on their axes, θ as a circle from 0°, and rows where they are."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from subprocess import run

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.notebook import draw_wall, evenly_spaced_rows
from endoct.stitching.panorama import Panorama

GRID = SurfaceGrid.full_circle(40, 64, z0_mm=1.0, dz_mm=0.1, radius_mm=1.25, theta0_rad=np.pi / 2)


@pytest.fixture(autouse=True)
def _no_window(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    plt.switch_backend("agg")
    yield
    plt.close("all")


def panorama(values: np.ndarray) -> Panorama:
    valid = np.ones(GRID.shape, bool)
    valid[0] = False
    return Panorama(
        grid=GRID,
        intensity=values,
        depth_mm=None,
        valid=valid,
        weight=np.ones(GRID.shape),
        modality="oct",
        handedness_known=True,
        travel_known=True,
    )


def test_a_panorama_plots_into_a_new_figure_or_given_axes() -> None:
    wall = panorama(np.random.default_rng(1).normal(size=GRID.shape))
    axes = wall.plot()
    assert axes.get_xlabel() == "θ (°)"
    assert axes.get_ylabel() == "z, inward (mm)"
    assert axes.get_xlim() == (0, 360)
    bottom, top = axes.get_ylim()
    assert (top, bottom) == pytest.approx((0.95, 4.95))
    mine = Figure().subplots()
    assert wall.plot(mine) is mine


def test_column_0_is_drawn_at_its_theta_and_invalid_samples_are_masked() -> None:
    values = np.zeros(GRID.shape, np.float32)
    values[:, 0] = 1.0  # θ = 90°
    axes = panorama(values).plot()
    drawn = axes.images[0].get_array()
    assert drawn is not None
    assert np.flatnonzero(drawn[1]).tolist() == [16]
    assert np.ma.getmaskarray(drawn)[0].all()
    assert not np.ma.getmaskarray(drawn)[1:].any()


def test_uneven_rows_are_drawn_where_they_are() -> None:
    even = SurfaceGrid.full_circle(4, 8, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
    grid = replace(even, rows_mm=(0.0, 0.1, 0.2, 0.6))
    assert evenly_spaced_rows(grid).tolist() == [0, 1, 2, 2, 2, 3, 3]
    assert evenly_spaced_rows(even).tolist() == [0, 1, 2, 3]
    assert evenly_spaced_rows(SurfaceGrid.full_circle(1, 8, z0_mm=0.5, dz_mm=0.1, radius_mm=1.25)).tolist() == [0]
    image = draw_wall(Figure().subplots(), grid, np.zeros(grid.shape, np.float32), np.ones(grid.shape, bool))
    assert np.shape(image.get_array()) == (7, 8)


def test_a_panorama_loads_neither_matplotlib_nor_xarray() -> None:
    code = "import endoct.stitching.panorama, sys; print({'matplotlib', 'xarray', 'cv2', 'PIL'} & set(sys.modules))"
    assert run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
