"""The whole plug-in on a phantom with known geometry."""

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.undistort import beam_angles_rad
from endoct.modalities.recognition import open_recording
from endoct.stitching.panorama import Panorama
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom, unroll

OFFSET_ATOL_MM = 0.004
WALL_ATOL_MM = 0.012  # two depth samples


def pit(panorama: Panorama, centre: float, width: float) -> NDArray[np.bool_]:
    return np.abs(wrap_rad(panorama.grid.theta_rad - centre)) < width / 2


def test_offset_and_wall(unrolled: UnrollPhantom) -> None:
    phantom = Phantom()
    _, calibration, panorama = unrolled(phantom)
    per_frame = calibration.per_frame
    np.testing.assert_allclose(per_frame["offset_mm"], 0.15, atol=OFFSET_ATOL_MM)
    directions = [phantom.direction_of(i) for i in range(phantom.n_slices)]
    np.testing.assert_allclose(wrap_rad(per_frame["offset_direction_rad"] - directions), 0, atol=0.03)
    np.testing.assert_allclose(per_frame["sine_amplitude_mm"], 0.15, atol=0.01)
    # f(x) = e·sin(x + φ) is nearest where the catheter is off to: φ = −β − π/2
    np.testing.assert_allclose(wrap_rad(per_frame["sine_phase_rad"] + directions + np.pi / 2), 0, atol=0.1)
    assert not per_frame["bridged"].any()
    assert per_frame["inlier_fraction"].min() > 0.9

    assert panorama.depth_mm is not None
    assert panorama.valid.mean() > 0.99
    deep, other = pit(panorama, 2.0, 0.4), ~pit(panorama, 2.0, 0.7) & ~pit(panorama, 6.2, 0.6)
    assert abs(np.median(panorama.depth_mm[:, other])) < WALL_ATOL_MM
    assert np.percentile(np.abs(panorama.depth_mm[:, other]), 95) < 2 * WALL_ATOL_MM
    assert np.median(panorama.depth_mm[:, deep]) == pytest.approx(0.25, abs=WALL_ATOL_MM)


def test_a_pit_lies_at_its_own_angle(unrolled: UnrollPhantom) -> None:
    """With the catheter 0.25 mm off a beam meets the wall up to 12° from where it points to."""
    panorama = unrolled(Phantom(offset_mm=0.25, pits=((2.4, 0.4, 0.2),)))[2]
    assert panorama.depth_mm is not None
    theta = panorama.grid.theta_rad[np.median(panorama.depth_mm, axis=0) > 0.08]
    assert theta.min() == pytest.approx(2.2, abs=0.03)
    assert theta.max() == pytest.approx(2.6, abs=0.03)
    sheared = unrolled(Phantom(offset_mm=0.25, pits=((2.4, 0.4, 0.2),)), undistort="sine")[2]
    assert sheared.depth_mm is not None
    wrong = sheared.grid.theta_rad[np.median(sheared.depth_mm, axis=0) > 0.08]
    assert abs(wrong.mean() - 2.4) > 0.1


def test_the_literal_chain_runs(unrolled: UnrollPhantom) -> None:
    panorama = unrolled(Phantom(), undistort="sine", wall="maximum")[2]
    assert panorama.depth_mm is not None
    # the maximum of speckle lies below the surface
    assert 0.0 < np.median(panorama.depth_mm) < 0.1


def test_handedness_and_origin(unrolled: UnrollPhantom) -> None:
    plain = unrolled(Phantom())[2]
    sidecar = {"handedness": "mirrored", "theta_origin_rad": 0.5}
    _, calibration, turned = unrolled(Phantom(sidecar=sidecar))
    assert turned.depth_mm is not None
    assert plain.depth_mm is not None
    # θ = origin − angle: the pit at 2.0 goes to 0.5 − 2.0
    assert np.median(turned.depth_mm[:, pit(turned, 0.5 - 2.0, 0.4)]) == pytest.approx(0.25, abs=0.012)
    np.testing.assert_allclose(wrap_rad(calibration.per_frame["offset_direction_rad"][0] - (0.5 - 1.0)), 0, atol=0.03)
    assert turned.handedness_known
    assert not unrolled(Phantom(sidecar={"handedness": "unknown"}))[2].handedness_known


def test_a_pullback_is_stored_from_the_mouth(unrolled: UnrollPhantom) -> None:
    _, calibration, panorama = unrolled(Phantom(sidecar={"travel": "out"}))
    np.testing.assert_allclose(calibration.per_frame["z_mm"], [1.0, 0.8, 0.6, 0.4, 0.2, 0.0], atol=1e-9)
    np.testing.assert_allclose(panorama.z_mm, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], atol=1e-9)


def test_log_linear_and_sixteen_bits_agree(unrolled: UnrollPhantom) -> None:
    phantom = Phantom(n_slices=3)
    log = unrolled(phantom)[2].depth_mm
    wide = unrolled(phantom, phantom.log_counts().astype(np.uint16) * 200)[2].depth_mm
    linear = unrolled(replace(phantom, sidecar={"intensity": "linear"}), phantom.power())[2].depth_mm
    assert log is not None
    assert wide is not None
    assert linear is not None
    assert np.mean(np.abs(wide - log) < 0.02) > 0.97
    assert np.mean(np.abs(linear - log) < 0.02) > 0.95


def test_a_medium_shortens_everything(unrolled: UnrollPhantom) -> None:
    """In water all paths are 1.33 times longer; the same picture then shows a smaller world."""
    index = 1.33
    sidecar = {
        "medium_index": index,
        "bore_diameter_mm": 2.4 / index,
        "capillary_outer_diameter_mm": 1.6 / index,
    }
    _, calibration, panorama = unrolled(Phantom(sidecar=sidecar))
    np.testing.assert_allclose(calibration.per_frame["offset_mm"], 0.15 / index, atol=OFFSET_ATOL_MM)
    assert panorama.depth_mm is not None
    assert np.median(panorama.depth_mm[:, pit(panorama, 2.0, 0.4)]) == pytest.approx(0.25 / index, abs=WALL_ATOL_MM)


def test_a_lost_slice_is_bridged_and_not_valid(unrolled: UnrollPhantom) -> None:
    phantom = Phantom()
    pages = phantom.log_counts()
    pages[2] = np.random.default_rng(0).integers(40, 80, pages[2].shape)
    _, calibration, panorama = unrolled(phantom, pages)
    np.testing.assert_array_equal(calibration.bridged, [False, False, True, False, False, False])
    assert calibration.per_frame["offset_mm"][2] == pytest.approx(0.15, abs=0.01)
    assert not panorama.valid[2].any()
    assert any("1 of 6 slices" in note for note in calibration.notes)


def test_slices_that_show_no_wall_are_not_valid(unrolled: UnrollPhantom) -> None:
    seen, faint, lost = (Phantom(wall_db=wall_db).log_counts() for wall_db in (19.0, -3.0, -20.0))
    _, calibration, panorama = unrolled(Phantom(), np.concatenate([seen[:4], faint[4:5], lost[5:]]))
    sigmas = panorama.per_frame["wall_sigmas"].values
    np.testing.assert_array_equal(panorama.per_frame["wall_faint"].values, [False] * 4 + [True] * 2)
    assert sigmas[:4].min() > 100 > calibration.parameters.least_wall_sigmas > sigmas[4:].max()
    assert panorama.valid[:4].mean() > 0.95
    assert not panorama.valid[4:].any()
    assert "In 2 of 6 slices the wall stands out" in panorama.notes[-1]


def test_dead_ascans_are_not_valid(unrolled: UnrollPhantom) -> None:
    phantom = Phantom()
    pages = phantom.log_counts()
    pages[:, :, 100:140] = 0
    panorama = unrolled(phantom, pages)[2]
    # a few beams more or fewer point there, since θ is where they meet the wall
    assert np.mean(~panorama.valid) == pytest.approx(40 / 720, abs=0.012)


def test_survey_and_unroll_depend_on_nothing_else(unrolled: UnrollPhantom) -> None:
    stream, calibration, _ = unrolled(Phantom(n_slices=3))
    again = OCT.survey(pickle.loads(pickle.dumps(stream)), calibration.parameters)
    for key, values in calibration.per_frame.items():
        np.testing.assert_array_equal(values, again.per_frame[key])
    copy = pickle.loads(pickle.dumps(calibration))
    last, first = OCT.unroll(stream[2], copy), OCT.unroll(stream[0], copy)
    np.testing.assert_array_equal(first.depth_mm, OCT.unroll(stream[0], calibration).depth_mm)
    np.testing.assert_array_equal(last.intensity, OCT.unroll(stream[2], calibration).intensity)


def test_a_simulated_specimen(quick_specimen: Path) -> None:
    """Offsets within 0.01 mm, and the wall where the truth has it, looked up along the true beams."""
    _, stream = open_recording(quick_specimen / "oct")
    assert isinstance(stream.acquisition, OctAcquisition)
    _, calibration, panorama = unroll(quick_specimen / "oct", stream.acquisition)
    truth = json.loads((quick_specimen / "truth" / "recording.json").read_text())
    relief_mm, true = _truth(quick_specimen, truth["oct"], calibration, panorama)
    capillary = calibration.capillary
    offset = (capillary.x_mm + 1j * capillary.y_mm) * np.exp(1j * calibration.rotation.start_rad)
    assert np.max(np.abs(offset - true)) < 0.01
    assert panorama.valid.mean() >= 0.95
    assert panorama.depth_mm is not None
    wall = panorama.valid & (relief_mm < 0.01)
    error = panorama.depth_mm - relief_mm
    assert abs(np.median(error[wall])) < 0.01
    assert np.percentile(np.abs(error[wall] - np.median(error[wall])), 90) < 0.02
    cell, seen = relief_mm > 0.04, panorama.depth_mm > 0.04
    valid = panorama.valid
    assert np.sum(cell & seen & valid) / np.sum((cell | seen) & valid) > 0.88


def _truth(specimen: Path, truth: dict[str, Any], calibration: OctCalibration, panorama: Panorama) -> tuple[Any, Any]:
    """Relief where the true beams meet the bore, on the panorama; and the offsets in the frame of A-scan 0."""
    with xr.open_zarr(specimen / "truth" / "wall.zarr", consolidated=False) as wall:
        relief_mm, z_mm = wall["relief_mm"].values, wall["z"].values
    radius, n = panorama.grid.radius_mm, relief_mm.shape[1]
    rows = np.empty(panorama.grid.shape)
    for row, i in enumerate(np.argsort(calibration.slice_z_mm)):
        nominal, _ = beam_angles_rad(calibration, i, panorama.grid.theta_rad)
        turn = nominal * truth["turn_length"][i]
        angle = turn + truth["start_angle_rad"][i]
        pairs = zip(truth["rotation_error_cos_rad"][i], truth["rotation_error_sin_rad"][i], strict=True)
        for h, (cosine, sine) in enumerate(pairs, 1):
            angle = angle + cosine * np.cos(h * turn) + sine * np.sin(h * turn)
        beam = np.exp(1j * (truth["theta_origin_rad"] + truth["theta_sense"] * angle))
        catheter = truth["offset_mm"][i] * np.exp(1j * truth["offset_direction_rad"][i])
        along = (catheter * beam.conj()).real
        place = catheter + beam * (np.sqrt(radius**2 - abs(catheter) ** 2 + along**2) - along)
        column = np.round(np.mod(np.angle(place), 2 * np.pi) / (2 * np.pi) * n).astype(int) % n
        rows[row] = relief_mm[np.argmin(np.abs(z_mm - truth["z_mm"][i])), column]
    direction = truth["theta_sense"] * (np.asarray(truth["offset_direction_rad"]) - truth["theta_origin_rad"])
    return rows, np.asarray(truth["offset_mm"]) * np.exp(1j * direction)


def test_a_clinical_pullback(recordings: Path) -> None:
    """The lumen, drawn by others about the frame's centre, within 3 px in the median and 8 px for nine in ten.

    A sample (θ, depth) lies on the beam from the catheter c = offset·(cos, sin)(direction) through the point of the
    nominal bore at θ, at distance R + depth from the axis; A-scan and depth sample follow from the beam's angle and
    the distance from c, because row 0 of this recording is the catheter's centre.
    """
    folder = recordings / "coronary-oct"
    lumen_px = np.load(folder / "lumen_px.npy")
    _, stream = open_recording(folder)
    assert isinstance(stream.acquisition, OctAcquisition)
    _, calibration, panorama = unroll(folder, stream.acquisition)
    assert panorama.depth_mm is not None
    per_frame, theta, radius = calibration.per_frame, panorama.grid.theta_rad, panorama.grid.radius_mm
    errors = []
    for row, i in enumerate(np.argsort(per_frame["z_mm"])):
        catheter = per_frame["offset_mm"][i] * np.exp(1j * per_frame["offset_direction_rad"][i])
        beam = radius * np.exp(1j * theta) - catheter
        beam /= np.abs(beam)
        along = (catheter * beam.conj()).real
        wall = np.maximum(radius + panorama.depth_mm[row], abs(catheter))
        distance_px = (np.sqrt(wall**2 - abs(catheter) ** 2 + along**2) - along) / stream.acquisition.axial_pixel_mm
        turned = np.angle(beam) - calibration.rotation.start_rad[i]
        nominal, _ = calibration.rotation.nominal_rad(i, turned, 504)
        column = np.round(nominal / (2 * np.pi) * 504).astype(int) % 504
        errors.append((distance_px - lumen_px[i, column])[panorama.valid[row]])
    error = np.abs(np.concatenate(errors))
    assert panorama.valid.mean() >= 0.85
    assert np.median(error) <= 3
    assert np.percentile(error, 90) <= 8
    assert np.median(per_frame["offset_mm"]) / 0.0067 < 4  # the residual sine: 2.8 px
