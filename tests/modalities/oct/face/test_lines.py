"""Circles through points on bright lines."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from endoct.modalities.oct.face.face_circle import Circle, circle_distance_mm
from endoct.modalities.oct.face.lines import fit_circle
from endoct.modalities.oct.face.points import Points

TURN = 2 * np.pi * np.arange(256) / 256


@given(e=st.floats(0, 0.4), beta=st.floats(0, 6.28))
def test_the_circle_is_found_exactly_from_exact_points(e: float, beta: float) -> None:
    x, y = e * np.cos(beta), e * np.sin(beta)
    depth = 0.3 + circle_distance_mm(TURN, x, y, 0.85)
    points = Points(TURN, depth, np.ones(TURN.size))
    circle = fit_circle(points, Circle(x + 0.005, y - 0.004, 0.303, 0.85), width_mm=0.05)
    np.testing.assert_allclose([circle.x_mm, circle.y_mm, circle.axis_depth_mm], [x, y, 0.3], atol=1e-5)
