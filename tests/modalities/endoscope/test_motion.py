"""The bore's axis from the drift of ring centres, against rays traced one by one."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone
from endoct.modalities.endoscope.motion import BoreAxis, bore_axis, probe_offsets

RADIUS_MM, INNER_PX, OUTER_PX = 1.25, 60.0, 210.0
RIMS = Annulus(0, 0, INNER_PX, 0, 0, OUTER_PX)


def optics(half_angle_deg: float) -> ConeOptics:
    return ConeOptics(INNER_PX, OUTER_PX, float(np.deg2rad(half_angle_deg)), 430.0, 1.2, RADIUS_MM)


def place_on_wall(
    mirror: ConeOptics, r_px: np.ndarray, angle: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return z, from the apex, and θ about the bore's axis at ``off`` where rays at r, angle meet the wall."""
    a, d = mirror.half_angle_rad, mirror.mirror_distance_mm
    psi = np.arctan(r_px / mirror.focal_px)
    along = off[0] * np.cos(angle) + off[1] * np.sin(angle)
    rho = along + np.sqrt(along**2 - off @ off + RADIUS_MM**2)
    z = -d * np.cos(2 * a) + (rho + d * np.sin(2 * a)) / np.tan(2 * a - psi)
    return z, np.arctan2(rho * np.sin(angle) - off[1], rho * np.cos(angle) - off[0])


def centre(mirror: ConeOptics, r_px: float, off: np.ndarray) -> np.ndarray:
    """Return the centre of the circle of constant z near ``r_px``, fitted to where that z is seen."""
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    wanted = place_on_wall(mirror, np.array([r_px]), np.zeros(1), np.zeros(2))[0]

    def misfit(place: np.ndarray) -> np.ndarray:
        x, y = place[0] + r_px * np.cos(angle), place[1] + r_px * np.sin(angle)
        return place_on_wall(mirror, np.hypot(x, y), np.arctan2(y, x), off)[0] - wanted

    return np.asarray(least_squares(misfit, np.zeros(2)).x)


@pytest.mark.parametrize("half_angle_deg", [43.0, 45.0, 47.0])
def test_the_axis_is_found_and_tells_where_the_wall_is(half_angle_deg: float) -> None:
    mirror, off = optics(half_angle_deg), np.array([0.03, -0.02])
    inner, outer = (centre(mirror, r, off) for r in (INNER_PX, OUTER_PX))
    axis = bore_axis(tuple(inner - outer), RIMS, mirror, RADIUS_MM)
    assert axis is not None
    np.testing.assert_allclose([axis.x_mm, axis.y_mm], off, atol=1e-3)
    np.testing.assert_allclose(axis.shift_px, outer, atol=0.05)
    angle = np.linspace(0, 2 * np.pi, 32)
    cos, sin = axis.sway_rad(0.0, RADIUS_MM)
    theta = place_on_wall(mirror, np.full(32, 130.0), angle, off)[1]
    off_by = np.angle(np.exp(1j * (theta - angle - cos * np.cos(angle) - sin * np.sin(angle))))
    assert np.abs(off_by).max() < 1e-3


def test_an_assumed_cone_tells_most_of_it() -> None:
    mirror, off = optics(46.0), np.array([0.03, -0.02])
    inner, outer = (centre(mirror, r, off) for r in (INNER_PX, OUTER_PX))
    assumed = assumed_cone(INNER_PX, OUTER_PX, mirror.visible_length_mm, RADIUS_MM)
    axis = bore_axis(tuple(inner - outer), RIMS, assumed, RADIUS_MM)
    assert axis is not None
    assert np.hypot(axis.x_mm - off[0], axis.y_mm - off[1]) < 0.25 * np.hypot(*off)


def test_a_drift_beyond_reason_tells_nothing() -> None:
    assert bore_axis((40.0, 0.0), RIMS, optics(45.0), RADIUS_MM) is None


def test_sway_and_the_probes_place_turn_with_the_roll() -> None:
    """By what θ about the bore's axis differs from θ about the probe's, in directions of the wall."""
    off, roll = np.array([0.02, -0.035]), 0.8
    axis = BoreAxis(*off, (0.0, 0.0))
    cos, sin = axis.sway_rad(roll, RADIUS_MM)
    along = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    turned = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]) @ off
    true = np.arctan2(
        RADIUS_MM * np.sin(along) - turned[1], RADIUS_MM * np.cos(along) - turned[0]
    )  # θ about the axis of what lies at ``along`` about the probe, to first order
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (true - along))), cos * np.cos(along) + sin * np.sin(along), atol=2e-3
    )
    places = probe_offsets(axis, np.array([[cos, sin], [0.0, 0.01]]), RADIUS_MM)
    np.testing.assert_allclose([places["probe_offset_x_mm"][0], places["probe_offset_y_mm"][0]], -turned, atol=1e-12)
    assert places["probe_offset_x_mm"][1] == pytest.approx(-0.01 * RADIUS_MM)
    assert np.isnan(probe_offsets(None, np.zeros((2, 2)), RADIUS_MM)["probe_offset_x_mm"]).all()
