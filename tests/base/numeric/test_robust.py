"""The spread of samples among outliers."""

import numpy as np
import pytest
from tolerances import MEDIAN_ERROR

from endoct.base.numeric.ranks import error_of_median, robust_sigma, robust_sigmas


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
