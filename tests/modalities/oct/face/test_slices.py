"""What the survey keeps of a B-scan: where the capillary's face lies, and the samples behind it."""

import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.slices import examine_bscan, samples_behind
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters

PIXEL_MM, N_ASCANS, N_THETA, N_DEPTH = 0.005, 1024, 512, 300
CIRCLE = Circle(0.2, -0.1, 0.3, 0.6)
ACQUISITION = OctAcquisition(
    modality="oct",
    axial_pixel_mm=PIXEL_MM,
    pullback_pitch_mm=0.2,
    capillary_outer_diameter_mm=1.2,
    bore_diameter_mm=2.5,
    intensity="linear",
)


def test_the_face_and_what_lies_behind_it_are_kept_at_their_angles_and_depths() -> None:
    """A face off the axis, bright for 0.03 mm, in noise."""
    angle_rad = 2 * np.pi * (np.arange(N_ASCANS) + 0.5) / N_ASCANS
    behind_mm = PIXEL_MM * np.arange(N_DEPTH) - CIRCLE.depth_mm(angle_rad)[:, None]
    power = np.where((behind_mm >= 0) & (behind_mm < 0.03), 2000.0, 1.0)
    samples = np.random.default_rng(0).exponential(power).astype(np.float32)
    z_mm, features = examine_bscan(Frame(3, samples, 1.25), ACQUISITION, OctParameters(), N_THETA)
    assert z_mm == 1.25
    assert not features.saturated
    best = features.lines.circle(0)
    assert (best.x_mm, best.y_mm, best.axis_depth_mm) == pytest.approx(
        (CIRCLE.x_mm, CIRCLE.y_mm, CIRCLE.axis_depth_mm), abs=0.02
    )
    behind = samples_behind(features, CIRCLE, PIXEL_MM, 40)
    assert behind.shape == (len(features.ascan_angle_rad), 40)
    bright, dark = np.median(behind[:, 1:5], axis=1), np.median(behind[:, 8:], axis=1)
    assert (bright > dark + 20).all()  # dB
    assert np.isnan(samples_behind(features, CIRCLE, PIXEL_MM, N_DEPTH)[:, -1]).all()
