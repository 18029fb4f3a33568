"""From angle and depth to angle and radius, and back."""

import numpy as np

from endoct.modalities.oct.undistort import beam_of, radius_mm
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
