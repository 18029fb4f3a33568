"""Medians and quantiles are those of NumPy."""

import numpy as np
import pytest
from tolerances import MEDIAN_ERROR

from endoct.base.numeric.ranks import (
    error_of_median,
    median,
    median_in_loops,
    medians,
    quantile,
    quantile_pair,
    quantiles,
    ranked,
    robust_limits,
    robust_sigma,
    robust_sigmas,
)

SAMPLES = np.random.default_rng(1).normal(size=(37, 20)).astype(np.float32)


def test_median() -> None:
    for samples in (SAMPLES, SAMPLES[:36], SAMPLES[0, :1]):
        assert median(samples) == pytest.approx(float(np.median(samples)), rel=1e-6)
    assert np.isnan(median(np.array([1.0, np.nan, 2.0])))
    assert np.isnan(median(np.empty(0)))


@pytest.mark.parametrize("dtype", ["f4", "f8", "u2"])
@pytest.mark.parametrize("n", [1, 2, 3, 600, 20_001])
def test_single_ones_are_those_of_what_is_sorted(n: int, dtype: str) -> None:
    samples = (np.random.default_rng(n).random(n) * 1000).astype(dtype)
    ordered = np.sort(samples)
    assert median(samples) == float((ordered[(n - 1) // 2] + ordered[n // 2]) / 2)
    assert quantile_pair(samples, 0.0, 1.0) == (ordered[0], ordered[-1])
    assert quantile_pair(samples, 0.1, 0.7) == pytest.approx(tuple(np.quantile(samples, (0.1, 0.7))), rel=1e-6)


def test_nan_is_the_largest() -> None:
    holed = np.array([3.0, np.nan, 1.0, 2.0, np.nan])
    assert quantile_pair(holed, 0.0, 0.25) == (1.0, 2.0)
    assert np.isnan(quantile_pair(holed, 0.0, 1.0)[1])


def test_medians_leave_out_what_is_not_finite() -> None:
    holed = SAMPLES.copy()
    holed[::3, 4], holed[:, 7] = np.nan, np.nan
    found = medians(holed)
    assert np.isnan(found[7])
    known = np.arange(20) != 7
    np.testing.assert_allclose(found[known], np.nanmedian(holed[:, known], axis=0), rtol=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.93, 1.0])
def test_quantiles(share: float) -> None:
    np.testing.assert_allclose(quantiles(SAMPLES, share), np.quantile(SAMPLES, share, axis=0), rtol=1e-5)
    assert quantile(SAMPLES, share) == pytest.approx(float(np.quantile(SAMPLES, share)), rel=1e-6)
    assert quantile(SAMPLES[0, :1], share) == SAMPLES[0, 0]
    both = quantile_pair(SAMPLES, share, 0.5)
    np.testing.assert_allclose(both, np.quantile(SAMPLES, (share, 0.5)), rtol=1e-6)


def test_ranked_takes_what_counts() -> None:
    counted = SAMPLES > 0
    least = ranked(SAMPLES, counted, np.zeros(20, np.intp))
    np.testing.assert_array_equal(least, np.where(counted, SAMPLES, np.inf).min(axis=0))
    too_far = ranked(SAMPLES, counted, np.full(20, 36))
    assert np.isinf(too_far).all()


def test_outliers_hardly_move_the_spread() -> None:
    samples = np.random.default_rng(0).normal(0, 2, 20_000)
    samples[::10] = 1e6
    assert robust_sigma(samples) == pytest.approx(2, rel=0.2)
    assert robust_sigma(samples.astype(np.float32)) == pytest.approx(robust_sigma(samples), rel=1e-6)


def test_columns_have_a_spread_each() -> None:
    deviations = np.random.default_rng(1).normal(0, (1, 3), (1000, 2))
    np.testing.assert_array_equal(robust_sigmas(deviations), [robust_sigma(column) for column in deviations.T])


def test_a_median_errs_as_stated() -> None:
    """Over 2000 medians of 80 samples each, their errors over what is stated have a root mean square of 1."""
    samples = np.random.default_rng(2).normal(3, 2, (2000, 80))
    medians = np.median(samples, axis=1)
    stated = [error_of_median(row - median) for row, median in zip(samples, medians, strict=True)]
    assert np.sqrt(np.mean(((medians - 3) / stated) ** 2)) == pytest.approx(1, abs=MEDIAN_ERROR)


@pytest.mark.parametrize("samples", [[], [3.0], [2.0, 1.0], [1.0, 1.0, 5.0, 1.0], list(range(7)), [2.0, -1.0] * 50])
def test_a_median_in_loops_is_numpys(samples: list[float]) -> None:
    expected = np.median(samples) if samples else np.nan
    assert median_in_loops(np.array(samples, np.float64)) == pytest.approx(expected, abs=0, nan_ok=True)


def test_a_median_in_loops_is_numpys_at_random() -> None:
    rng = np.random.default_rng(0)
    for n in range(1, 200):
        samples = rng.integers(0, max(n // 2, 2), n) + 0.25
        assert median_in_loops(samples.copy()) == np.median(samples)


@pytest.mark.parametrize("value", [0.0, -3.5, 1e9, -1e30, 3e38])
def test_an_image_of_one_value_has_limits_all_the_same(value: float) -> None:
    values = np.full((4, 5), value, np.float32)
    low, high = robust_limits(values, np.ones(values.shape, np.bool_))
    assert low < value < high
    assert np.isfinite(255 / (high - low))


def test_limits_are_percentiles_of_what_is_valid_and_finite() -> None:
    values = np.array([-100.0, *range(101), np.nan])
    valid = values > -50
    valid[-1] = True
    assert robust_limits(values, valid, 10, 90) == (10.0, 90.0)
    assert robust_limits(values, np.zeros(values.shape, np.bool_)) == (0.0, 1.0)
