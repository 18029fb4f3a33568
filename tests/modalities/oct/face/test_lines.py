"""Circles through points on bright lines."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from endoct.modalities.oct.face.face_circle import Circle, circle_distance_mm
from endoct.modalities.oct.face.lines import _Crossings, _support, fit_circle
from endoct.modalities.oct.face.points import Points

TURN = 2 * np.pi * np.arange(256) / 256


@given(e=st.floats(0, 0.4), beta=st.floats(0, 6.28))
def test_the_circle_is_found_exactly_from_exact_points(e: float, beta: float) -> None:
    x, y = e * np.cos(beta), e * np.sin(beta)
    depth = 0.3 + circle_distance_mm(TURN, x, y, 0.85)
    points = Points(TURN, depth, np.ones(TURN.size))
    circle = fit_circle(points, Circle(x + 0.005, y - 0.004, 0.303, 0.85), width_mm=0.05)
    np.testing.assert_allclose([circle.x_mm, circle.y_mm, circle.axis_depth_mm], [x, y, 0.3], atol=1e-5)


def test_a_circle_is_supported_by_what_lies_up_to_two_rows_from_it() -> None:
    """Of ten columns, every third of a B-scan, each has strength in one row alone; circles are shifted by rows."""
    columns, rows = 3 * np.arange(10), 5 + np.arange(10) % 4
    strength = np.zeros((30, 20), np.float32)
    strength[columns, rows] = 1 + np.arange(10)
    circles = np.stack([rows + shift for shift in range(-3, 4)]).astype(np.int32)
    circles[3, 4] = -1  # the circle that all of them lie on is seen by nine columns only
    expected = np.array([0, 55, 55, 50, 55, 55, 0]) / 10
    np.testing.assert_allclose(_support(strength, _Crossings(columns, circles)), expected, rtol=1e-6)
