"""What a fitted tube says of an OCT, and how sure it is, by values put in by hand."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from doubted import codes_of
from printed_tube import TUBE

from endoct.modalities.oct import tube_calibration
from endoct.modalities.oct.tube_calibration import LINE_OF_WAVE, TURNING_RAD, _measurement
from endoct.modalities.oct.tube_fit import LEAN_X, LEAN_Y, PITCH, SCALE, THETA, X, Y
from endoct.modalities.tube.measurement import Measurement

N = 13
SIGMA = {SCALE: 0.002, PITCH: 0.001, THETA: 0.003, X: 0.01, Y: 0.02, LEAN_X: 0.001, LEAN_Y: 0.002}
STARTS_RAD = np.array([0.1, -0.1, 0.1, -0.1])


def measured(
    monkeypatch: pytest.MonkeyPatch, *, direction: int = 1, backwards: bool = False, sense: int = 1,
    shape_sigma_rad: float = np.nan, glass_mm: float = 0.0, travel: str = "unknown", medium_index: float = 1.0,
    starts_rad: np.ndarray = STARTS_RAD,
) -> Measurement:  # fmt: skip
    values, sigma = np.zeros(N), np.zeros(N)
    values[[SCALE, PITCH, THETA, X, Y, LEAN_X, LEAN_Y]] = 0.01, -1.02, -0.5, 0.3, 0.4, 0.03, 0.04
    for k, each in SIGMA.items():
        sigma[k] = each
    z_mm = np.linspace(0, 7, 8)
    acquisition = SimpleNamespace(axial_pixel_mm=0.005, pullback_pitch_mm=0.2, travel=travel, medium_index=medium_index)
    rotation = SimpleNamespace(shape_sigma_rad=np.full(4, shape_sigma_rad), start_rad=starts_rad)
    calibration: Any = SimpleNamespace(
        acquisition=acquisition, rotation=rotation, glass=SimpleNamespace(thickness_mm=glass_mm)
    )
    model: Any = SimpleNamespace(target=TUBE, beams=SimpleNamespace(z_mm=z_mm[::-1] if backwards else z_mm))
    fit: Any = SimpleNamespace(values=values, covariance=np.diag(sigma**2), sigma_of=lambda of: of(values) * 0 + 0.004)
    pose: Any = SimpleNamespace(direction=direction, sense=sense, z_of=lambda z: z)
    monkeypatch.setattr(tube_calibration, "_panels", lambda *_: ())
    monkeypatch.setattr(tube_calibration, "first_sample_mm", lambda *_: np.array([1.25]))
    return _measurement(calibration, model, fit, pose, 0.006)


@pytest.mark.parametrize(
    ("direction", "backwards", "travel"), [(1, False, "in"), (-1, False, "out"), (1, True, "out"), (-1, True, "in")]
)
def test_the_way_along_the_tube_is_that_of_its_rings(
    direction: int, backwards: bool, travel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = measured(monkeypatch, direction=direction, backwards=backwards)
    assert found.keys["travel"] == travel
    other = "out" if travel == "in" else "in"
    assert "travel" in " ".join(
        codes_of(measured(monkeypatch, direction=direction, backwards=backwards, travel=other).doubts)
    )


@pytest.mark.parametrize("turning_rad", [np.nan, 0.02])
def test_keys_and_their_standard_errors_are_those_of_the_fit(
    turning_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = measured(monkeypatch, shape_sigma_rad=turning_rad, sense=-1)
    turning = TURNING_RAD if np.isnan(turning_rad) else turning_rad
    assert found.keys["handedness"] == "mirrored"
    assert found.keys["axial_pixel_mm"] == pytest.approx(0.005 * math.exp(0.01))
    assert found.keys["pullback_pitch_mm"] == pytest.approx(0.2 * 1.02)
    assert found.keys["theta_origin_rad"] == pytest.approx(2 * math.pi - 0.5)
    errors = {each.name: each.sigma for each in found.quantities}
    assert errors["axial_pixel_mm"] == pytest.approx(0.005 * math.exp(0.01) * 0.002)
    assert errors["theta_origin_rad"] == pytest.approx(math.hypot(0.003, turning))
    # the groove's lead is 7 mm and so is what was seen of it: the line through a wave rises by 6/π of its amplitude
    bent = LINE_OF_WAVE * turning * 7 / (2 * math.pi * 7)
    share = math.sqrt((0.001 / 1.02) ** 2 + TUBE.stretch_sigma**2 + bent**2)
    assert errors["pullback_pitch_mm"] == pytest.approx(0.2 * 1.02 * share)
    off = {each.name: (each.value, each.sigma) for each in found.quantities[-2:]}
    assert off["capillary_off_axis_mm"] == pytest.approx((0.5, math.hypot(0.01, 0.02)))
    assert off["capillary_lean_rad"] == pytest.approx((0.05, math.hypot(0.001, 0.002)))


def test_where_depth_begins_is_known_by_the_glass_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown = measured(monkeypatch)
    assert "first_sample_mm" not in unknown.keys
    assert "depth-zero-unknown" in codes_of(unknown.doubts)
    known = measured(monkeypatch, glass_mm=0.2)
    assert known.keys["first_sample_mm"] == 1.25
    quantity = known.quantities[1]
    assert quantity.name == "first_sample_mm"
    assert quantity.sigma == pytest.approx(math.sqrt(0.004**2 + 0.003**2 + (0.46 * 0.0025) ** 2 + 0.001**2))
    assert "depth-zero-unknown" not in codes_of(known.doubts)


def test_starts_anywhere_and_a_medium_are_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    (origin, *_) = (doubt for doubt in measured(monkeypatch).doubts if doubt.code == "origin-not-kept")
    assert origin.value == pytest.approx(0.1)
    steady = measured(monkeypatch, starts_rad=np.array([3.12, -3.13, 3.14, -3.14]), glass_mm=0.2)
    assert codes_of(steady.doubts) == []
    wet = measured(monkeypatch, medium_index=1.33, starts_rad=np.zeros(4), glass_mm=0.2)
    assert codes_of(wet.doubts) == ["index-not-separable"]
    assert "1.33" in wet.doubts[0].what
