"""The sine and the circle it approximates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL

from endoct.modalities.oct.face.lines import Points, fit_circle
from endoct.modalities.oct.face.sine import Sine, circle_distance_mm, ransac_sine

TURN = 2 * np.pi * np.arange(256) / 256


def test_distance_to_a_circle_along_its_diameter() -> None:
    # catheter 0.2 mm off towards angle 0: 0.8 mm ahead, 1.2 mm behind, and √(1 − 0.04) across
    distance = circle_distance_mm([0, np.pi, np.pi / 2], 0.2, 0.0, 1.0)
    np.testing.assert_allclose(distance, [0.8, 1.2, np.sqrt(0.96)], atol=COORDINATE_ATOL)


@given(e=st.floats(0, 0.5), beta=st.floats(0, 6.28))
def test_a_beam_ends_on_the_circle(e: float, beta: float) -> None:
    x, y = e * np.cos(beta), e * np.sin(beta)
    rho = circle_distance_mm(TURN, x, y, 0.85)
    np.testing.assert_allclose(np.hypot(x + rho * np.cos(TURN), y + rho * np.sin(TURN)), 0.85, atol=COORDINATE_ATOL)


def test_the_sine_is_found_among_outliers() -> None:
    rng = np.random.default_rng(3)
    true = Sine(0.2, 1.0, 2.5, 1.1)
    x = np.concatenate([TURN, rng.uniform(0, 2 * np.pi, 400)])
    y = np.concatenate([true(TURN) + rng.normal(0, 0.002, TURN.size), rng.uniform(0.5, 1.7, 400)])
    found, inliers = ransac_sine(x, y, tolerance_mm=0.01, trials=1500, rng=rng, start=Sine(0.0, 1.0, 0.0, 1.0))
    assert found.amplitude_mm == pytest.approx(0.2, abs=0.002)
    assert found.omega == pytest.approx(1.0, abs=0.01)
    assert found.phase_rad == pytest.approx(2.5, abs=0.03)
    assert found.offset_mm == pytest.approx(1.1, abs=0.002)
    assert inliers[: TURN.size].all()


def test_amplitude_is_positive_and_phase_within_a_turn() -> None:
    found, _ = ransac_sine(
        TURN, -0.1 * np.sin(TURN + 1.0), tolerance_mm=0.01, trials=50,
        rng=np.random.default_rng(0), start=Sine(0.0, 1.0, 0.0, 0.0),
    )  # fmt: skip
    assert found.amplitude_mm == pytest.approx(0.1, abs=1e-6)
    assert found.phase_rad == pytest.approx(1.0 + np.pi, abs=1e-6)


@given(e=st.floats(0, 0.4), beta=st.floats(0, 6.28))
def test_the_circle_is_found_exactly_from_exact_points(e: float, beta: float) -> None:
    x, y = e * np.cos(beta), e * np.sin(beta)
    depth = 0.3 + circle_distance_mm(TURN, x, y, 0.85)
    points = Points(TURN, depth, np.ones(TURN.size))
    start = np.array([x + 0.005, y - 0.004, 0.303])
    found = fit_circle(points, np.ones(TURN.size, bool), start, 0.85, width_mm=0.05)
    np.testing.assert_allclose(found, [x, y, 0.3], atol=1e-5)
