"""Where a part fits: the correlation at every shift is that of the samples that both have there, counted out."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.registration.rigidity import N_THETA, STEP_MM, _correlations, fit_part, part_of

RADIUS_MM = 1.25
ROWS, BAND = 24, slice(9, 15)


def evidence(seed: int) -> Evidence:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(ROWS, N_THETA)).astype(np.float32)
    valid = rng.random(values.shape) < 0.9
    return Evidence(np.where(valid, values, 0), valid, STEP_MM * np.arange(ROWS), STEP_MM, 0.0, RADIUS_MM, "relief")


def band_of(whole: Evidence) -> Evidence:
    inside = np.zeros((ROWS, N_THETA), np.bool_)
    inside[BAND] = True
    return part_of(whole, inside)


def counted_out(a: Evidence, b: Evidence, rows: int, columns: int) -> float:
    """The correlation of ``b``, moved so, with ``a``: rows that leave it meet nothing, columns go around."""
    pairs = [
        (a.values[i + rows, (j + columns) % N_THETA], b.values[i, j])
        for i, j in zip(*np.nonzero(b.valid), strict=True)
        if 0 <= i + rows < ROWS and a.valid[i + rows, (j + columns) % N_THETA]
    ]
    return float(np.corrcoef(np.array(pairs, np.float64).T)[0, 1])


def test_correlations_are_those_counted_out():
    a, b = evidence(0), band_of(evidence(1))
    found = _correlations(a, b, 9, 3)
    for rows, columns in ((0, 0), (-9, 3), (9, -3), (4, -1)):
        assert abs(found[9 + rows, 3 + columns] - counted_out(a, b, rows, columns)) < 1e-9


def test_a_band_is_found_where_it_belongs_over_the_seam_too():
    a = evidence(2)
    values, valid = (np.roll(image, (3, -5), axis=(0, 1)) for image in (a.values, a.valid))
    moved = band_of(replace(a, values=values, valid=valid))
    fit = fit_part(a, moved, 6 * STEP_MM, 8 * 2 * np.pi / N_THETA)
    assert fit.along_mm == -3 * STEP_MM
    assert abs(fit.around_mm - 5 * 2 * np.pi / N_THETA * RADIUS_MM) < 0.2 * STEP_MM
    assert fit.correlation[0] > 0.99


def test_a_part_of_which_nothing_was_observed_fits_nowhere():
    a = evidence(3)
    nothing = part_of(a, np.zeros((ROWS, N_THETA), np.bool_))
    assert fit_part(a, nothing, 0.2, 0.1).correlation == (0.0, 0.0)


@pytest.mark.parametrize("between", [0.3, -0.3])
def test_a_smooth_band_is_placed_along_between_rows(between: float):
    """Of a smooth pattern, moved by two rows and a part of one, and by four columns around, over the seam."""
    z_px, around = np.arange(ROWS)[:, None], 2 * np.pi / N_THETA * np.arange(N_THETA)

    def pattern(moved_px: float, columns: int) -> Evidence:
        z, theta = z_px - moved_px, around - 2 * np.pi / N_THETA * columns
        values = np.exp(-0.5 * ((z - 11) / 3) ** 2) * np.cos(3 * theta) + 0.5 * np.sin(0.4 * z + 2 * theta)
        return replace(a, values=values.astype(np.float32), valid=np.ones(a.valid.shape, np.bool_))

    a = evidence(2)
    fit = fit_part(pattern(2 + between, 4), band_of(pattern(0, 0)), 6 * STEP_MM, 8 * 2 * np.pi / N_THETA)
    assert fit.along_mm == 2 * STEP_MM
    assert abs(fit.between_mm - between * STEP_MM) < 0.06 * STEP_MM
