"""The bore's own wall."""

import numpy as np

from endoct.modalities.oct.surface.bore import gap_rows
from tests.modalities.oct.surface.drawn_bscans import FIRST_ROW, N_DEPTH, N_THETA, PIXEL_MM


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
