"""The levels of noise and wall."""

import math
from dataclasses import replace

import numpy as np
import pytest

from endoct.modalities.oct.surface.background import Background
from endoct.modalities.oct.surface.levels import measure_floor, measure_levels
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

N_DEPTH = 500
FACE_ROW = round((AXIS_MM + RADIUS_MM) / PIXEL_MM)
LEVEL_DB, SPREAD_DB = 10 * math.log10(math.log(2)), 4.95
"""Of noise whose power is exponentially distributed, with mean 1; by the median."""


def levels_with_line(first: int, last: int, offset_mm: float) -> Background:
    """The levels of noise alone, in dB, the detector's line between two rows, the catheter so far off the axis."""
    rng = np.random.default_rng(0)
    excess = np.zeros(N_DEPTH, np.float32)
    excess[first:last] = 20
    slices = []
    for i in range(20):
        power = rng.exponential(1, (N_NOISE, N_DEPTH)) * 10 ** (excess / 10)
        slices.append(noisy_slice(power, offset_mm + 0j, i))
    return measure_levels(slices, faces_of(slices), excess, np.zeros(N_DEPTH, np.float32), ACQUISITION)


@pytest.mark.parametrize("rows", [(0, 0), (FACE_ROW + 5, FACE_ROW + 28), (FACE_ROW + 12, FACE_ROW + 16)])
@pytest.mark.parametrize("offset_mm", [0.0, 0.1, 0.2])
def test_a_line_in_the_dark_space_does_not_count_as_noise(rows: tuple[int, int], offset_mm: float) -> None:
    levels = levels_with_line(*rows, offset_mm)
    assert levels.noise == pytest.approx(LEVEL_DB, abs=0.15)
    assert levels.noise_sigma == pytest.approx(SPREAD_DB, abs=0.15)
    assert levels.noise_power == pytest.approx(1 / math.log(2), abs=0.05)


def test_where_all_dark_space_is_under_a_line_there_are_levels_still() -> None:
    levels = levels_with_line(FACE_ROW - 20, FACE_ROW + 100, 0.0)
    assert np.isfinite([levels.noise, levels.noise_power]).all()
    assert levels.noise_sigma > 0


N_ROWS = 360


def test_bands_of_the_noise_are_measured_though_bone_lies_in_them() -> None:
    rng = np.random.default_rng(0)
    depth = np.arange(N_ROWS)
    bands_db = 1.3 * np.sin(2 * np.pi * depth / 90)
    behind_mm = depth * PIXEL_MM - (AXIS_MM + BORE_MM)
    bone = np.where(behind_mm > 0, 10 * np.exp(-behind_mm / 0.1), 0)
    slices = []
    for i in range(10):
        open_cell = rng.random(N_NOISE) < 0.15
        power = rng.exponential(10 ** (bands_db / 10) + np.where(open_cell[:, None], 0, bone))
        power[:, :FACE_ROW] *= 1000  # the glass, which is no gap
        slices.append(noisy_slice(power, 0j, i))
    floor = measure_floor(slices, faces_of(slices), np.zeros(N_ROWS, np.bool_), ACQUISITION)
    seen = depth * PIXEL_MM > AXIS_MM + RADIUS_MM + 0.1
    apart = (floor - bands_db)[seen]
    assert np.std(apart - np.median(apart)) < 0.35
    assert np.std(bands_db[seen]) > 0.8


@pytest.mark.parametrize("offset_mm", [0.0, 0.15, 0.25])
@pytest.mark.parametrize("open_share", [0.0, 0.05])
def test_bone_without_cells_is_no_noise(offset_mm: float, open_share: float) -> None:
    """Deeper than the gap between glass and wall ever reaches, the darkest A-scans are bone: 20 dB of it here."""
    rng = np.random.default_rng(1)
    depth_mm = np.arange(N_ROWS) * PIXEL_MM
    bands_db = 0.8 * np.sin(2 * np.pi * np.arange(N_ROWS) / 90)
    slices = [noisy_slice(np.ones((N_NOISE, N_ROWS)), offset_mm + 0j, i) for i in range(10)]
    faces = faces_of(slices)
    for i, empty in enumerate(slices):
        wall = replace(faces.capillary.circle(i), radius_mm=BORE_MM).depth_mm(empty.ascan_angle_rad)
        behind_mm = depth_mm - wall[:, None]
        behind_mm -= 5.0 * (rng.random(N_NOISE) < open_share)[:, None]
        power = 10 ** (bands_db / 10) + np.where(behind_mm > 0, 100 * np.exp(-behind_mm / 0.2), 0)
        slices[i] = noisy_slice(rng.exponential(power), offset_mm + 0j, i)
    floor = measure_floor(slices, faces, np.zeros(N_ROWS, np.bool_), ACQUISITION)
    known = (depth_mm > AXIS_MM + RADIUS_MM - offset_mm + 0.1) & (depth_mm < AXIS_MM + BORE_MM + offset_mm)
    apart_db = floor[known] - bands_db[known]
    assert np.abs(apart_db - np.median(apart_db)).max() < 2.5
    assert np.ptp(floor) < 4.5


def test_without_a_gap_nothing_is_known_of_the_floor() -> None:
    narrow = ACQUISITION.model_copy(update={"bore_diameter_mm": 2 * RADIUS_MM + 0.2})
    slices = [noisy_slice(np.ones((N_NOISE, N_ROWS)), 0.1 + 0j, i) for i in range(4)]
    assert not measure_floor(slices, faces_of(slices), np.zeros(N_ROWS, np.bool_), narrow).any()
