"""The noise floor over depth."""

import numpy as np

from endoct.modalities.oct.surface.noise_floor import measure_floor
from tests.modalities.oct.turning.drawn_slices import (
    ACQUISITION,
    AXIS_MM,
    BORE_MM,
    N_NOISE,
    PIXEL_MM,
    RADIUS_MM,
    faces_of,
    noisy_slice,
)

N_DEPTH = 360


def test_bands_of_the_noise_are_measured_though_bone_lies_in_them() -> None:
    rng = np.random.default_rng(0)
    depth = np.arange(N_DEPTH)
    bands_db = 1.3 * np.sin(2 * np.pi * depth / 90)
    behind_mm = depth * PIXEL_MM - (AXIS_MM + BORE_MM)
    bone = np.where(behind_mm > 0, 10 * np.exp(-behind_mm / 0.1), 0)
    slices = []
    for i in range(10):
        open_cell = rng.random(N_NOISE) < 0.15
        power = rng.exponential(10 ** (bands_db / 10) + np.where(open_cell[:, None], 0, bone))
        slices.append(noisy_slice(power, 0j, i))
    floor = measure_floor(slices, faces_of(slices), np.zeros(N_DEPTH, np.bool_), ACQUISITION)
    seen = depth * PIXEL_MM > AXIS_MM + RADIUS_MM + 0.1
    apart = (floor - bands_db)[seen]
    assert np.std(apart - np.median(apart)) < 0.35
    assert np.std(bands_db[seen]) > 0.8
