"""What a fit to a tube says of an endoscope, from a fit put in by hand: every share of every error, and the doubts."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from printed_tube import TUBE

from endoct.base.arrays import Coordinates
from endoct.modalities.endoscope import tube_calibration
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.modalities.endoscope.tube_calibration import RIM_PX, ROLLING_RAD, WANDER_MM, _Fitted, _measurement
from endoct.modalities.endoscope.tube_fit import ANGLE, DISTANT, DISTORTED, FOCAL, N_PARAMETERS, RADIUS, TubeModel
from endoct.modalities.endoscope.tube_marks import AXIAL, HELICAL, Darkness, Marks
from endoct.modalities.tube.fitting import TubeFit
from endoct.modalities.tube.measurement import Measurement

RIMS = 60.0, 180.0
FOCAL_PX, DISTANCE_MM = 640.0, 1.6
APEX_MM = 9.0 - 0.21 * np.arange(8)  # the last frame is nearest the mouth
TURN_RAD = -0.3 + 0.002 * np.arange(8)
R_PX = np.linspace(62, 178, 5)
MARKS = Marks(
    np.array([0, 0, 7, 7, 7, 7]), np.array([70.0, 90, 110, 130, 150, 170]), np.zeros(6),
    np.array([HELICAL, AXIAL, AXIAL, AXIAL, AXIAL, HELICAL]), np.array([False] * 5 + [True]), np.zeros(6),
)  # fmt: skip
RESIDUAL_MM = np.array([0.01, 0.9, 0.03, -0.03, 0.0, 0.02])
TARGET = TUBE.model_copy(update={"standard_errors": TUBE.standard_errors.model_copy(update={"z_mm": 0.007})})
STRETCH = 0.007 / 3.5  # rings lie 3.5 mm apart


def fitted(sigmas: dict[int, float], *, sign: int = 1, apex_mm: Coordinates = APEX_MM) -> _Fitted:
    values = np.zeros(N_PARAMETERS)
    values[ANGLE], values[FOCAL], values[DISTANT] = math.radians(43), math.log(FOCAL_PX), math.log(DISTANCE_MM)
    sigma = np.zeros(N_PARAMETERS)
    sigma[list(sigmas)] = list(sigmas.values())
    model = TubeModel(MARKS, TARGET, sign, 1, RIMS)
    return _Fitted(model, TubeFit(values, np.diag(sigma**2), np.ones(6, bool), RESIDUAL_MM), apex_mm, TURN_RAD)


def measured(sigmas: dict[int, float] | None = None, **changes: Any) -> Measurement:
    optics = changes.get("fitted") or fitted(sigmas or {})
    annulus = SimpleNamespace(
        columns=lambda x: 2 * x, outer_x_px=np.float64(150.0), outer_y_px=310.0, inner_px=60.5, outer_px=180.5
    )
    acquisition = SimpleNamespace(travel="unknown", pitch_mm=0.2, feed_pitch_mm=0.2, positions_mm=None)
    for name, value in changes.get("acquisition", {}).items():
        setattr(acquisition, name, value)
    calibration: Any = SimpleNamespace(annuli=[annulus], z_mm=np.arange(8) * 0.2)
    darkness = Darkness(np.zeros((8, 5, 4), np.float32), R_PX, np.log(np.full((5, 4), 0.5, np.float32)))
    pose: Any = SimpleNamespace(direction=changes.get("direction", -1), sense=changes.get("sense", 1))
    whole: Any = acquisition
    return _measurement(whole, calibration, darkness, pose, optics)


def optics(half_angle_rad: float = math.radians(43), focal_px: float = FOCAL_PX, radius_mm: float = 1.25) -> ConeOptics:
    return ConeOptics(*RIMS, half_angle_rad, focal_px, DISTANCE_MM, radius_mm)


def errors(measurement: Measurement) -> dict[str, float]:
    return {each.name: each.sigma for each in measurement.quantities}


def test_values_are_those_of_the_fitted_cone() -> None:
    true, found = optics(), {each.name: each.value for each in measured().quantities}
    assert found["visible_length_mm"] == pytest.approx(true.visible_length_mm)
    middle = true.ahead_mm(np.array([119.5, 120.5]))
    assert found["mm_per_px"] == pytest.approx(middle[1] - middle[0])
    for name, r_px in (("slant_inner_deg", 60.0), ("slant_deg", 120.0), ("slant_outer_deg", 180.0)):
        assert found[name] == pytest.approx(math.degrees(math.atan(true.slant(np.array([r_px]))[0])))
    assert found["cone_half_angle_deg"] == pytest.approx(43)
    assert (found["focal_px"], found["mirror_distance_mm"]) == pytest.approx((FOCAL_PX, DISTANCE_MM))
    assert found["distortion"] == 0
    assert found["theta_origin_rad"] == pytest.approx(2 * np.pi + TURN_RAD[7])
    assert found["feed_pitch_mm"] == pytest.approx(0.21)


def test_what_goes_into_the_sidecar() -> None:
    keys = measured().keys
    assert keys["annulus"] == {"x": 300.0, "y": 310.0, "inner_px": 60.5, "outer_px": 180.5}
    assert (keys["outer_rim"], keys["travel"]) == ("ahead", "out")
    assert keys["distortion"] == (0.0,)
    assert keys["focal_px"] == pytest.approx(FOCAL_PX)
    behind = measured(fitted=fitted({}, sign=-1), direction=1).keys
    assert (behind["outer_rim"], behind["travel"]) == ("behind", "in")
    assert "mm_per_px" not in measured().standard_errors
    assert set(measured().standard_errors) >= {"cone_half_angle_deg", "focal_px", "theta_origin_rad", "feed_pitch_mm"}


def test_lengths_err_by_the_tubes_own_error_and_by_the_rims() -> None:
    sigma = errors(measured())
    middle = np.diff(optics().ahead_mm(np.array([119.5, 120.5])))[0]
    assert sigma["mm_per_px"] == pytest.approx(STRETCH * middle)
    rims = math.sqrt(2) * RIM_PX * middle
    assert sigma["visible_length_mm"] == pytest.approx(math.hypot(STRETCH * optics().visible_length_mm, rims))
    others = (
        "slant_inner_deg",
        "slant_deg",
        "slant_outer_deg",
        "cone_half_angle_deg",
        "focal_px",
        "mirror_distance_mm",
    )
    assert [sigma[name] for name in others] == pytest.approx([0] * 6, abs=1e-9)


def test_every_number_errs_as_the_parameters_that_it_follows_from() -> None:
    focal = errors(measured({FOCAL: 0.02}))
    assert focal["focal_px"] == pytest.approx(0.02 * FOCAL_PX)
    assert (focal["mirror_distance_mm"], focal["cone_half_angle_deg"]) == (0, 0)
    by_focal = [optics(focal_px=FOCAL_PX * factor) for factor in (0.98, 1.02)]
    half = abs(by_focal[1].visible_length_mm - by_focal[0].visible_length_mm) / 2
    none = errors(measured())["visible_length_mm"]
    assert focal["visible_length_mm"] == pytest.approx(math.hypot(half, none), rel=0.01)
    assert errors(measured({DISTANT: 0.05}))["mirror_distance_mm"] == pytest.approx(0.05 * DISTANCE_MM)
    angle = errors(measured({ANGLE: math.radians(0.5)}))
    assert angle["cone_half_angle_deg"] == pytest.approx(0.5)
    assert angle["slant_deg"] == pytest.approx(1.0, rel=0.02)  # a mirror turns a view by twice its own turn
    assert errors(measured({DISTORTED: 0.01}))["distortion"] == pytest.approx(0.01 / (RIMS[1] / FOCAL_PX) ** 2)
    radius = errors(measured({RADIUS: 0.01}))["mm_per_px"]
    wider = np.diff([np.diff(optics(radius_mm=r).ahead_mm(np.array([119.5, 120.5])))[0] for r in (1.24, 1.26)])[0] / 2
    assert radius == pytest.approx(math.hypot(wider, errors(measured())["mm_per_px"]), rel=0.01)


def test_the_origin_of_theta_errs_by_its_frames_points_and_as_the_probe_wanders() -> None:
    """Of frame 7 the axial groove counts alone: ±0.03 and 0 scatter by √(2/3)·0.03."""
    scatter = math.sqrt(2 / 3) * 0.03
    assert errors(measured())["theta_origin_rad"] == pytest.approx(math.hypot(scatter, WANDER_MM) / 1.25)
    few = fitted({}, apex_mm=APEX_MM[::-1].copy())  # frame 0 has one point of it
    assert errors(measured(fitted=few))["theta_origin_rad"] == pytest.approx(
        math.hypot(ROLLING_RAD * 1.25, WANDER_MM) / 1.25
    )


def test_the_feed_errs_by_its_steps_and_by_the_tube() -> None:
    steps = np.array([0.20, 0.24, 0.20, 0.24, 0.20, 0.24, 0.20])
    uneven = fitted({}, apex_mm=np.concatenate([[0.0], np.cumsum(steps)]))
    (feed,) = [each for each in measured(fitted=uneven).quantities if each.name == "feed_pitch_mm"]
    slope = np.polyfit(np.arange(8), uneven.apex_mm, 1)[0]
    assert feed.value == pytest.approx(slope)
    by_steps = np.std(steps) / math.sqrt(7)
    assert feed.sigma == pytest.approx(math.hypot(by_steps, STRETCH * slope))
    positions = {"positions_mm": tuple(0.1 * np.arange(8))}  # half as far apart as they were stated to be fed
    (halved,) = [each for each in measured(acquisition=positions).quantities if each.name == "feed_pitch_mm"]
    assert halved.value == pytest.approx(0.2 * 2.1)
    for unknown in ({"pitch_mm": None}, {"feed_pitch_mm": None}):
        assert "feed_pitch_mm" not in measured(acquisition=unknown).keys
    assert (
        tube_calibration._feed(SimpleNamespace(pitch_mm=0.2, feed_pitch_mm=0.2), fitted({}, apex_mm=APEX_MM[:2]))
        is None
    )  # type: ignore[arg-type]


def test_doubts() -> None:
    assert measured().doubts == ()
    assert [doubt.code for doubt in measured(acquisition={"travel": "in"}).doubts] == ["travel-against-tube"]
    assert measured(acquisition={"travel": "out"}).doubts == ()
    assert [doubt.code for doubt in measured(sense=-1).doubts] == ["image-mirrored"]
    for number in (FOCAL, DISTANT):
        assert measured({number: 0.099}).doubts == ()
        (doubt,) = measured({number: 0.12}).doubts
        assert (doubt.code, doubt.value) == ("optics-not-separable", pytest.approx(0.12))
        assert "apart to 12% alone" in doubt.what
    rolling = replace(fitted({}), turn_rad=0.1 * (np.arange(8) % 2))  # spreads by 0.05 about its mean
    assert measured(fitted=rolling).doubts == ()
    (doubt,) = measured(fitted=replace(rolling, turn_rad=1.2 * rolling.turn_rad)).doubts
    assert (doubt.code, doubt.value) == ("origin-not-kept", pytest.approx(0.06))
    assert "rolled by 3° (rms)" in doubt.what


def test_panels_show_points_about_the_model() -> None:
    panels = {panel.title: panel for panel in measured().panels}
    assert len(panels) == 7
    along = panels["z along the annulus, by the helical groove"]
    assert along.x == pytest.approx([70.0])  # outside rings
    lead_mm = 0.01 * TUBE.helix_lead_mm / (2 * math.pi * 1.25)  # 10 µm aside are so much along
    assert along.y == pytest.approx(optics().z_mm(np.array([70.0])) + lead_mm)
    assert panels["helical groove off the model"].y == pytest.approx([10.0])
    assert panels["helical groove off the model, in rings"].y == pytest.approx([20.0])
    assert panels["axial groove off the model"].y == pytest.approx([900.0, 30, -30, 0])
    assert panels["place of the frames"].y == pytest.approx(APEX_MM)
    assert panels["light along the annulus (flat field)"].y == pytest.approx([0.5] * 5)
    slant = panels["slant of the view"].line
    assert slant is not None
    assert slant[:, 1] == pytest.approx(np.degrees(np.arctan(optics().slant(R_PX))))
