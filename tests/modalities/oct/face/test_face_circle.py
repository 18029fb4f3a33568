"""The circle that a catheter off the axis sees."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL

from endoct.modalities.oct.face.face_circle import circle_distance_mm

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
