"""The whole plug-in on a phantom with known geometry."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.turning.rotation import even_rotation
from endoct.modalities.oct.undistort import beam_of, radius_mm
from endoct.stitching.circle import wrap_rad
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama

Unrolled = Callable[..., tuple[FrameStream, Any, Panorama]]
OFFSET_ATOL_MM = 0.004
WALL_ATOL_MM = 0.012  # two depth samples


def pit(panorama: Panorama, centre: float, width: float) -> NDArray[np.bool_]:
    return np.abs(wrap_rad(panorama.grid.theta_rad - centre)) < width / 2


def test_offset_and_wall(unrolled: Unrolled, make_phantom: Any) -> None:
    phantom = make_phantom()
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


def test_a_pit_lies_at_its_own_angle(unrolled: Unrolled, make_phantom: Any) -> None:
    """With the catheter 0.25 mm off a beam meets the wall up to 12° from where it points to."""
    panorama = unrolled(make_phantom(offset_mm=0.25, pits=((2.4, 0.4, 0.2),)))[2]
    assert panorama.depth_mm is not None
    theta = panorama.grid.theta_rad[np.median(panorama.depth_mm, axis=0) > 0.08]
    assert theta.min() == pytest.approx(2.2, abs=0.03)
    assert theta.max() == pytest.approx(2.6, abs=0.03)
    sheared = unrolled(make_phantom(offset_mm=0.25, pits=((2.4, 0.4, 0.2),)), undistort="sine")[2]
    assert sheared.depth_mm is not None
    wrong = sheared.grid.theta_rad[np.median(sheared.depth_mm, axis=0) > 0.08]
    assert abs(wrong.mean() - 2.4) > 0.1


def test_the_literal_chain_runs(unrolled: Unrolled, make_phantom: Any) -> None:
    panorama = unrolled(make_phantom(), undistort="sine", wall="maximum")[2]
    assert panorama.depth_mm is not None
    # the maximum of speckle lies below the surface
    assert 0.0 < np.median(panorama.depth_mm) < 0.1


def test_handedness_and_origin(unrolled: Unrolled, make_phantom: Any) -> None:
    plain = unrolled(make_phantom())[2]
    sidecar = {"handedness": "mirrored", "theta_origin_rad": 0.5}
    _, calibration, turned = unrolled(make_phantom(sidecar=sidecar))
    assert turned.depth_mm is not None
    assert plain.depth_mm is not None
    # θ = origin − angle: the pit at 2.0 goes to 0.5 − 2.0
    assert np.median(turned.depth_mm[:, pit(turned, 0.5 - 2.0, 0.4)]) == pytest.approx(0.25, abs=0.012)
    np.testing.assert_allclose(wrap_rad(calibration.per_frame["offset_direction_rad"][0] - (0.5 - 1.0)), 0, atol=0.03)
    assert turned.handedness_known
    assert not unrolled(make_phantom(sidecar={"handedness": "unknown"}))[2].handedness_known


def test_a_pullback_is_stored_from_the_mouth(unrolled: Unrolled, make_phantom: Any) -> None:
    _, calibration, panorama = unrolled(make_phantom(sidecar={"travel": "out"}))
    np.testing.assert_allclose(calibration.per_frame["z_mm"], [1.0, 0.8, 0.6, 0.4, 0.2, 0.0], atol=1e-9)
    np.testing.assert_allclose(panorama.z_mm, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], atol=1e-9)


def test_log_linear_and_sixteen_bits_agree(unrolled: Unrolled, make_phantom: Any) -> None:
    phantom = make_phantom(n_slices=3)
    log = unrolled(phantom)[2].depth_mm
    wide = unrolled(phantom, phantom.log_counts().astype(np.uint16) * 200)[2].depth_mm
    linear = unrolled(replace(phantom, sidecar={"intensity": "linear"}), phantom.power())[2].depth_mm
    assert log is not None
    assert wide is not None
    assert linear is not None
    assert np.mean(np.abs(wide - log) < 0.02) > 0.97
    assert np.mean(np.abs(linear - log) < 0.02) > 0.95


def test_a_medium_shortens_everything(unrolled: Unrolled, make_phantom: Any) -> None:
    """In water all paths are 1.33 times longer; the same picture then shows a smaller world."""
    index = 1.33
    sidecar = {
        "medium_index": index,
        "bore_diameter_mm": 2.4 / index,
        "capillary_outer_diameter_mm": 1.6 / index,
    }
    _, calibration, panorama = unrolled(make_phantom(sidecar=sidecar))
    np.testing.assert_allclose(calibration.per_frame["offset_mm"], 0.15 / index, atol=OFFSET_ATOL_MM)
    assert panorama.depth_mm is not None
    assert np.median(panorama.depth_mm[:, pit(panorama, 2.0, 0.4)]) == pytest.approx(0.25 / index, abs=WALL_ATOL_MM)


def test_a_lost_slice_is_bridged_and_not_valid(unrolled: Unrolled, make_phantom: Any) -> None:
    phantom = make_phantom()
    pages = phantom.log_counts()
    pages[2] = np.random.default_rng(0).integers(40, 80, pages[2].shape)
    _, calibration, panorama = unrolled(phantom, pages)
    np.testing.assert_array_equal(calibration.bridged, [False, False, True, False, False, False])
    assert calibration.per_frame["offset_mm"][2] == pytest.approx(0.15, abs=0.01)
    assert not panorama.valid[2].any()
    assert any("1 of 6 slices" in note for note in calibration.notes)


def test_slices_that_show_no_wall_are_not_valid(unrolled: Unrolled, make_phantom: Any) -> None:
    seen, faint, lost = (make_phantom(wall_db=wall_db).log_counts() for wall_db in (19.0, -3.0, -20.0))
    _, calibration, panorama = unrolled(make_phantom(), np.concatenate([seen[:4], faint[4:5], lost[5:]]))
    sigmas = panorama.per_frame["wall_sigmas"].values
    np.testing.assert_array_equal(panorama.per_frame["wall_faint"].values, [False] * 4 + [True] * 2)
    assert sigmas[:4].min() > 100 > calibration.parameters.least_wall_sigmas > sigmas[4:].max()
    assert panorama.valid[:4].mean() > 0.95
    assert not panorama.valid[4:].any()
    assert "In 2 of 6 slices the wall stands out" in panorama.notes[-1]


def test_dead_ascans_are_not_valid(unrolled: Unrolled, make_phantom: Any) -> None:
    phantom = make_phantom()
    pages = phantom.log_counts()
    pages[:, :, 100:140] = 0
    panorama = unrolled(phantom, pages)[2]
    # a few beams more or fewer point there, since θ is where they meet the wall
    assert np.mean(~panorama.valid) == pytest.approx(40 / 720, abs=0.012)


def test_a_wrong_first_sample_is_noted(unrolled: Unrolled, make_phantom: Any) -> None:
    right = unrolled(make_phantom(sidecar={"first_sample_mm": 0.0}))[1]
    wrong = unrolled(make_phantom(sidecar={"first_sample_mm": 0.5}))[1]
    assert not any("first_sample_mm" in note for note in right.notes)
    assert any("first_sample_mm" in note for note in wrong.notes)


@pytest.mark.parametrize(
    ("pages", "what"),
    [
        (np.zeros((3, 340, 720), np.uint8), "shows nothing"),
        (np.full((3, 340, 720), 255, np.uint8), "shows nothing"),
        (np.where(np.random.default_rng(0).random((3, 340, 720)) < 0.8, 255, 90).astype(np.uint8), "saturated"),
        (np.random.default_rng(0).integers(0, 255, (3, 340, 720)).astype(np.uint8), "outer face cannot be found"),
    ],
)
def test_recordings_of_nothing(unrolled: Unrolled, make_phantom: Any, pages: NDArray[Any], what: str) -> None:
    with pytest.raises(EndoctError, match=what):
        unrolled(make_phantom(), pages)


def test_survey_and_unroll_depend_on_nothing_else(unrolled: Unrolled, make_phantom: Any) -> None:
    stream, calibration, _ = unrolled(make_phantom(n_slices=3))
    again = OCT.survey(pickle.loads(pickle.dumps(stream)), calibration.parameters)
    for key, values in calibration.per_frame.items():
        np.testing.assert_array_equal(values, again.per_frame[key])
    copy = pickle.loads(pickle.dumps(calibration))
    last, first = OCT.unroll(stream[2], copy), OCT.unroll(stream[0], copy)
    np.testing.assert_array_equal(first.depth_mm, OCT.unroll(stream[0], calibration).depth_mm)
    np.testing.assert_array_equal(last.intensity, OCT.unroll(stream[2], calibration).intensity)


def test_undistortion_undoes_itself(unrolled: Unrolled, make_phantom: Any) -> None:
    calibration = unrolled(make_phantom(n_slices=3))[1]
    theta = calibration.grid.theta_rad
    for distance in (0.9, 1.2, 1.5):
        angle, depth = beam_of(calibration, 1, theta, np.full(theta.shape, distance))
        # the ripple is read at the bore's surface: exact there, a micrometre or so elsewhere
        atol = 1e-9 if distance == 1.2 else 0.003
        np.testing.assert_allclose(radius_mm(calibration, 1, angle, depth), distance, atol=atol)


def test_volume(unrolled: Unrolled, make_phantom: Any, tmp_path: Path) -> None:
    stream, calibration, _ = unrolled(make_phantom(n_slices=3))
    store = tmp_path / "volume.zarr"
    xr.Dataset().to_zarr(store, zarr_format=3, consolidated=False)
    OCT.write_volume(stream, calibration, store)
    with xr.open_zarr(store, group="volume") as volume:
        samples = volume["intensity"]
        assert samples.dims == ("z", "theta", "depth")
        assert samples.dtype == np.uint8
        assert samples.encoding["chunks"] == (1, *samples.shape[1:])
        profile = samples.values[:, pit_free(volume["theta"].values)].mean(axis=(0, 1))
        radius = volume["radius"].values
    # the wall stands where the bore is, the capillary where its radius is
    air = radius > 1.0
    rise = radius[air][1:][np.argmax(np.diff(profile[air]))]
    assert rise == pytest.approx(1.2, abs=0.02)
    assert radius[np.argmax(profile[radius < 1.0])] == pytest.approx(0.8, abs=0.01)


def pit_free(theta: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (np.abs(wrap_rad(theta - 2.0)) > 0.4) & (np.abs(wrap_rad(theta - 6.2)) > 0.4)


def test_pictures(unrolled: Unrolled, make_phantom: Any) -> None:
    stream, calibration, _ = unrolled(make_phantom(n_slices=3))
    recorded, undistorted = OCT.illustrate(stream[1], calibration)
    assert set(recorded.curves) == {"outer face of the capillary", "sine", "wall"}
    assert max(recorded.image.shape) <= 1000
    wall = undistorted.curves["wall"][:, 1]
    assert np.nanmedian(wall) == pytest.approx(1.2, abs=0.02)
    assert undistorted.y_extent[0] == pytest.approx(0.75)


def test_a_helical_scan_closes_at_the_seam(unrolled: Unrolled, make_phantom: Any) -> None:
    """Columns are shifted by up to half a pitch, one way before the middle of the turn and the other after it."""
    step = unrolled(make_phantom(offset_mm=0.01))[2]
    helix = unrolled(make_phantom(offset_mm=0.01, sidecar={"scan": "helical"}))[2]
    n = step.grid.n_theta
    intensity = step.intensity.astype(np.float64)
    # travel "in": A-scans late in the turn lie farther in, so row i mixes slices i and i − 1 there
    np.testing.assert_allclose(helix.intensity[2, n - 4], (intensity[2, n - 4] + intensity[1, n - 4]) / 2, rtol=0.01)
    np.testing.assert_allclose(helix.intensity[2, 3], (intensity[2, 3] + intensity[3, 3]) / 2, rtol=0.01)
    np.testing.assert_allclose(helix.intensity[2, n // 2], intensity[2, n // 2], rtol=0.01)


@pytest.mark.parametrize("travel", ["in", "out"])
def test_a_helical_scan_of_turns_that_start_anywhere(unrolled: Unrolled, make_phantom: Any, travel: str) -> None:
    """What lies at z shows z: samples that hold the place where they were recorded are put there."""
    _, calibration, panorama = unrolled(make_phantom(sidecar={"travel": travel}))
    n, theta_rad = panorama.grid.n_z, panorama.grid.theta_rad
    start_rad = np.random.default_rng(0).uniform(0, 2 * np.pi, n)
    centred = replace(
        calibration,
        acquisition=calibration.acquisition.model_copy(update={"scan": "helical"}),
        rotation=replace(even_rotation(n), start_rad=start_rad),
        offset_x_mm=np.zeros(n),
        offset_y_mm=np.zeros(n),
    )
    in_z = np.argsort(calibration.slice_z_mm)
    share = np.mod(theta_rad - start_rad[in_z, None], 2 * np.pi) / (2 * np.pi)
    place_mm = panorama.z_mm[:, None] + (-1 if travel == "out" else 1) * 0.2 * (share - 0.5)
    valid = np.ones(panorama.grid.shape, bool)
    valid[2, 100] = False
    helix = OCT.settle(replace(panorama, intensity=place_mm, depth_mm=None, valid=valid), centred)
    inner = helix.valid[1:-1]
    expected_mm = np.broadcast_to(panorama.z_mm[1:-1, None], inner.shape)
    np.testing.assert_allclose(helix.intensity[1:-1][inner], expected_mm[inner], atol=1e-6)
    assert np.flatnonzero(~inner.all(axis=0)).tolist() == [100]
