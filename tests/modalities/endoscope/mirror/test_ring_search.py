"""The ring by what moves, in drawn rings whose wall goes by and that mislead light alone; how round it is."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import RING_PX

from endoct.base.errors import NotSeen
from endoct.modalities.endoscope.mirror.annulus import Annulus, find_annulus
from endoct.modalities.endoscope.mirror.ring_search import find_ring, measure_roundness, squared
from endoct.modalities.endoscope.mirror.rings import Ring

Frame = NDArray[np.float32]
TRUE = Annulus(158.0, 121.5, 30.0, 160.0, 120.0, 100.0)


def disc(cx: float, cy: float, r: float) -> NDArray[np.float64]:
    y, x = np.mgrid[:240, :320].astype(float)
    return np.clip((r - np.hypot(x - cx, y - cy)) / 1.5 + 0.5, 0, 1)


def frame(
    texture: int, *, tip: float = 0.3, specular_px: float | None = None, wall: float = 0.3, dx: float = 0.0
) -> Frame:
    """A ring whose wall is that of ``texture``, around a tip of its own brightness, moved along the columns by dx."""
    own, wall_of = np.random.default_rng([texture, 1]), np.random.default_rng([texture, 2])
    outside = disc(TRUE.outer_x_px + dx, TRUE.outer_y_px, TRUE.outer_px)
    inside = disc(TRUE.inner_x_px + dx, TRUE.inner_y_px, TRUE.inner_px)
    grain = 1 + 0.5 * cv2.GaussianBlur(wall_of.standard_normal((240, 320)), (0, 0), 3.0) / 0.1 * 0.3
    image = (outside - inside) * wall * grain + inside * tip
    if specular_px is not None:
        y, x = np.mgrid[:240, :320].astype(float)
        from_centre = np.hypot(x - TRUE.outer_x_px - dx, y - TRUE.outer_y_px)
        image += 0.5 * np.exp(-0.5 * ((from_centre - specular_px) / 1.5) ** 2)
    image += 0.02 + 0.004 * own.standard_normal(image.shape)
    return np.clip(image, 0, 1).astype(np.float32)


def assert_is_true(annulus: Annulus) -> None:
    """Within a hundredth of the radius: what moves is smoothed before it is measured."""
    for name in ("inner_x_px", "inner_y_px", "inner_px", "outer_x_px", "outer_y_px", "outer_px"):
        assert getattr(annulus, name) == pytest.approx(getattr(TRUE, name), abs=4 * RING_PX), name


def test_a_rim_no_brighter_than_the_tip_is_found_by_what_moves() -> None:
    frames = [frame(k) for k in range(8)]
    with pytest.raises(NotSeen):
        find_annulus(np.mean(frames, axis=0))
    ring = find_ring(frames)
    assert_is_true(ring.annulus)
    assert ring.handle is not None, "no single frame shows that rim"


def test_a_still_specular_ring_is_not_taken_for_the_rim() -> None:
    frames = [frame(k, specular_px=55.0) for k in range(8)]
    assert find_annulus(np.mean(frames, axis=0)).inner_px == pytest.approx(55, abs=5), "light alone is misled"
    assert_is_true(find_ring(frames).annulus)


def test_a_still_reflection_inside_the_rim_is_followed_while_the_rim_is_where_the_wall_ends() -> None:
    y, x = np.mgrid[:240, :320].astype(float)
    within = np.hypot(x - TRUE.outer_x_px, y - TRUE.outer_y_px) - 85
    glare = (0.8 * np.exp(-0.5 * (within / 8) ** 2) * (within <= 0)).astype(np.float32)
    ring = find_ring([np.clip(frame(k, wall=0.12) + glare, 0, 1) for k in range(8)])
    assert ring.handle is not None
    assert ring.handle.radius_px == pytest.approx(85, abs=0.5)
    assert ring.annulus.outer_px == pytest.approx(TRUE.outer_px, abs=2)
    assert ring.annulus.inner_px == pytest.approx(TRUE.inner_px, abs=2)


def test_where_light_and_movement_agree_light_places_the_rims() -> None:
    frames = [frame(k, tip=0.02) for k in range(6)]
    ring = find_ring(frames)
    assert ring.handle is None
    assert ring.annulus == find_annulus(np.mean(frames, axis=0, dtype=np.float32))


def test_what_moves_is_what_the_probe_sees_move() -> None:
    """A probe that wanders in the image moves with all that is its own."""
    ring = find_ring([frame(k, dx=float(dx)) for k, dx in enumerate((-3, -1, 0, 0, 2, 3, 1, -2))])
    assert ring.annulus.inner_px == pytest.approx(TRUE.inner_px, abs=4 * RING_PX)
    assert ring.annulus.inner_x_px - ring.annulus.outer_x_px == pytest.approx(-2, abs=4 * RING_PX)


def test_frames_that_are_all_the_same_say_nothing() -> None:
    still = frame(3, tip=0.02)
    noise = np.random.default_rng(0).normal(0, 0.004, (6, 240, 320)).astype(np.float32)
    ring = find_ring([still + of for of in noise])
    assert ring.moving_rim is None
    with pytest.raises(NotSeen):
        find_ring([frame(3) + of for of in noise])


def test_a_single_picture_is_judged_by_its_light() -> None:
    ring = find_ring([frame(1, tip=0.02)])
    assert ring.moving is None
    assert_is_true(ring.annulus)


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
