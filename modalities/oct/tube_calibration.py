"""Calibration of an OCT by a pullback through a printed tube."""

import math
from dataclasses import replace

import numpy as np

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.survey import survey_pullback
from endoct.modalities.oct.tube_fit import (
    LEAN_X,
    LEAN_Y,
    PITCH,
    SCALE,
    THETA,
    WALL,
    TubeModel,
    X,
    Y,
    Z,
    at_surface,
    first_sample_mm,
    late_mm,
)
from endoct.modalities.oct.tube_marks import DEPTHS, HELICAL, Beams, examine_beams, find_marks
from endoct.modalities.tube.fitting import TubeFit
from endoct.modalities.tube.locating import COLUMNS, TubePose, check_rings, clear_pose
from endoct.modalities.tube.measurement import (
    KeyValue,
    Measurement,
    Panel,
    Quantity,
    doubts_of_origin,
    doubts_of_travel,
)
from endoct.modalities.tube.target import Target

N_BEAMS = 1024
SCALES = np.arange(0.9, 1.101, 0.01)
"""These ratios of true over stated pitch are tried."""
CAPILLARY_MM, GLASS_MM = 0.005, 0.0025
"""Standard errors of the capillary's diameter where none is stated, and of its glass as its inner face shows it."""
FACE_MM = 0.001
"""Standard error of the line of the outer face."""
CONTRADICTION_SIGMAS, CONTRADICTION_MM = 5.0, 0.02
SURE_START_RAD = 0.05
TURNING_RAD = 0.01
"""Usual error of the angle of an A-scan within its turn, where it is not known."""
LINE_OF_WAVE = 6 / math.pi
"""Rise of the line that fits one period of a sine best, over its amplitude."""


def calibrate_pullback(stream: FrameStream, parameters: OctParameters, target: Target) -> Measurement:
    """Return what a pullback through a tube says of the OCT.

    Raises :class:`NotSeen` where it does not show the tube's marks, :class:`EndoctError` where the tube's diameter
    contradicts it.
    """
    parameters = parameters.model_copy(update={"n_theta": parameters.n_theta or N_BEAMS})
    calibration = survey_pullback(stream, parameters)
    beams = examine_beams(stream, calibration)
    pose = _locate(beams, target)
    check_rings(target, pose.z_of(beams.z_mm))
    capillary_mm = (calibration.acquisition.standard_errors or {}).get("capillary_outer_diameter_mm", CAPILLARY_MM)
    for _ in range(2):
        model = TubeModel(beams, find_marks(beams, pose, target), target, pose)
        fit = model.fit(capillary_mm)
        z_mm, scale, theta_rad = map(float, fit.values[[Z, PITCH, THETA]])
        pose = replace(pose, z_mm=z_mm, scale=scale, theta_rad=theta_rad)
    marks = at_surface(model.marks, late_mm(model, fit.values))
    model = TubeModel(beams, marks, target, pose)
    fit = model.fit(capillary_mm)
    _check_diameter(model, fit, capillary_mm)
    return _measurement(calibration, model, fit, pose, capillary_mm)


def _locate(beams: Beams, target: Target) -> TubePose:
    deepest = target.ring_depth_mm + target.groove_depth_mm
    image = beams.relief_map(target.radius_mm, COLUMNS)
    image = np.clip(image - np.nanmedian(image), -0.1, deepest + 0.1)
    return clear_pose(image, beams.z_mm, target, target.relief_mm, SCALES)


def _check_diameter(model: TubeModel, fit: TubeFit, capillary_mm: float) -> None:
    off, sigma = float(fit.values[WALL]), float(model.expected(capillary_mm)[1][WALL])
    if abs(off) > max(CONTRADICTION_MM, CONTRADICTION_SIGMAS * sigma):
        target = model.target
        raise EndoctError(
            "the tube's diameter contradicts what the recording shows of its steps",
            found=f"{target.bore_diameter_mm + 2 * off:.3f} mm, if rings and grooves are as deep as stated",
            expected=f"{target.bore_diameter_mm:.3f} mm",
            remedy="check bore_diameter_mm in tube.toml and capillary_outer_diameter_mm in the sidecar",
        )


def _measurement(
    calibration: OctCalibration, model: TubeModel, fit: TubeFit, pose: TubePose, capillary_mm: float
) -> Measurement:
    acquisition, target, values = calibration.acquisition, model.target, fit.values
    sigma = np.sqrt(np.diag(fit.covariance))
    pixel_mm = acquisition.axial_pixel_mm * math.exp(values[SCALE])
    pixel_sigma = pixel_mm * sigma[SCALE]
    pitch_mm = acquisition.pullback_pitch_mm * abs(values[PITCH])
    known_rad = calibration.rotation.shape_sigma_rad
    turning_rad = float(np.nanmedian(known_rad)) if np.isfinite(known_rad).any() else TURNING_RAD
    # an uneven turn bends the helical groove to a wave, of which a line takes up so much
    span_mm = float(np.ptp(pose.z_of(model.beams.z_mm)))
    bent = LINE_OF_WAVE * turning_rad * target.helix_lead_mm / (2 * math.pi * span_mm)
    relative = math.hypot(float(sigma[PITCH]) / abs(float(values[PITCH])), target.stretch_sigma, bent)
    pitch_sigma = pitch_mm * relative
    theta_rad = float(np.mod(values[THETA], 2 * np.pi))
    theta_sigma = math.hypot(sigma[THETA], turning_rad)
    inward = pose.direction * (model.beams.z_mm[-1] - model.beams.z_mm[0]) > 0
    keys: dict[str, KeyValue] = {
        "axial_pixel_mm": pixel_mm,
        "handedness": "same" if pose.sense > 0 else "mirrored",
        "theta_origin_rad": theta_rad,
        "travel": "in" if inward else "out",
        "pullback_pitch_mm": pitch_mm,
    }
    quantities = [
        Quantity("axial_pixel_mm", "axial pixel in air", pixel_mm, pixel_sigma, "mm"),
        Quantity("theta_origin_rad", "θ of A-scan 0", theta_rad, theta_sigma, "rad"),
        Quantity("pullback_pitch_mm", "pullback between slices", pitch_mm, pitch_sigma, "mm"),
    ]
    doubts = _doubts(calibration, inward)
    if calibration.glass.thickness_mm:
        first_mm = float(first_sample_mm(values, calibration)[0])
        by_scale = float(fit.sigma_of(lambda at: first_sample_mm(at, calibration))[0])
        first_sigma = math.hypot(by_scale, capillary_mm / 2, 0.46 * GLASS_MM, FACE_MM)
        keys["first_sample_mm"] = first_mm
        quantities.insert(1, Quantity("first_sample_mm", "path to depth sample 0", first_mm, first_sigma, "mm"))
    else:
        doubts += (
            Doubt(
                "depth-zero-unknown",
                "The capillary's inner face is not seen, so its glass is not known, nor first_sample_mm.",
            ),
        )
    off_mm, off_sigma = math.hypot(values[X], values[Y]), math.hypot(sigma[X], sigma[Y])
    lean_rad, lean_sigma = math.hypot(values[LEAN_X], values[LEAN_Y]), math.hypot(sigma[LEAN_X], sigma[LEAN_Y])
    quantities += [
        Quantity("capillary_off_axis_mm", "capillary off the tube's axis", off_mm, off_sigma, "mm"),
        Quantity("capillary_lean_rad", "slope of the capillary in the tube", lean_rad, lean_sigma, "rad"),
    ]
    return Measurement(keys, tuple(quantities), _panels(model, fit), doubts)


def _doubts(calibration: OctCalibration, inward: bool) -> tuple[Doubt, ...]:
    acquisition = calibration.acquisition
    doubts = doubts_of_travel(acquisition.travel, inward, ", and handedness is wrong, too")
    if acquisition.medium_index != 1:
        doubts += (
            Doubt(
                "index-not-separable",
                "Depths tell the axial pixel over the refractive index alone: axial_pixel_mm is right if medium_index "
                f"is {acquisition.medium_index:g}.",
            ),
        )
    starts = calibration.rotation.start_rad
    spread = float(np.std(np.angle(np.exp(1j * (starts - np.angle(np.exp(1j * starts).sum()))))))
    because = "Turns start {degrees} from each other, so the next recording starts anywhere: theta_origin_rad is that "
    return doubts + doubts_of_origin(spread, SURE_START_RAD, because + "of this one alone.")


def _panels(model: TubeModel, fit: TubeFit) -> tuple[Panel, ...]:
    marks, target, values = model.marks, model.target, fit.values
    depth = marks.line == DEPTHS
    scale = math.exp(values[SCALE])
    expected = target.radius_mm + marks.relief_mm - model.beams.face_radius_mm
    line = np.array([expected[depth].min(), expected[depth].max()])
    helical = marks.line == HELICAL
    z_mm = values[Z] + model.pose.direction * values[PITCH] * model.beams.z_mm
    of_helix = z_mm[marks.slice_index[helical]]
    course = np.array([z_mm.min(), z_mm.max()])
    turned = fit.residual_mm[helical] / target.radius_mm
    return (
        Panel(
            "depth beyond the capillary",
            "stated, mm",
            "by the tube, mm",
            marks.gap_mm[depth],
            expected[depth],
            np.stack([line / scale, line], axis=1),
        ),
        Panel(
            "wall and floors off the model",
            "z of the tube, mm",
            "µm",
            z_mm[marks.slice_index[depth]],
            1000 * fit.residual_mm[depth],
            np.stack([course, np.zeros(2)], axis=1),
        ),
        Panel(
            "helical groove from the axial one",
            "z of the tube, mm",
            "rad",
            of_helix,
            target.helix_rad(of_helix) + turned,
            np.stack([course, target.helix_rad(course)], axis=1),
        ),
        Panel(
            "helical groove off the model",
            "z of the tube, mm",
            "µm along the circumference",
            of_helix,
            1000 * fit.residual_mm[helical],
            np.stack([course, np.zeros(2)], axis=1),
        ),
    )
