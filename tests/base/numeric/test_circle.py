"""Filters on the wall: θ has no seam."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL, IMAGE_ATOL

from endoct.base.numeric.circle import (
    gaussian,
    largest_divisor,
    mean_angle_rad,
    pad_circle,
    turned_harmonic,
    wrap_rad,
)


def noise(rows: int = 12, columns: int = 64) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(rows, columns)).astype(np.float32)


@pytest.mark.parametrize(("angle", "wrapped"), [(0, 0), (np.pi, -np.pi), (1.5 * np.pi, -0.5 * np.pi), (-4 * np.pi, 0)])
def test_wrap_by_hand(angle: float, wrapped: float) -> None:
    assert wrap_rad(angle) == pytest.approx(wrapped, abs=COORDINATE_ATOL)


@given(st.floats(-100, 100))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = float(wrap_rad(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


@given(st.integers(-200, 200), st.floats(0.3, 20))
def test_blurring_and_turning_commute(columns: int, sigma_px: float) -> None:
    image = noise()
    turned_then_blurred = gaussian(np.roll(image, columns, axis=1), 1.0, sigma_px)
    blurred_then_turned = np.roll(gaussian(image, 1.0, sigma_px), columns, axis=1)
    np.testing.assert_allclose(turned_then_blurred, blurred_then_turned, atol=IMAGE_ATOL)


def test_an_impulse_at_the_seam_spreads_over_it() -> None:
    image = np.zeros((1, 32), np.float32)
    image[0, 0] = 1.0
    blurred = gaussian(image, 0.0, 2.0)[0]
    np.testing.assert_allclose(blurred[1:], blurred[:0:-1], atol=IMAGE_ATOL)
    assert blurred[31] == pytest.approx(np.exp(-1 / 8) / (2 * np.sqrt(2 * np.pi)), rel=1e-3)


@given(st.just(0.0) | st.floats(0.1, 5), st.just(0.0) | st.floats(0.1, 40))
def test_a_constant_stays_and_the_mean_over_theta_is_kept(sigma_rows_px: float, sigma_columns_px: float) -> None:
    constant = np.full((5, 16), 3.0, np.float32)
    np.testing.assert_allclose(gaussian(constant, sigma_rows_px, sigma_columns_px), constant, atol=1e-5)
    image = noise(1)
    assert gaussian(image, 0, sigma_columns_px).mean() == pytest.approx(image.mean(), abs=1e-4)


def test_the_input_is_not_changed_and_zero_sigma_changes_nothing() -> None:
    image = noise()
    before = image.copy()
    np.testing.assert_array_equal(gaussian(image, 0, 0), before)
    gaussian(image, 2, 2)
    np.testing.assert_array_equal(image, before)


def test_the_mean_of_angles_does_not_mind_the_seam() -> None:
    assert mean_angle_rad([6.2, 0.1, np.nan]) == pytest.approx((6.2 + 0.1) / 2 - np.pi, abs=COORDINATE_ATOL)
    np.testing.assert_allclose(mean_angle_rad([[1.0, 2.0], [3.0, 3.0]], axis=1), [1.5, 3.0], atol=COORDINATE_ATOL)


def test_a_turned_harmonic_is_the_same_wave() -> None:
    factors, angle, by_rad = np.array([[0.3, -0.4], [0.1, 0.2]]), np.array([0.0, 1.0, 5.0]), np.array([0.7, -2.0])
    turned = turned_harmonic(factors, by_rad)
    wave = factors @ np.stack([np.cos(angle), np.sin(angle)])
    for k in range(2):
        there = angle + by_rad[k]
        assert wave[k] == pytest.approx(turned[k] @ np.stack([np.cos(there), np.sin(there)]), abs=COORDINATE_ATOL)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_padded_circle_runs_on(axis: int) -> None:
    samples = np.arange(12).reshape(3, 4)
    expected = np.take(samples, np.arange(-7, samples.shape[axis] + 7) % samples.shape[axis], axis=axis)
    np.testing.assert_array_equal(pad_circle(samples, 7, axis=axis), expected)


@pytest.mark.parametrize(("n", "at_most", "divisor"), [(12, 5, 4), (12, 0, 1), (7, 6, 1), (6, 6, 6)])
def test_the_largest_divisor(n: int, at_most: int, divisor: int) -> None:
    assert largest_divisor(n, at_most) == divisor
