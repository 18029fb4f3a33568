"""How the simulated catheter turns."""

import numpy as np
import pytest

from endoct.synthetic.oct.uneven_rotation import STICK_ORDERS, rotation_error

TURN = np.linspace(0, 2 * np.pi, 4000, endpoint=False)


def _error_rad(stick_slip: float, seed: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    harmonics = np.array(rotation_error(np.random.default_rng(seed), 12, 0.087, stick_slip))
    orders = np.arange(1, harmonics.shape[1] + 1)
    waves = np.stack([np.cos(np.outer(orders, TURN)), np.sin(np.outer(orders, TURN))], axis=1)
    return np.asarray(np.einsum("nkc,kct->nt", harmonics, waves))


@pytest.mark.parametrize("stick_slip", [0.0, 0.4, 1.0])
def test_the_peak_is_what_was_asked_for_and_the_catheter_never_turns_back(stick_slip: float) -> None:
    for seed in range(4):
        error = _error_rad(stick_slip, seed)
        assert np.abs(error).max() == pytest.approx(0.087, rel=0.02)
        assert np.all(np.diff(TURN + error, axis=1) > 0)


def test_it_falls_behind_slowly_and_catches_up_fast() -> None:
    speed = np.gradient(_error_rad(1.0, 1), TURN, axis=1)
    assert speed.max() > 2 * -speed.min()
    assert np.mean(speed < 0) > 2 * np.mean(speed > -speed.min())


def test_without_it_four_harmonics_are_left() -> None:
    harmonics = np.array(rotation_error(np.random.default_rng(1), 5, 0.05, 0.0))
    assert harmonics.shape == (5, STICK_ORDERS, 2)
    assert not harmonics[:, 4:].any()
