"""Harmonics of angles, and small systems of equations."""

import numpy as np
import pytest
from tolerances import COORDINATE_ATOL

from endoct.base.numeric.least_squares import harmonics, solve


def test_harmonics_come_as_cosine_and_sine_of_each_order() -> None:
    angle = np.array([0.0, 0.3, 4.0, -2.0, 40.0])
    columns = [wave(order * angle) for order in (2, 5) for wave in (np.cos, np.sin)]
    np.testing.assert_allclose(harmonics(angle, (2, 5)), np.stack(columns, axis=1), rtol=0, atol=COORDINATE_ATOL)
    assert harmonics([], (2, 5)).shape == (0, 4)


def test_order_nought_is_one() -> None:
    np.testing.assert_array_equal(harmonics([0.3, 4.0], (0,)), [[1, 0], [1, 0]])


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_equations_are_solved_whatever_the_order_of_their_rows(n: int) -> None:
    rng = np.random.default_rng(n)
    matrix, solution = rng.normal(size=(n, n)), rng.normal(size=n)
    for rows in (np.arange(n), np.arange(n)[::-1], rng.permutation(n)):
        vector = (matrix @ solution)[rows]
        solve(matrix[rows].copy(), vector)
        np.testing.assert_allclose(vector, solution, rtol=1e-9)


def test_a_small_coefficient_is_no_pivot() -> None:
    """By hand: x = y = 1 to rounding, which 1e−20 as the first pivot would make x = 0; and 0 as one, nothing at all."""
    for tiny in (1e-20, 0.0):
        vector = np.array([1.0, 2.0])
        solve(np.array([[tiny, 1.0], [1.0, 1.0]]), vector)
        np.testing.assert_allclose(vector, [1, 1], rtol=1e-12)
