"""The paper's sine."""

import numpy as np
import pytest

from endoct.base.numeric.sine import Sine, ransac_sine

TURN = 2 * np.pi * np.arange(256) / 256


def test_the_sine_is_found_among_outliers() -> None:
    rng = np.random.default_rng(3)
    true = Sine(0.2, 1.0, 2.5, 1.1)
    x = np.concatenate([TURN, rng.uniform(0, 2 * np.pi, 400)])
    y = np.concatenate([true(TURN) + rng.normal(0, 0.002, TURN.size), rng.uniform(0.5, 1.7, 400)])
    sine, inliers = ransac_sine(x, y, tolerance_mm=0.01, trials=1500, rng=rng, start=Sine(0.0, 1.0, 0.0, 1.0))
    assert sine.amplitude_mm == pytest.approx(0.2, abs=0.002)
    assert sine.omega == pytest.approx(1.0, abs=0.01)
    assert sine.phase_rad == pytest.approx(2.5, abs=0.03)
    assert sine.offset_mm == pytest.approx(1.1, abs=0.002)
    assert inliers[: TURN.size].all()


def test_amplitude_is_positive_and_phase_within_a_turn() -> None:
    sine, _ = ransac_sine(
        TURN, -0.1 * np.sin(TURN + 1.0), tolerance_mm=0.01, trials=50,
        rng=np.random.default_rng(0), start=Sine(0.0, 1.0, 0.0, 0.0),
    )  # fmt: skip
    assert sine.amplitude_mm == pytest.approx(0.1, abs=1e-6)
    assert sine.phase_rad == pytest.approx(1.0 + np.pi, abs=1e-6)
