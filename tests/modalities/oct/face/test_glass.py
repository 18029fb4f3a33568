"""The capillary's glass."""

import numpy as np
import pytest
from tolerances import COORDINATE_ATOL

from endoct.modalities.oct.face.face_circle import circle_distance_mm
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass, face_distance

TURN = 2 * np.pi * np.arange(64) / 64
OUTER_MM, THICKNESS_MM = 0.8, 0.2


def test_the_bend_is_that_of_snell_at_both_faces() -> None:
    passing = 0.25 * np.sin(TURN)
    into = np.arcsin(passing / (OUTER_MM - THICKNESS_MM))
    within = np.arcsin(np.sin(into) / GLASS_INDEX)
    onto = np.arcsin((OUTER_MM - THICKNESS_MM) * np.sin(within) / OUTER_MM)
    out = np.arcsin(GLASS_INDEX * np.sin(onto))
    bend = Glass(OUTER_MM, THICKNESS_MM).bend_rad(passing)
    np.testing.assert_allclose(bend, (into - within) - (out - onto), atol=COORDINATE_ATOL)


def test_glass_of_unknown_thickness_does_not_bend() -> None:
    assert not Glass(OUTER_MM).bend_rad(0.25 * np.sin(TURN)).any()


def test_a_beam_along_the_radius_is_delayed_by_nothing_more_than_the_glass() -> None:
    def distances(x_mm: float) -> np.ndarray:
        beams = zip(np.cos(TURN), np.sin(TURN), strict=True)
        return np.array([face_distance(c, s, x_mm, 0.0, OUTER_MM, THICKNESS_MM) for c, s in beams])

    np.testing.assert_allclose(distances(0.0), OUTER_MM, atol=COORDINATE_ATOL)
    oblique = distances(0.2) - circle_distance_mm(TURN, 0.2, 0.0, OUTER_MM)
    assert oblique[[0, 32]] == pytest.approx(0, abs=COORDINATE_ATOL)
    assert np.abs(oblique).max() > 0.001
