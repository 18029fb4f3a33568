"""The wall in one B-scan."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.arrays import Image
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import LN_POWER_PER_SIGMA, Background, spread_of_noise
from endoct.modalities.oct.surface.wall import (
    AT_ONCE,
    BAND_MM,
    BONUS_PER_MM,
    FRONT_PER_MM,
    LOOK_MM2,
    MOST_POWER,
    PATCH_MM,
    _best_path,
    favour_bore,
    first_edge,
    gap_rows,
    largest,
    surface_evidence,
)
from tests.modalities.oct.surface.drawn_bscans import (
    BACKGROUND,
    COLUMN_MM,
    FIRST_ROW,
    N_DEPTH,
    N_THETA,
    NO_LINE,
    PIXEL_MM,
    SPACING,
    SPECKLE,
    bscan,
    speckled,
)


def test_a_wavy_wall_with_a_pit_is_followed() -> None:
    wall = np.round(100 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[200:240] += 40
    row = first_edge(bscan(wall), FIRST_ROW, BACKGROUND, SPACING, OctParameters())
    error = np.abs(row - wall)
    assert np.median(error) <= 1
    assert np.mean(error > 3) < 0.02


@pytest.mark.parametrize("column_mm", [COLUMN_MM, 0.004])
@pytest.mark.parametrize("turn", [137, 400])
def test_turning_the_bscan_turns_the_wall(turn: int, column_mm: float) -> None:
    wall = np.round(100 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[590:] += 30
    wall[:15] += 30
    image = bscan(wall)
    row = first_edge(image, FIRST_ROW, BACKGROUND, Spacing(PIXEL_MM, column_mm), OctParameters())
    turned = first_edge(
        np.roll(image, turn, axis=0), FIRST_ROW, BACKGROUND, Spacing(PIXEL_MM, column_mm), OctParameters()
    )
    np.testing.assert_array_equal(np.roll(row, turn), turned)


def test_noise_alone_has_no_surface() -> None:
    row = first_edge(bscan(np.full(N_THETA, N_DEPTH)), FIRST_ROW, BACKGROUND, SPACING, OctParameters())
    # at the very end of the range a few samples decide, which is as good as no surface
    assert np.all(row > N_DEPTH - 15)


def test_a_wall_fainter_than_noise_is_found() -> None:
    wall = np.round(90 + 15 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    power = np.where(np.arange(N_THETA) < 350, 5.0, 0.5)
    row = first_edge(speckled(power, wall), FIRST_ROW, SPECKLE, SPACING, OctParameters())
    assert np.mean(np.abs(row - wall) <= 10) > 0.97


def test_darkness_where_bone_should_be_is_a_cell() -> None:
    wall = np.full(N_THETA, 80)
    wall[100:130], wall[400:450] = 130, N_DEPTH  # a floor, and none in reach
    images = [speckled(np.full(N_THETA, 5.0), wall, seed) for seed in range(8)]
    rows = np.stack([first_edge(image, FIRST_ROW, SPECKLE, SPACING, OctParameters()) for image in images])
    assert np.mean(np.abs(rows - wall)[:, :390] <= 8) > 0.98
    assert np.mean(rows[:, 402:448] > 110) > 0.97


def test_a_bright_speck_before_the_wall_is_not_the_wall() -> None:
    wall = np.full(N_THETA, 120)
    image = bscan(wall)
    image[300:302, 60:62] = 250
    row = first_edge(image, FIRST_ROW, BACKGROUND, SPACING, OctParameters())
    assert np.max(np.abs(row[290:310] - 120)) < 8


def test_the_path_is_closed_wherever_the_turn_begins() -> None:
    """In noise as strong as the wall's evidence, columns are held by both their neighbours, also over the seam."""
    rng = np.random.default_rng(1)
    states = 20 + np.round(6 * np.sin(2 * np.pi * np.arange(160) / 160)).astype(int)
    evidence = rng.normal(0, 1, (160, 40)).astype(np.float32)
    evidence[np.arange(160), states] += 1
    path = _best_path(evidence, 0.5, 3.0)
    assert np.mean(np.abs(path - states) <= 2) > 0.7
    for turn in range(1, 160, 3):
        turned = _best_path(np.roll(evidence, turn, axis=0), 0.5, 3.0)
        np.testing.assert_array_equal(turned, np.roll(path, turn))


def test_the_bore_runs_on_where_it_is_not_seen() -> None:
    angle = 2 * np.pi * np.arange(N_THETA) / N_THETA
    true = 60 + 6 * np.cos(angle) + 3 * np.sin(2 * angle)
    rows = np.round(FIRST_ROW + true).astype(np.intp)
    rows[50:130] += 40
    rows[300:380] = N_DEPTH
    evidence = np.ones((N_THETA, N_DEPTH + 1), np.float32)
    assert np.abs(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM) - true).max() < 2
    rows[:] = N_DEPTH
    assert np.isnan(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM)).all()


def test_surfaces_without_any_evidence_are_no_bore() -> None:
    rows = (FIRST_ROW + 40).astype(np.intp)
    evidence = np.full((N_THETA, N_DEPTH + 1), -1, np.float32)
    assert np.isnan(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM)).all()


@pytest.mark.parametrize("turn", [0, 211])
def test_a_third_of_wrong_surfaces_in_noise_does_not_move_the_bore(turn: int) -> None:
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(N_THETA) / N_THETA
    true = 60 + 5 * np.cos(angle + 1) + 4 * np.cos(2 * angle)
    rows = FIRST_ROW + true + rng.normal(0, 1.5, N_THETA)
    rows[rng.random(N_THETA) < 0.25] -= 25  # specks before the wall
    rows[:60] += 50  # a cell over the seam
    evidence = np.full((N_THETA, N_DEPTH + 1), 1, np.float32)
    evidence[:100] = 40  # a bright side
    rows = np.roll(np.round(rows).astype(np.intp), turn)
    found = gap_rows(rows, FIRST_ROW, np.roll(evidence, turn, axis=0), PIXEL_MM)
    assert np.abs(found - np.roll(true, turn)).max() < 3
    assert np.abs(found - np.roll(true, turn)).mean() < 1


def test_evidence_is_raised_at_the_bore_and_lowered_before_it() -> None:
    wall = 60 + 0.25 * np.arange(N_THETA) % 20
    evidence = np.random.default_rng(2).normal(size=(N_THETA, N_DEPTH + 1)).astype(np.float32)
    before = evidence.copy()
    favour_bore(evidence, wall, SPACING)
    bonus, front = (per_mm * SPACING.column_mm for per_mm in (BONUS_PER_MM, FRONT_PER_MM))
    bands = (np.arange(N_DEPTH + 1) - wall[:, None]) * PIXEL_MM / BAND_MM
    expected = bonus * np.clip(2 - np.abs(bands), 0, 1) - front * np.clip(-2 - bands, 0, 1)
    np.testing.assert_allclose((evidence - before)[:, :N_DEPTH], expected[:, :N_DEPTH], atol=1e-3)


@pytest.mark.parametrize("n", [1, 2, AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE, 5 * AT_ONCE + 7])
def test_the_largest_is_found_at_every_place(n: int) -> None:
    for place in range(n):
        values = -np.arange(1, n + 1, dtype=np.float32)
        values[place] = 0.5
        assert largest(values) == 0.5
    assert largest(np.full(n, -np.inf, np.float32)) == -np.inf


PARAMETERS, TOGETHER = OctParameters(), 2


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
