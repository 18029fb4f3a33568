"""Intervals that hold what they promise, and limits of agreement by hand."""

import numpy as np
import pytest
from scipy.stats import bootstrap
from tolerances import COVERAGE

from endoct.fusion.scoring.intervals import bland_altman, interval_of, ratio_interval, repeatability


def test_an_interval_of_a_ratio_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    hits = []
    for _ in range(300):
        size = rng.lognormal(0, 0.8, 40)
        interval = ratio_interval(size * rng.beta(8, 2, 40), size)
        assert interval is not None
        hits.append(interval[0] < 0.8 < interval[1])
    assert np.mean(hits) == pytest.approx(0.95, abs=COVERAGE)


def test_as_scipy_bootstraps_it() -> None:
    rng = np.random.default_rng(1)
    above = rng.random(50)
    below = above + rng.random(50)
    found = ratio_interval(above, below)
    theirs = bootstrap(
        (above, below),
        lambda a, b, axis: a.sum(axis) / b.sum(axis),
        paired=True,
        vectorized=True,
        method="percentile",
        n_resamples=2000,
        rng=np.random.default_rng(2),
    ).confidence_interval
    assert found == pytest.approx((theirs.low, theirs.high), abs=0.01)


def test_the_same_again_and_too_few() -> None:
    values = np.arange(10.0)
    assert interval_of(values) == interval_of(values)
    assert interval_of(values[:4]) is None
    assert ratio_interval(values[:4], values[:4] + 1) is None


def test_limits_of_agreement_by_hand() -> None:
    a, b = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.1, 2.3, 3.1, 4.3])
    found = bland_altman(a, b)
    assert found is not None
    assert found.pairs == 4
    assert found.bias == pytest.approx(0.2)
    spread = 1.96 * np.std([0.1, 0.3, 0.1, 0.3], ddof=1)
    assert (found.low, found.high) == pytest.approx((0.2 - spread, 0.2 + spread))
    assert bland_altman(a[:2], b[:2]) is None


def test_repeatability_as_shrout_and_fleiss_have_it() -> None:
    # their table 2: six targets, four judges; ICC(1,1) = 0.17, MSW = 6.26
    table = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
    found = repeatability(table)
    assert found is not None
    assert found["icc"] == pytest.approx(0.17, abs=0.005)
    assert found["within_sd"] == pytest.approx(np.sqrt(6.26), abs=0.002)
    assert found["repeatability"] == pytest.approx(1.96 * np.sqrt(2 * 6.264), abs=0.01)


def test_repeatability_of_nothing_repeated() -> None:
    assert repeatability([[1.0], [2.0]]) is None
    one = repeatability([[1.0, 2.0]])
    assert one is not None
    assert one["icc"] is None
    assert one["within_sd"] == pytest.approx(np.sqrt(0.5))


def test_spread_between_specimens_by_hand() -> None:
    # means 2, 6 and 10 of two each: MSB = 2 · (16 + 0 + 16) / 2 = 32, MSW = 2, so √((32 − 2) / 2) and 30 / 34
    found = repeatability([[1.0, 3.0], [5.0, 7.0], [9.0, 11.0]])
    assert found is not None
    assert (found["specimens"], found["comparisons"]) == (3, 6)
    assert found["between_sd"] == pytest.approx(np.sqrt(15))
    assert found["icc"] == pytest.approx(30 / 34)
    # a specimen of three, one of one: k₀ = 4 − (9 + 1) / 4 = 1.5, MSB = 3 · 1 + 1 · 9 = 12, MSW = 2 / 2 = 1
    uneven = repeatability([[1.0, 2.0, 3.0], [6.0]])
    assert uneven is not None
    assert uneven["between_sd"] == pytest.approx(np.sqrt(11 / 1.5))
    assert uneven["icc"] == pytest.approx(11 / (12 + 0.5 * 1))
    same = repeatability([[1.0, 3.0], [3.0, 1.0]])  # differs within specimens alone
    assert same is not None
    assert same["between_sd"] == 0
    nothing = repeatability([[1.0, 1.0], [1.0, 1.0]])
    assert nothing is not None
    assert nothing["icc"] is None
