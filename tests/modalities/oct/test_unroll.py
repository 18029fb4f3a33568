"""A helical scan, put in place."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.modalities.oct.plugin import OCT
from endoct.modalities.oct.turning.rotation import even_rotation
from endoct.modalities.oct.unroll import brightest, maximum_intensity
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


def test_a_helical_scan_closes_at_the_seam(unrolled: UnrollPhantom) -> None:
    """Columns are shifted by up to half a pitch, one way before the middle of the turn and the other after it."""
    step = unrolled(Phantom(offset_mm=0.01))[2]
    helix = unrolled(Phantom(offset_mm=0.01, sidecar={"scan": "helical"}))[2]
    n = step.grid.n_theta
    intensity = step.intensity.astype(np.float64)
    # travel "in": A-scans late in the turn lie farther in, so row i mixes slices i and i − 1 there
    np.testing.assert_allclose(helix.intensity[2, n - 4], (intensity[2, n - 4] + intensity[1, n - 4]) / 2, rtol=0.01)
    np.testing.assert_allclose(helix.intensity[2, 3], (intensity[2, 3] + intensity[3, 3]) / 2, rtol=0.01)
    np.testing.assert_allclose(helix.intensity[2, n // 2], intensity[2, n // 2], rtol=0.01)


@pytest.mark.parametrize("travel", ["in", "out"])
def test_a_helical_scan_of_turns_that_start_anywhere(unrolled: UnrollPhantom, travel: str) -> None:
    """What lies at z shows z: samples that hold the place where they were recorded are put there."""
    _, calibration, panorama = unrolled(Phantom(sidecar={"travel": travel}))
    n, theta_rad = panorama.grid.n_z, panorama.grid.theta_rad
    start_rad = np.random.default_rng(0).uniform(0, 2 * np.pi, n)
    on_axis = replace(calibration.capillary, x_mm=np.zeros(n), y_mm=np.zeros(n))
    centred = replace(
        calibration,
        acquisition=calibration.acquisition.model_copy(update={"scan": "helical"}),
        rotation=replace(even_rotation(n), start_rad=start_rad),
        faces=replace(calibration.faces, capillary=on_axis),
    )
    in_z = np.argsort(calibration.slice_z_mm)
    share = np.mod(theta_rad - start_rad[in_z, None], 2 * np.pi) / (2 * np.pi)
    place_mm = panorama.z_mm[:, None] + (-1 if travel == "out" else 1) * 0.2 * (share - 0.5)
    valid = np.ones(panorama.grid.shape, bool)
    valid[2, 100] = False
    helix = OCT.settle(replace(panorama, intensity=place_mm.astype(np.float32), depth_mm=None, valid=valid), centred)
    inner = helix.valid[1:-1]
    expected_mm = np.broadcast_to(panorama.z_mm[1:-1, None], inner.shape)
    np.testing.assert_allclose(helix.intensity[1:-1][inner], expected_mm[inner], atol=1e-6)
    assert np.flatnonzero(~inner.all(axis=0)).tolist() == [100]


def test_the_maximum_is_taken_literally() -> None:
    image = np.zeros((3, 10), np.float32)
    image[:, 2], image[0, 5], image[1, 7], image[2, 9] = 9, 3, 4, 5
    np.testing.assert_array_equal(brightest(image, np.array([3, 3, 3])), [5, 7, 9])
    np.testing.assert_array_equal(maximum_intensity(image, np.array([3, 3, 3]), np.zeros(10, bool)), [3, 4, 5])
    np.testing.assert_array_equal(brightest(image, np.array([5, 2, 9])), [5, 2, 9])
    np.testing.assert_array_equal(maximum_intensity(image, np.array([5, 2, 9]), np.zeros(10, bool)), [3, 9, 5])
