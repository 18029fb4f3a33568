"""The bore's own wall."""

import numpy as np
import pytest

from endoct.modalities.oct.surface.wall import BAND_MM, BONUS_PER_MM, FRONT_PER_MM, favour_bore, gap_rows
from tests.modalities.oct.surface.drawn_bscans import FIRST_ROW, N_DEPTH, N_THETA, PIXEL_MM, SPACING


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
