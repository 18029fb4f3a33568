"""Li's threshold from a histogram."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.filters import threshold_li

from endoct.base.errors import EndoctError
from endoct.fusion.segmentation.threshold import N_BINS, li_threshold


def two_humps(seed: int, share: float, apart: float, n: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    high = rng.random(n) < share
    return np.where(high, rng.normal(apart, 1.0, n), rng.normal(0.0, 0.5, n))


@given(
    seed=st.integers(0, 1000),
    share=st.floats(0.05, 0.6),
    apart=st.floats(2.0, 20.0),
    offset=st.floats(-1e3, 1e3),
    scale=st.floats(1e-3, 1e3),
)
def test_equals_scikit_image_to_within_a_bin(
    seed: int, share: float, apart: float, offset: float, scale: float
) -> None:
    values = two_humps(seed, share, apart) * scale + offset
    bin_width = np.ptp(values) / N_BINS
    assert abs(li_threshold(values) - threshold_li(values)) <= bin_width


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "i4", "f4", "f8"])
@pytest.mark.parametrize("seed", range(4))
def test_equals_scikit_image_on_any_dtype(dtype: str, seed: int) -> None:
    values = two_humps(seed, 0.2, 6.0)
    if dtype[0] in "ui":
        values = (values - values.min()) / np.ptp(values) * (250 if dtype == "u1" else 20_000)
        values = np.rint(values) - (9000 if dtype[0] == "i" else 0)
    values = values.astype(dtype)
    bin_width = max(float(np.ptp(values)) / N_BINS, 1.0 if dtype[0] in "ui" else 0.0)
    assert abs(li_threshold(values) - threshold_li(values.copy())) <= bin_width


def test_many_equal_samples_at_the_floor() -> None:
    values = np.maximum(two_humps(3, 0.2, 5.0), 0.0)
    assert abs(li_threshold(values) - threshold_li(values)) <= np.ptp(values) / N_BINS


def test_what_is_not_finite_is_left_out() -> None:
    values = two_humps(5, 0.3, 8.0)
    assert li_threshold(np.concatenate([values, [np.nan, np.inf]])) == li_threshold(values)


def test_two_values_by_hand() -> None:
    # 3 samples at 1, 1 at 5, shifted by their minimum: back mean 0, so the iteration stops at the mean, 1 + 1
    assert li_threshold(np.array([1.0, 1.0, 1.0, 5.0])) == pytest.approx(2.0)


@pytest.mark.parametrize("values", [np.full(10, 3.0), np.array([]), np.array([np.nan])])
def test_nothing_to_threshold(values: np.ndarray) -> None:
    with pytest.raises(EndoctError, match="nothing to threshold"):
        li_threshold(values)


def test_many_samples_a_bin() -> None:
    values = two_humps(8, 0.1, 3.0, n=400_000).astype(np.float32)
    assert abs(li_threshold(values) - threshold_li(values.copy())) <= np.ptp(values) / N_BINS


@given(n=st.integers(3, 400), seed=st.integers(0, 1000), dtype=st.sampled_from(["f4", "f8", "i4"]))
def test_any_number_of_samples(n: int, seed: int, dtype: str) -> None:
    values = (two_humps(seed, 0.3, 6.0, n) * 1000).astype(dtype)
    bin_width = max(float(np.ptp(values)) / N_BINS, 1.0 if dtype == "i4" else 0.0)
    assert abs(li_threshold(values) - textbook(values)) <= bin_width


@pytest.mark.parametrize("scale", [1e-323, 1e-310, 1e-305, 1e-30, 1e30])
def test_values_of_any_size(scale: float) -> None:
    values = np.array([0.0, 1.0, 2.0, 1.0, 9.0, 8.0]) * scale
    assert li_threshold(values) == pytest.approx(textbook(values), rel=1e-9, abs=0)


def test_one_sample_far_above_the_others() -> None:
    values = np.append(two_humps(2, 0.3, 6.0), 1e12)
    assert li_threshold(values) == pytest.approx(textbook(values), rel=1e-9)


def textbook(values: np.ndarray) -> float:
    """Li's iteration until nothing changes, sample by sample."""
    above = values.astype(np.float64) - float(values.min())
    threshold, before = above.mean(), -1.0
    while threshold != before:
        before, below = threshold, above[above <= threshold].mean()
        if below == 0:
            break
        mean_above = above[above > threshold].mean()
        threshold = (mean_above - below) / (np.log(mean_above) - np.log(below))
    return float(threshold + values.min())
