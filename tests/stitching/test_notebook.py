"""What notebooks show: small, and no markup of anybody else's."""

import base64
import io
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from subprocess import run
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from PIL import Image

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.notebook import card, class_picture, draw_wall, evenly_spaced_rows, wall_picture
from endoct.stitching.panorama import Panorama

GRID = SurfaceGrid.full_circle(300, 512, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
MOST_HTML = 40_000


def noisy_panorama(grid: SurfaceGrid = GRID) -> Panorama:
    rng = np.random.default_rng(1)
    return Panorama(
        grid=grid,
        intensity=rng.normal(size=grid.shape),
        depth_mm=None,
        valid=rng.random(grid.shape) > 0.01,
        weight=np.ones(grid.shape),
        modality="oct",
        handedness_known=True,
        travel_known=True,
    )


def decoded(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_html_is_small_even_for_noise() -> None:
    shown = noisy_panorama()._repr_html_()
    assert "300 × 512" in shown
    assert len(shown) < MOST_HTML
    (png,) = re.findall(r"data:image/png;base64,([^\"]+)", shown)
    assert decoded(base64.b64decode(png)).std() > 1


def test_every_text_is_escaped() -> None:
    hostile = "<script>alert('x')</script>"
    shown = card(hostile, {hostile: hostile}, [(hostile, b"")])
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;") == 5


@pytest.mark.parametrize("n_z", [1, 2, 5000])
def test_any_length_can_be_shown(n_z: int) -> None:
    shown = noisy_panorama(SurfaceGrid.full_circle(n_z, 64, z0_mm=-1.0, dz_mm=0.01, radius_mm=1.25))._repr_html_()
    assert "data:image/png" in shown


def test_nothing_valid_can_be_shown() -> None:
    nothing = replace(noisy_panorama(), valid=np.zeros(GRID.shape, bool))
    assert "0.0%" in nothing._repr_html_()


def test_theta_0_is_at_the_left_and_the_mouth_at_the_top() -> None:
    grid = SurfaceGrid.full_circle(100, 360, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25, theta0_rad=np.pi)
    values = np.zeros(grid.shape, np.float32)
    values[:50, 180:270] = 1.0  # θ from 0 to 90°
    picture = decoded(wall_picture(grid, values, np.ones(grid.shape, bool)))[..., 0]
    height, width = picture.shape
    assert picture[: height // 2 - 2, : width // 4 - 2].min() > 200
    assert picture[height // 2 + 2 :].max() < 50
    assert picture[:, width // 4 + 2 :].max() < 50


def test_classes_have_their_colours() -> None:
    classes = np.zeros(GRID.shape, np.int8)
    classes[:150] = 1
    valid = np.ones(GRID.shape, bool)
    picture = decoded(class_picture(GRID, classes, [(255, 0, 0), (0, 0, 255)], valid))
    assert picture[5, 5].tolist() == [0, 0, 255]
    assert picture[-5, 5].tolist() == [255, 0, 0]


BORE_GRID = SurfaceGrid.full_circle(40, 64, z0_mm=1.0, dz_mm=0.1, radius_mm=1.25, theta0_rad=np.pi / 2)


@pytest.fixture(autouse=True)
def _no_window(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    plt.switch_backend("agg")
    yield
    plt.close("all")


def panorama(values: np.ndarray) -> Panorama:
    valid = np.ones(BORE_GRID.shape, bool)
    valid[0] = False
    return Panorama(
        grid=BORE_GRID,
        intensity=values,
        depth_mm=None,
        valid=valid,
        weight=np.ones(BORE_GRID.shape),
        modality="oct",
        handedness_known=True,
        travel_known=True,
    )


def test_a_panorama_plots_into_a_new_figure_or_given_axes() -> None:
    wall = panorama(np.random.default_rng(1).normal(size=BORE_GRID.shape))
    axes = wall.plot()
    assert axes.get_xlabel() == "θ (°)"
    assert axes.get_ylabel() == "z, inward (mm)"
    assert axes.get_xlim() == (0, 360)
    bottom, top = axes.get_ylim()
    assert (top, bottom) == pytest.approx((0.95, 4.95))
    mine = Figure().subplots()
    assert wall.plot(mine) is mine


def test_column_0_is_drawn_at_its_theta_and_invalid_samples_are_masked() -> None:
    values = np.zeros(BORE_GRID.shape, np.float32)
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


@pytest.mark.parametrize(
    ("z_mm", "rows"),
    [
        ([5.0], [0]),
        ([0.0, 0.5], [0, 0, 0, 1, 1, 1]),
        ([0.0, 0.1, 0.4, 0.5], [0, 1, 1, 2, 2, 3]),
    ],
)
def test_rows_that_are_even_are_those_nearest(z_mm: list[float], rows: list[int]) -> None:
    grid = SimpleNamespace(z_mm=np.array(z_mm), dz_mm=0.1)
    assert evenly_spaced_rows(grid).tolist() == rows  # type: ignore[arg-type]
