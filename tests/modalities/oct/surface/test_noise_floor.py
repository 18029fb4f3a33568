"""The noise floor over depth."""

from dataclasses import replace

import numpy as np

from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.noise_floor import measure_floor
from tests.modalities.oct.turning.drawn_slices import AXIS_MM, N_COLUMNS, NOMINAL, RADIUS_MM, drawn_slice, faces_of

N_DEPTH, PIXEL_MM, BORE_MM = 360, 0.005, 1.25
ACQUISITION = OctAcquisition(
    modality="oct",
    axial_pixel_mm=PIXEL_MM,
    pullback_pitch_mm=0.2,
    bore_diameter_mm=2 * BORE_MM,
    capillary_outer_diameter_mm=2 * RADIUS_MM,
)


def test_bands_of_the_noise_are_measured_though_bone_lies_in_them() -> None:
    rng = np.random.default_rng(0)
    depth = np.arange(N_DEPTH)
    bands_db = 1.3 * np.sin(2 * np.pi * depth / 90)
    behind_mm = depth * PIXEL_MM - (AXIS_MM + BORE_MM)
    bone = np.where(behind_mm > 0, 10 * np.exp(-behind_mm / 0.1), 0)
    slices = []
    for i in range(10):
        open_cell = rng.random(96) < 0.15
        power = rng.exponential(10 ** (bands_db / 10) + np.where(open_cell[:, None], 0, bone))
        ascans = (10 * np.log10(power)).astype(np.float32)
        angle = NOMINAL[:: N_COLUMNS // 96][:96]
        slices.append(replace(drawn_slice(np.zeros(N_COLUMNS), 0.0, 0j, i), ascans=ascans, ascan_angle_rad=angle))
    floor = measure_floor(slices, faces_of(slices), np.zeros(N_DEPTH, np.bool_), ACQUISITION)
    seen = depth * PIXEL_MM > AXIS_MM + RADIUS_MM + 0.1
    apart = (floor - bands_db)[seen]
    assert np.std(apart - np.median(apart)) < 0.35
    assert np.std(bands_db[seen]) > 0.8
