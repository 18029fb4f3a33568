"""What notebooks show: small, and no markup of anybody else's."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.notebook import card, class_picture, wall_picture
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
