"""Harmonics of angles."""

import numpy as np
from tolerances import COORDINATE_ATOL

from endoct.base.numeric.least_squares import harmonics


def test_harmonics_come_as_cosine_and_sine_of_each_order() -> None:
    angle = np.array([0.0, 0.3, 4.0, -2.0, 40.0])
    columns = [wave(order * angle) for order in (2, 5) for wave in (np.cos, np.sin)]
    np.testing.assert_allclose(harmonics(angle, (2, 5)), np.stack(columns, axis=1), rtol=0, atol=COORDINATE_ATOL)
    assert harmonics([], (2, 5)).shape == (0, 4)


def test_order_nought_is_one() -> None:
    np.testing.assert_array_equal(harmonics([0.3, 4.0], (0,)), [[1, 0], [1, 0]])
