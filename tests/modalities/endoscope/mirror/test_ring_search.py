"""The ring by what moves: drawn rings whose wall goes by, with tips and reflections that mislead light alone."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import RING_PX

from endoct.base.errors import NotSeen
from endoct.modalities.endoscope.mirror.annulus import Annulus, find_annulus
from endoct.modalities.endoscope.mirror.ring_search import find_ring

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
