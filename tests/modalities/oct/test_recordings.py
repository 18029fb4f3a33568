"""The plug-in on a simulated specimen and on a clinical pullback."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.undistort import beam_angles_rad
from endoct.modalities.registry import open_recording
from endoct.stitching.panorama import Panorama
from tests.modalities.oct.unrolling import unroll


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
