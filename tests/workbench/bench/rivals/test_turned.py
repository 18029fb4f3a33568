"""A-scans put where they belong before a pullback is unrolled."""

import numpy as np

from endoct.workbench.bench.rivals.turned import nearest_ascans, nominal_rad


def test_ascans_that_are_all_off_by_some_steps_are_taken_from_so_many_before() -> None:
    off = np.full(64, 3 * 2 * np.pi / 64)
    np.testing.assert_array_equal(nearest_ascans(off), (np.arange(64) - 3) % 64)


def test_where_a_turn_is_slow_some_of_its_ascans_are_left_out() -> None:
    n = 400
    error = 0.2 * np.sin(nominal_rad(n))  # it is fast at the start, and slow halfway
    taken = nearest_ascans(error)
    beam = np.mod(nominal_rad(n) + error, 2 * np.pi)[taken]
    apart = np.angle(np.exp(1j * (beam - nominal_rad(n))))
    assert np.abs(apart).max() < 1.3 * np.pi / n
    assert np.unique(taken).size < n


def test_of_a_turn_that_is_too_long_each_direction_is_shown_once() -> None:
    n = 100
    error = 0.1 * (nominal_rad(n) - np.pi)
    beam = nominal_rad(n) + error
    apart = np.angle(np.exp(1j * (beam[nearest_ascans(error)] - nominal_rad(n))))
    assert np.abs(apart).max() < 1.2 * np.pi / n
