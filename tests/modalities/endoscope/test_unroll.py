"""Samples of a strip: means over their parts, where all of these are seen, and how much a row counts."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.unroll import LEAST_WEIGHT, UNSEEN, _average, _row_weight, _subdivided, _write_seen


def test_parts_of_a_cell_lie_evenly_around_its_middle() -> None:
    assert _subdivided(np.array([1.0, 2.0]), 1.0, 2) == pytest.approx([0.75, 1.25, 1.75, 2.25])
    assert _subdivided(np.array([1.0, 3.0]), 0.6, 3) == pytest.approx([0.8, 1.0, 1.2, 2.8, 3.0, 3.2])
    assert _subdivided(np.array([1.0, 3.0]), 0.6, 1) == pytest.approx([1, 3])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_saturated_pixels_are_not_seen(dtype: Any) -> None:
    image = np.empty((1, 4), np.float32)
    _write_seen(np.array([[0, 50, 199, 200]], dtype), np.float32(200), 200.0, image)
    assert image[0, :3] == pytest.approx([0, 0.25, 0.995])
    assert image[0, 3] == np.float32(UNSEEN) > 1


def test_a_sample_is_the_mean_of_its_parts_over_their_light_and_seen_where_all_are() -> None:
    light = np.array([[0.2, 0.4, 0.6, 0.5], [0.4, 0.8, 1.0, 1.1]], np.float32)
    on_bone = np.array([[0.5, 0.5, 1.0, 1.0], [1.0, 0.5, 1.0, 1.0]], np.float32)
    intensity, seen = np.empty((1, 2), np.float32), np.empty((1, 2), np.bool_)
    _average(light, on_bone, 2.0, intensity, seen)
    # (0.4 + 0.8 + 0.4 + 1.6) / 4 at twice the exposure; of the other a part is beyond full scale
    assert seen.tolist() == [[True, False]]
    assert intensity[0].tolist() == pytest.approx([0.4, 0.0])
    dark = np.zeros((2, 2), np.float32)
    intensity, seen = np.empty((1, 1), np.float32), np.empty((1, 1), np.bool_)
    _average(dark, np.ones((2, 2), np.float32), 1.0, intensity, seen)
    assert seen.all()
    assert 0 < intensity[0, 0] < 0.01, "the darkest that is told apart"


def test_rows_fade_to_the_edges_of_a_strip_and_count_by_their_circle() -> None:
    """Circles of 100 px more a mm from 50 px on; a strip of ±1 mm fades over 0.25 of its length, 0.5 mm."""
    optics = SimpleNamespace(r_px=lambda z_mm: 50 + 100 * np.asarray(z_mm))
    calibration: Any = SimpleNamespace(optics=optics, taper=0.25)
    at_mm = np.array([-0.25, 0.0, 0.25, 0.75, 1.0])
    fade = np.array([1, 1, 1, np.sin(np.pi / 4) ** 2, LEAST_WEIGHT])
    weight = _row_weight(calibration, at_mm, 1.0)
    assert weight == pytest.approx(fade * (50 + 100 * at_mm) / 50)


def test_a_place_of_the_wall_is_seen_where_the_roll_and_the_sway_put_it() -> None:
    """Along rays that sway by 0.1·cos θ: at θ = 0 that is 0.1, at π/2 nearly nothing."""
    calibration: Any = SimpleNamespace(sway_rad=np.array([[0.1, 0.0], [0.0, 0.0]]), roll_rad=np.array([0.3, -0.2]))
    angle = EndoscopeCalibration.image_angle(calibration, 0, np.array([0.0, np.pi / 2, np.pi]))
    ray = np.array([-0.1 * np.cos(0.1), np.pi / 2, np.pi + 0.1 * np.cos(0.1)])
    assert angle == pytest.approx([-0.1 * np.cos(0.1) - 0.3, ray[1] - 0.3, ray[2] - 0.3], abs=1e-3)
    np.testing.assert_allclose(EndoscopeCalibration.image_angle(calibration, 1, np.array([1.0])), [1.2])
