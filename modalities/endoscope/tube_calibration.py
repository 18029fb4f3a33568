"""Calibration of a cone-mirror endoscope by a recording of a printed tube."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.frame_stream import EndoscopeRecording
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.optics import ASSUMED_LENGTH, ConeOptics, scale_is_stated
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.survey import survey_frames
from endoct.modalities.endoscope.tube_fit import ANGLE, DISTANT, FOCAL, TubeModel, optics_of
from endoct.modalities.endoscope.tube_marks import (
    HELICAL,
    Darkness,
    darkness_map,
    darkness_of_tube,
    examine_darkness,
    find_marks,
    on_tube,
)
from endoct.modalities.tube.fitting import TubeFit
from endoct.modalities.tube.locating import TubePose, check_rings, clear_pose
from endoct.modalities.tube.measurement import (
    KeyValue,
    Measurement,
    Panel,
    Quantity,
    doubts_of_origin,
    doubts_of_travel,
)
from endoct.modalities.tube.target import Target

BY_FEED = np.arange(0.86, 1.141, 0.02)
"""These ratios of true over assumed length of the annulus are tried where the feed or the sidecar gave that length."""
UNKNOWN = np.geomspace(0.5, 2.0, 70)
"""These are tried where nothing did."""
LEAST_POINTS = 300
ROUNDS = 3
ALONE_SIGMAS = 0.1
"""A number with a larger relative standard error cannot be distinguished from others."""
RIM_PX = 0.4
"""By how much a blurred rim is found off its place. Inner and outer: −0.1 and 0.2 in the preset `tube`, seeds 30–37;
0.2 and −0.35 in independent recordings, seeds 10–19."""
ROLLING_RAD = 0.05
WANDER_MM = 0.02
"""How far a probe wanders off its mean place in the bore, which turns what a frame sees."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The model with its points, its fit, and where circles lie on the tube: z of frames' apex, and their turn."""

    model: TubeModel
    fit: TubeFit
    apex_mm: Coordinates
    turn_rad: Coordinates

    @property
    def optics(self) -> ConeOptics:
        """The lens and the mirror as they were fitted."""
        return optics_of(self.model, self.fit.values)

    @property
    def sigma(self) -> Coordinates:
        """Standard errors of the fitted values, float64 (n,)."""
        return np.sqrt(np.diag(self.fit.covariance))


def calibrate_endoscope(stream: FrameStream, parameters: EndoscopeParameters, target: Target) -> Measurement:
    """Return what a recording of a tube says of the endoscope.

    Raises :class:`NotSeen` where it does not show the tube's marks, or too little of them.
    """
    acquisition = cast(EndoscopeAcquisition, stream.acquisition)
    knows_scale = scale_is_stated(acquisition) or acquisition.pitch_mm is not None
    if not knows_scale and acquisition.positions_mm is None:
        begun = {"visible_length_mm": ASSUMED_LENGTH * target.radius_mm}
        stream = replace(cast(EndoscopeRecording, stream), acquisition=acquisition.model_copy(update=begun))
    calibration = survey_frames(stream, parameters)
    darkness = examine_darkness(stream, calibration)
    image, row_z_mm = darkness_map(darkness, calibration)
    scales = BY_FEED if knows_scale or acquisition.positions_mm is not None else UNKNOWN
    pose = clear_pose(image, row_z_mm, target, partial(darkness_of_tube, target), scales)
    check_rings(target, pose.z_of(row_z_mm))
    fitted = _fit(darkness, calibration, pose, target)
    return _measurement(acquisition, calibration, darkness, pose, fitted)


def _fit(darkness: Darkness, calibration: EndoscopeCalibration, pose: TubePose, target: Target) -> _Fitted:
    optics, sign = calibration.optics, calibration.optics.rim_sign * pose.direction
    rims = optics.inner_px, optics.outer_px
    bore_mm, floor_mm, turn = on_tube(pose, calibration, darkness.r_px, target.ring_depth_mm)
    start: Coordinates | None = None
    for _ in range(ROUNDS):
        marks = find_marks(darkness, bore_mm, floor_mm, turn, pose.sense, target)
        if marks.frame.size < LEAST_POINTS or not marks.in_ring.any() or (marks.line == HELICAL).mean() < 0.2:
            raise EndoctError(
                "too little is seen of the tube's grooves",
                found=f"{marks.frame.size} places, {int(marks.in_ring.sum())} of them in rings",
                expected=f"{LEAST_POINTS} at least, some of them in rings",
                remedy="ink both grooves, light the tube evenly, and record it frame by frame",
            )
        model = TubeModel(marks, target, sign, pose.sense, rims)
        fit = model.fit(model.start(optics, pose.scale) if start is None else start)
        model = TubeModel(marks.of(fit.kept), target, sign, pose.sense, rims)
        fit = model.fit(fit.values)
        start = fit.values
        apex_mm, turn = _places_of_frames(model, start, bore_mm, darkness.r_px, len(turn))
        bore_mm = apex_mm[:, None] + _circles(model, start, darkness.r_px)
        floor_mm = bore_mm + target.ring_depth_mm * optics_of(model, start).slant(darkness.r_px)
    return _Fitted(model, fit, apex_mm, turn)


def _circles(model: TubeModel, values: Coordinates, r_px: Coordinates) -> Coordinates:
    """Return z of circles from the apex, on the tube's bore."""
    optics = optics_of(model, values)
    return model.sign * optics.ahead_mm(r_px)


def _places_of_frames(
    model: TubeModel, values: Coordinates, about_mm: Coordinates, r_px: Coordinates, n: int
) -> tuple[Coordinates, Coordinates]:
    """Return z of every frame's apex and its turn, on the tube; those of frames without both grooves interpolated."""
    frames, apex_mm, roll = model.frames(values)
    lead = model.target.helix_lead_mm
    guess = np.median(about_mm - _circles(model, values, r_px), axis=1)
    apex_mm = apex_mm + lead * np.round((guess[frames] - apex_mm) / lead)
    every = np.arange(n)
    along = guess + np.interp(every, frames, apex_mm - guess[frames])
    return along, np.interp(every, frames, np.unwrap(roll))


def _measurement(
    acquisition: EndoscopeAcquisition,
    calibration: EndoscopeCalibration,
    darkness: Darkness,
    pose: TubePose,
    fitted: _Fitted,
) -> Measurement:
    inward = pose.direction * (calibration.z_mm[-1] - calibration.z_mm[0]) > 0
    first = int(np.argmin(fitted.apex_mm))
    theta_rad = float(np.mod(fitted.turn_rad[first], 2 * np.pi))
    quantities = [
        *_optical(fitted),
        Quantity("theta_origin_rad", "θ of the image's +x axis", theta_rad, _turn_sigma(fitted, first), "rad"),
    ]
    keys = _keys(calibration, fitted) | {"travel": "in" if inward else "out", "theta_origin_rad": theta_rad}
    if (feed := _feed(acquisition, fitted)) is not None:
        keys["feed_pitch_mm"], error = feed
        error = math.hypot(error, feed[0] * fitted.model.target.stretch_sigma)
        quantities.append(Quantity("feed_pitch_mm", "feed between frames", feed[0], error, "mm"))
    doubts = _doubts(acquisition, pose, inward, fitted)
    return Measurement(keys, tuple(quantities), _panels(darkness, fitted), doubts)


def _keys(calibration: EndoscopeCalibration, fitted: _Fitted) -> dict[str, KeyValue]:
    """Return what the sidecar says of the optics and of the annulus, which is that of the first frame."""
    optics, annulus = fitted.optics, calibration.annuli[0]
    return {
        "cone_half_angle_deg": math.degrees(fitted.fit.values[ANGLE]),
        "focal_px": optics.focal_px,
        "mirror_distance_mm": optics.mirror_distance_mm,
        "distortion": optics.distortion,
        "outer_rim": "ahead" if fitted.model.sign > 0 else "behind",
        "annulus": {
            "x": float(annulus.columns(np.float64(annulus.outer_x_px))),
            "y": annulus.outer_y_px,
            "inner_px": annulus.inner_px,
            "outer_px": annulus.outer_px,
        },
    }


def _optical(fitted: _Fitted) -> Iterator[Quantity]:
    """Yield the quantities of the optics; lengths err by the tube's own error too, that of the annulus by its rims."""
    optics, sigma, stretch = fitted.optics, fitted.sigma, fitted.model.target.stretch_sigma
    middle_px = (optics.inner_px + optics.outer_px) / 2

    def derived(values: Coordinates) -> Coordinates:
        of = optics_of(fitted.model, values)
        slant = np.degrees(np.arctan(of.slant(np.array([of.inner_px, middle_px, of.outer_px]))))
        mm_per_px = np.abs(np.diff(of.z_mm(middle_px + np.array([-0.5, 0.5]))))
        return np.concatenate([[of.visible_length_mm], mm_per_px, slant, of.distortion])

    numbers, errors = derived(fitted.fit.values), fitted.fit.sigma_of(derived)
    errors[:2] = np.hypot(errors[:2], numbers[:2] * stretch)
    errors[0] = np.hypot(errors[0], math.sqrt(2) * RIM_PX * numbers[1])
    half_angle, focal, distance = math.degrees(fitted.fit.values[ANGLE]), optics.focal_px, optics.mirror_distance_mm
    for name, title, value, error, unit in (
        ("mm_per_px", "mm along z per pixel, mid annulus", numbers[1], errors[1], "mm"),
        ("visible_length_mm", "length that the annulus shows", numbers[0], errors[0], "mm"),
        ("slant_inner_deg", "slant of the view, inner rim", numbers[2], errors[2], "deg"),
        ("slant_deg", "slant of the view, mid annulus", numbers[3], errors[3], "deg"),
        ("slant_outer_deg", "slant of the view, outer rim", numbers[4], errors[4], "deg"),
        ("cone_half_angle_deg", "half angle of the cone", half_angle, math.degrees(sigma[ANGLE]), "deg"),
        ("focal_px", "focal length", focal, focal * sigma[FOCAL], "px"),
        ("mirror_distance_mm", "pupil to apex", distance, distance * sigma[DISTANT], "mm"),
        ("distortion", "k1 of the lens", numbers[5], errors[5], "1"),
    ):
        yield Quantity(name, title, float(value), float(error), unit)


def _turn_sigma(fitted: _Fitted, frame: int) -> float:
    """Return the standard error of a frame's turn: by the scatter of its points, and as the probe wanders."""
    marks, target = fitted.model.marks, fitted.model.target
    of_frame = fitted.fit.residual_mm[(marks.frame == frame) & (marks.line != HELICAL)]
    by_points_mm = float(np.std(of_frame)) if of_frame.size > 2 else ROLLING_RAD * target.radius_mm
    return math.hypot(by_points_mm, WANDER_MM) / target.radius_mm


def _feed(acquisition: EndoscopeAcquisition, fitted: _Fitted) -> tuple[float, float] | None:
    """Return the feed between frames, mm, and its standard error; None where no constant feed is stated."""
    pitch_mm, n = acquisition.pitch_mm, fitted.apex_mm.size
    if pitch_mm is None or acquisition.feed_pitch_mm is None or n < 3:
        return None
    nominal = acquisition.positions_mm
    along = np.asarray(nominal if nominal is not None else pitch_mm * np.arange(n), np.float64)
    slope, covariance = np.polyfit(along, fitted.apex_mm, 1, cov=True)
    steps = np.diff(fitted.apex_mm)
    # places wander as sums of steps that err each by itself
    error = float(np.std(steps)) / math.sqrt(n - 1)
    return pitch_mm * abs(float(slope[0])), max(error, pitch_mm * float(np.sqrt(covariance[0, 0])))


def _doubts(acquisition: EndoscopeAcquisition, pose: TubePose, inward: bool, fitted: _Fitted) -> tuple[Doubt, ...]:
    doubts = list(doubts_of_travel(acquisition.travel, inward))
    if pose.sense < 0:
        doubts.append(
            Doubt(
                "image-mirrored",
                "The helical groove winds the wrong way, so images are mirrored, or the endoscope came in at the "
                "tube's other end with its travel stated wrongly: turn the images over before they are unrolled.",
            )
        )
    if (apart := max(fitted.sigma[DISTANT], fitted.sigma[FOCAL])) > ALONE_SIGMAS:
        doubts.append(
            Doubt(
                "optics-not-separable",
                f"Distance and focal length are told apart to {apart:.0%} alone: z of a "
                "radius and the slant of the view are known much better, and only together do these numbers give them.",
                value=float(apart),
                unit="1",
            )
        )
    because = "The endoscope rolled by {degrees} (rms) during the recording: theta_origin_rad is that of the frame "
    spread = float(np.std(fitted.turn_rad))
    return (*doubts, *doubts_of_origin(spread, ROLLING_RAD, because + "nearest the mouth."))


def _panels(darkness: Darkness, fitted: _Fitted) -> tuple[Panel, ...]:
    model, fit, optics = fitted.model, fitted.fit, fitted.optics
    marks, target = model.marks, model.target
    helical = marks.line == HELICAL
    r_px = darkness.r_px
    per_mm = 2 * math.pi * target.radius_mm / target.helix_lead_mm
    land = helical & ~marks.in_ring
    expected = optics.z_mm(marks.r_px[land])
    course = np.stack([r_px, optics.z_mm(r_px)], axis=1)
    frames = np.arange(fitted.apex_mm.size, dtype=np.float64)
    light = np.exp(np.nanmedian(darkness.light, axis=1))
    flat = np.stack([r_px, np.zeros_like(r_px)], axis=1)

    def off(chosen: NDArray[np.bool_], title: str) -> Panel:
        return Panel(
            title, "image radius, px", "µm on the wall", marks.r_px[chosen], 1000 * fit.residual_mm[chosen], flat
        )

    return (
        Panel(
            "z along the annulus, by the helical groove",
            "image radius, px",
            "mm from mid annulus",
            marks.r_px[land],
            expected + fit.residual_mm[land] / per_mm,
            course,
        ),
        off(helical & ~marks.in_ring, "helical groove off the model"),
        off(helical & marks.in_ring, "helical groove off the model, in rings"),
        off(~helical, "axial groove off the model"),
        Panel(
            "slant of the view",
            "image radius, px",
            "degrees",
            r_px[:0],
            r_px[:0],
            np.stack([r_px, np.degrees(np.arctan(optics.slant(r_px)))], axis=1),
        ),
        Panel(
            "place of the frames", "frame", "z of the apex, mm", frames, fitted.apex_mm,
        ),
        Panel("light along the annulus (flat field)", "image radius, px", "of full scale", r_px, light),
    )  # fmt: skip
