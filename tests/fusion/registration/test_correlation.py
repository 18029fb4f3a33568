"""Masked correlation and its score, against sums over the samples that meet."""

import numpy as np
import pytest

from endoct.fusion.registration.search import FEWEST_PIECES, PIECE_MM2, masked_correlation, padded_rows, score, spectra

N_THETA = 24


@pytest.mark.parametrize(("rows_a", "rows_b"), [(20, 13), (9, 17), (12, 12)])
def test_every_shift_has_pearsons_correlation_of_what_meets(rows_a: int, rows_b: int) -> None:
    rng = np.random.default_rng(rows_a)
    a, b = (rng.normal(3, 2, (rows, N_THETA)).astype(np.float32) for rows in (rows_a, rows_b))
    b[: min(rows_a, rows_b)] += np.roll(a, 5, axis=1)[: min(rows_a, rows_b)]
    seen_a, seen_b = (rng.random(image.shape) < 0.8 for image in (a, b))
    seen_a[3:6, -4:] = seen_b[2:5, :3] = False  # at the seam
    padded = padded_rows(rows_a, rows_b)
    assert padded >= rows_a + rows_b - 1
    correlation, overlap = masked_correlation(spectra(a, seen_a, padded), spectra(b, seen_b, padded))
    assert correlation.shape == overlap.shape == (rows_a + rows_b - 1, N_THETA)
    for lag_z in range(1 - rows_b, rows_a):
        first, last = max(0, lag_z), min(rows_a, lag_z + rows_b)
        for lag in range(N_THETA):
            on_a = (np.roll(part, lag, axis=1)[first - lag_z : last - lag_z] for part in (b, seen_b))
            moved, seen = on_a
            both = seen & seen_a[first:last]
            assert overlap[lag_z + rows_b - 1, lag] == both.sum()
            if both.sum() > 20:
                expected = np.corrcoef(moved[both], a[first:last][both])[0, 1]
                assert correlation[lag_z + rows_b - 1, lag] == pytest.approx(expected, abs=1e-4)
    row, column = np.unravel_index(np.argmax(correlation * (overlap > 60)), correlation.shape)
    assert (row - rows_b + 1, column) == (0, N_THETA - 5)


def test_what_shows_nothing_correlates_with_nothing() -> None:
    flat, noise = np.full((8, N_THETA), 2, np.float32), np.random.default_rng(0).normal(size=(8, N_THETA))
    all_, none = np.ones(flat.shape, np.bool_), np.zeros(flat.shape, np.bool_)
    for one, seen in ((flat, all_), (noise.astype(np.float32), none)):
        other = spectra(noise.astype(np.float32), all_, padded_rows(8, 8))
        assert not masked_correlation(spectra(one, seen, padded_rows(8, 8)), other)[0].any()


def test_a_score_counts_in_standard_deviations_of_chance() -> None:
    """Of 4000 correlations of independent pieces, the scores scatter by 1; with too few pieces they are 0."""
    rng = np.random.default_rng(1)
    n = 40 + FEWEST_PIECES - 3  # Fisher: 1/√(n − 3)
    by_chance = np.array([np.corrcoef(rng.normal(size=(2, n)))[0, 1] for _ in range(4000)], np.float32)
    scores = score(by_chance, np.full(4000, (40 + FEWEST_PIECES) * PIECE_MM2, np.float32))
    assert np.sqrt(np.mean(scores**2)) == pytest.approx(1, abs=0.05)
    assert (scores >= 0).all()
    few = score(np.array([0.9, 1.0], np.float32), np.array([FEWEST_PIECES * PIECE_MM2, 10.0], np.float32))
    assert few[0] == 0
    assert np.isfinite(few[1])
