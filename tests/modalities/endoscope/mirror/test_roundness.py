"""How round the outer rim is: drawn ellipses of known axes."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from endoct.modalities.endoscope.mirror.rings import Ring
from endoct.modalities.endoscope.mirror.roundness import measure_roundness, squared


def ellipse(wide_px: float, high_px: float, turned_deg: float = 0.0) -> NDArray[np.float32]:
    """A soft-edged bright ellipse of these semi-axes about (160, 120), with its middle dark."""
    y, x = np.mgrid[:240, :320].astype(float)
    turn = np.deg2rad(turned_deg)
    across, down = x - 160, y - 120
    u, v = np.cos(turn) * across + np.sin(turn) * down, -np.sin(turn) * across + np.cos(turn) * down
    away = (np.hypot(u / wide_px, v / high_px) - 1) * np.sqrt(wide_px * high_px)
    return (0.05 + 0.6 * np.clip(0.5 - away / 2, 0, 1) * (np.hypot(u, v) > 30)).astype(np.float32)


@pytest.mark.parametrize("wide", [0.9, 0.95, 1.0, 1.05, 1.1])
def test_the_ratio_of_the_axes_is_measured(wide: float) -> None:
    roundness = measure_roundness([ellipse(100 * wide, 100)], Ring(160, 120, 100, rising=False))
    assert roundness.wide == pytest.approx(wide, abs=0.004)
    assert roundness.pixels == (1.0 if wide == 1 else pytest.approx(wide, abs=0.004))


def test_an_oblique_ellipse_is_no_matter_of_pixels() -> None:
    roundness = measure_roundness([ellipse(106, 100, turned_deg=45)], Ring(160, 120, 103, rising=False))
    assert roundness.pixels == 1
    assert roundness.out_of_round == pytest.approx(0.06, abs=0.006)


def test_a_half_hidden_rim_says_nothing() -> None:
    image = ellipse(110, 100)
    image[:, :160] = 0.05
    assert measure_roundness([image], Ring(160, 120, 103, rising=False)).pixels == 1


def test_cells_on_the_rim_do_not_matter() -> None:
    image = ellipse(110, 100)
    for x, y in ((160, 25), (262, 130), (90, 190)):
        cv2.circle(image, (x, y), 16, 0.05, -1)
    assert measure_roundness([image], Ring(160, 120, 103, rising=False)).pixels == pytest.approx(1.1, abs=0.006)


@given(st.floats(0.8, 1.25))
def test_squared_puts_every_column_where_a_square_pixel_has_it(pixels: float) -> None:
    ramp = np.tile(np.arange(200, dtype=np.float32), (4, 1))
    image = squared(ramp, pixels)
    column = np.arange(image.shape[1])
    expected = np.clip((column + 0.5) * pixels - 0.5, 0, 199)
    np.testing.assert_allclose(image[0], expected, atol=0.04)  # places are rounded to 1/32 of a pixel


def test_square_pixels_are_left_as_they_are() -> None:
    image = ellipse(100, 100)
    assert squared(image, 1.0) is image
