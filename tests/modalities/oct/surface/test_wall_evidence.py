"""The evidence for a surface, against its definition written out sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.arrays import Image
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.wall_evidence import (
    LN_POWER_PER_SIGMA,
    LOOK_MM2,
    MOST_POWER,
    PATCH_MM,
    Background,
    relative_power,
    spread_of_noise,
    surface_evidence,
)
from tests.modalities.oct.surface.drawn_bscans import NO_LINE, SPECKLE, speckled

SPACING, PARAMETERS = Spacing(0.005, 0.013), OctParameters()
N_THETA, TOGETHER = 600, 2


def written_out(level: Image, start: int, first_row: np.ndarray, background: Background) -> np.ndarray:
    power = np.exp(LN_POWER_PER_SIGMA * (level - background.noise) / background.noise_sigma)
    bone = (1 + PARAMETERS.least_signal) * background.noise_power
    of_haze = np.exp(LN_POWER_PER_SIGMA * 0.2 * background.contrast / background.noise_sigma)
    each = np.minimum(power / max(bone, of_haze), MOST_POWER) - 1
    signal = np.roll(each, -start, axis=0).reshape(-1, TOGETHER, level.shape[1]).sum(axis=1)
    signal *= SPACING.depth_mm * SPACING.column_mm / LOOK_MM2
    n, n_rows = signal.shape
    signal[np.arange(n_rows) < first_row[:, None]] = 0
    tall = round(PATCH_MM[1] / SPACING.depth_mm)
    wide = round(PATCH_MM[0] / (SPACING.column_mm * TOGETHER)) | 1
    evidence = np.zeros((n, n_rows + 1))
    repeated = np.pad(signal, ((0, 0), (tall, 0)), mode="edge")
    above = np.stack([repeated[:, row + 1 : row + 1 + tall].sum(axis=1) for row in range(n_rows)], axis=1)
    around = np.stack([np.roll(above, k, axis=0) for k in range(-(wide // 2), wide // 2 + 1)]).sum(axis=0)
    before = np.cumsum(np.maximum(around / (wide * tall), 0), axis=1)
    for row in range(n_rows):
        decayed = np.exp(-SPACING.depth_mm / PARAMETERS.wall_decay_mm) ** np.arange(n_rows - row)
        evidence[:, row] = signal[:, row:] @ decayed
    evidence[:, 1:] -= before
    return evidence


@pytest.mark.parametrize("start", [0, 517])
def test_evidence_is_the_power_behind_a_surface_less_bright_patches_before_it(start: int) -> None:
    rng = np.random.default_rng(0)
    wall = (60 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    level = speckled(rng.uniform(0.5, 6, N_THETA), wall)
    first_row = rng.integers(5, 30, N_THETA // TOGETHER)
    background = replace(SPECKLE, wall=SPECKLE.noise + 14.0)
    assert spread_of_noise(background) == background.noise_sigma
    found = surface_evidence(level, start, first_row, background, SPACING, PARAMETERS)
    expected = written_out(level, start, first_row, background)
    counted = np.arange(level.shape[1] + 1) >= first_row[:, None]
    np.testing.assert_allclose(found[counted], expected[counted], atol=0.02, rtol=1e-4)
    assert (found[~counted] < -1e5).all()


def test_what_is_hidden_under_a_line_is_as_likely_as_what_lies_behind_it() -> None:
    level = speckled(np.full(N_THETA, 4.0), np.full(N_THETA, 80))
    excess = NO_LINE.copy()
    excess[60:64] = 30
    lined = replace(SPECKLE, line_excess=excess)
    assert np.flatnonzero(lined.hidden).tolist() == [60, 61, 62, 63]
    first_row = np.full(N_THETA // TOGETHER, 20)
    found = surface_evidence(level, 3, first_row, lined, SPACING, PARAMETERS)
    without = np.delete(level, slice(60, 64), axis=1)
    plain = surface_evidence(without, 3, first_row, replace(SPECKLE, line_excess=NO_LINE[4:]), SPACING, PARAMETERS)
    np.testing.assert_array_equal(np.delete(found, slice(60, 64), axis=1), plain)
    for row in range(60, 64):
        np.testing.assert_array_equal(found[:, row], found[:, 64])


def test_power_is_that_of_exponential_noise_over_its_median_and_never_overflows() -> None:
    noise = 10 * np.log10(np.random.default_rng(1).exponential(1, 200_000))
    median = float(np.median(noise))
    spread = 1.4826 * float(np.median(np.abs(noise - median)))
    power = relative_power(noise.astype(np.float32), median, spread)
    assert power.mean() == pytest.approx(1 / np.log(2), rel=0.02)
    assert np.isfinite(relative_power(np.array([1e9], np.float32), median, spread)).all()
