"""The spread of samples among outliers."""

import numpy as np
import pytest

from endoct.stitching.robust import robust_sigma, robust_sigmas


def test_outliers_hardly_move_the_spread() -> None:
    samples = np.random.default_rng(0).normal(0, 2, 20_000)
    samples[::10] = 1e6
    assert robust_sigma(samples) == pytest.approx(2, rel=0.2)
    assert robust_sigma(samples.astype(np.float32)) == pytest.approx(robust_sigma(samples), rel=1e-6)


def test_columns_have_a_spread_each() -> None:
    deviations = np.random.default_rng(1).normal(0, (1, 3), (1000, 2))
    np.testing.assert_array_equal(robust_sigmas(deviations), [robust_sigma(column) for column in deviations.T])
