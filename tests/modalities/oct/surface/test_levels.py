"""The levels of noise and wall."""

import math

import numpy as np
import pytest

from endoct.modalities.oct.surface.evidence import Background
from endoct.modalities.oct.surface.levels import measure_levels
from tests.modalities.oct.turning.drawn_slices import (
    ACQUISITION,
    AXIS_MM,
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
