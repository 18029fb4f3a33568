"""From angle and depth to angle and radius, and back."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.undistort import beam_of, depth_at_radius_mm, radius_mm, theta_at_radius
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


def test_undistortion_undoes_itself(unrolled: UnrollPhantom) -> None:
    calibration = unrolled(Phantom(n_slices=3))[1]
    theta = calibration.grid.theta_rad
    for distance in (0.9, 1.2, 1.5):
        angle, depth = beam_of(calibration, 1, theta, np.full(theta.shape, distance))
        # the ripple is read at the bore's surface: exact there, a micrometre or so elsewhere
        atol = 1e-9 if distance == 1.2 else 0.003
        np.testing.assert_allclose(radius_mm(calibration, 1, angle, depth), distance, atol=atol)


@pytest.mark.parametrize("undistort", ["eccentric", "sine"])
@pytest.mark.parametrize("handedness", ["same", "mirrored"])
def test_where_an_ascan_meets_a_radius_is_where_that_place_is_seen(
    unrolled: UnrollPhantom, undistort: str, handedness: str
) -> None:
    """Depth and θ at a radius, against radius and A-scan at a θ; off axis, from an origin of the sidecar's."""
    phantom = Phantom(n_slices=3, offset_mm=0.2, sidecar={"handedness": handedness, "theta_origin_rad": 0.7})
    calibration = unrolled(phantom, undistort=undistort)[1]
    nominal = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    for distance in (1.2, 1.5):
        depth = depth_at_radius_mm(calibration, 1, nominal, np.full(90, distance))
        atol = 1e-9 if distance == 1.2 or undistort == "sine" else 0.003
        np.testing.assert_allclose(radius_mm(calibration, 1, nominal, depth), distance, atol=atol)
        theta = theta_at_radius(calibration, 1, nominal, np.full(90, distance))
        seen, there = beam_of(calibration, 1, theta, np.full(90, distance))
        np.testing.assert_allclose(wrap_rad(seen - nominal), 0, atol=0.003)
        np.testing.assert_allclose(there, depth, atol=0.003)
    if undistort == "eccentric":
        assert np.isnan(depth_at_radius_mm(calibration, 1, nominal, np.full(90, 0.05))).any()


def test_volume(unrolled: UnrollPhantom, tmp_path: Path) -> None:
    stream, calibration, _ = unrolled(Phantom(n_slices=3))
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
