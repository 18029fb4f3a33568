"""What a survey's numbers per frame are, and where in a frame the wall's θ is seen: by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.modalities.endoscope.calibration import EndoscopeCalibration, per_frame_values


def values(*, assumed: bool, axis: object) -> dict[str, Any]:
    annuli = [
        SimpleNamespace(
            columns=lambda x: 2 * x, outer_x_px=100.0 + k, outer_y_px=90.0 + k, inner_px=30.0, outer_px=80.0,
            inner_x_px=101.0 + k, inner_y_px=91.0,
        )
        for k in range(3)
    ]  # fmt: skip
    optics = SimpleNamespace(
        assumed=assumed, bore_radius_mm=2.0, r_px=lambda z_mm: 10 * z_mm, slant=lambda r_px: r_px / 100
    )
    motion = SimpleNamespace(
        feed=SimpleNamespace(correlation=np.array([np.nan, 0.9, 0.8]), confidence=np.ones(3), trusted=np.ones(3, bool)),
        band=SimpleNamespace(optics=optics, outward_mm=np.array([1.0, 2.0, 6.0])),
    )
    places = SimpleNamespace(
        z_mm=np.array([5.0, 4.5, 4.1]), roll_rad=np.array([-0.5, 0.5, 7.0]), sway_rad=np.array([[0.1, 0.2]] * 3)
    )
    frames = SimpleNamespace(annuli=annuli, annulus_found=np.ones(3, bool), saturated_fraction=np.full(3, 0.01))
    of: tuple[Any, ...] = (frames, motion, SimpleNamespace(axis=axis), places, np.log([1.0, 2.0, 0.5]))
    return per_frame_values(*of)


def test_numbers_of_frames_are_in_the_units_of_their_names() -> None:
    of = values(assumed=False, axis=object())
    assert of["roll_rad"] == pytest.approx([2 * np.pi - 0.5, 0.5, 7 - 2 * np.pi])
    assert of["feed_mm"][1:] == pytest.approx([-0.5, -0.4])
    assert np.isnan(of["feed_mm"][0])
    assert of["exposure"] == pytest.approx([1.0, 2.0, 0.5])
    assert of["view_slant"] == pytest.approx([0.3] * 3)
    assert of["annulus_x_px"].tolist() == [200, 202, 204]  # in pixels of the files, y as it is
    assert of["annulus_y_px"].tolist() == [90, 91, 92]
    assert of["annulus_inner_x_px"].tolist() == [202, 204, 206]
    assert (of["probe_offset_x_mm"][0], of["probe_offset_y_mm"][0]) == pytest.approx((-0.4, 0.2))


def test_what_an_assumed_cone_cannot_tell_is_not_a_number() -> None:
    of = values(assumed=True, axis=None)
    for name in ("view_slant", "probe_offset_x_mm", "probe_offset_y_mm"):
        assert np.isnan(of[name]).all()


def test_the_wall_is_seen_at_the_angle_from_which_it_follows() -> None:
    """θ = image angle + roll + sway · (cos, sin) of their sum; solved by two steps, so that sway² · sway is left."""
    sway = 0.02, -0.03
    of: Any = SimpleNamespace(sway_rad=np.array([[9.0, 9.0], sway]), roll_rad=np.array([9.0, 0.7]))
    theta_rad = np.linspace(0, 6, 25)
    ray = EndoscopeCalibration.image_angle(of, 1, theta_rad) + 0.7
    np.testing.assert_allclose(ray + sway[0] * np.cos(ray) + sway[1] * np.sin(ray), theta_rad, atol=5e-5)
