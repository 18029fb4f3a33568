"""Grooves drawn into the darkness of two frames: where they are found, and where they are not believed."""

import numpy as np
import pytest
from printed_tube import TUBE

from endoct.modalities.endoscope.tube_marks import AXIAL, HELICAL, N_ANGLES, N_CIRCLES, Darkness, Marks, find_marks

STEP_RAD = 2 * np.pi / N_ANGLES
TURN_RAD = np.array([0.4, 0.5])
BORE_MM = np.stack([np.linspace(1, 6, N_CIRCLES), np.linspace(3, 8, N_CIRCLES)])


def marks(*, sense: int = 1, width: float = 1.0, dark: float = 0.8, hidden: bool = False) -> Marks:
    """Find grooves of ``width`` times the stated one, ``dark`` against the wall, drawn where the tube has them."""
    theta = TURN_RAD[:, None, None] + sense * STEP_RAD * np.arange(N_ANGLES)
    image = np.full((2, N_CIRCLES, N_ANGLES), 0.1, np.float32)
    for middle, wide_mm in ((0.0, TUBE.groove_width_mm), (TUBE.helix_rad(BORE_MM)[..., None], TUBE.helix_width_mm)):
        away = np.abs(np.angle(np.exp(1j * (theta - middle)))) - width * wide_mm / 2 / TUBE.radius_mm
        image += np.float32(dark) * np.clip(0.65 - away / (2 * STEP_RAD), 0, 1).astype(np.float32)  # 0.35 at the edge
    if hidden:
        image[1] = np.nan
    darkness = Darkness(image, np.linspace(50, 150, N_CIRCLES), np.zeros((N_CIRCLES, N_ANGLES), np.float32))
    return find_marks(darkness, BORE_MM, BORE_MM, TURN_RAD, sense, TUBE)


@pytest.mark.parametrize("sense", [1, -1])
def test_middles_of_grooves_lie_where_the_tube_has_them(sense: int) -> None:
    of = marks(sense=sense)
    circle = np.searchsorted(np.linspace(50, 150, N_CIRCLES), of.r_px - 1e-6)
    np.testing.assert_allclose(of.z_mm, BORE_MM[of.frame, circle])
    middle = np.where(of.line == AXIAL, 0.0, TUBE.helix_rad(of.z_mm))
    off = np.angle(np.exp(1j * (TURN_RAD[of.frame] + sense * of.angle_rad - middle)))
    assert np.abs(off).max() < 0.3 * STEP_RAD
    np.testing.assert_array_equal(of.in_ring, TUBE.ring_inside_mm(of.z_mm) > 0)
    assert np.abs(TUBE.ring_inside_mm(of.z_mm)).min() > 0.1  # at a ring's edge a groove is as deep on one side alone
    apart_mm = TUBE.radius_mm * np.abs(np.angle(np.exp(1j * TUBE.helix_rad(of.z_mm))))
    assert apart_mm.min() >= (TUBE.groove_width_mm + TUBE.helix_width_mm) / 2 + 0.2
    for line in (AXIAL, HELICAL):
        assert np.count_nonzero(of.line == line) > N_CIRCLES


@pytest.mark.parametrize(("width", "believed"), [(0.65, False), (0.8, True), (1.2, True), (1.45, False)])
def test_a_groove_is_about_as_wide_as_it_was_printed(width: float, believed: bool) -> None:
    assert (marks(width=width).r_px.size > N_CIRCLES) == believed
    assert believed or marks(width=width).r_px.size == 0


def test_what_is_not_clear_is_no_groove() -> None:
    assert marks(dark=0.1).r_px.size == 0
    assert np.unique(marks(hidden=True).frame).tolist() == [0]
