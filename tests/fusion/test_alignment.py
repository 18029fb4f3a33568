"""Where one side lies in the other: there and back, and how errors go with it."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment, as_covariance

COVARIANCE = np.array([[4e-4, 1e-5, 0.0], [1e-5, 9e-4, -1.2e-4], [0.0, -1.2e-4, 4e-5]])
ORIENTATIONS = pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)


def alignment(mirrored: bool, z_reversed: bool) -> Alignment:
    return Alignment(
        5.9, 1.7, 0.96, mirrored, z_reversed, covariance=as_covariance(COVARIANCE), twist_rad_per_mm=0.01
    )  # fmt: skip


@ORIENTATIONS
def test_places_go_there_and_back(mirrored: bool, z_reversed: bool) -> None:
    found = alignment(mirrored, z_reversed)
    theta, z = np.linspace(0, 6.2, 9), np.linspace(-1, 5, 9)
    sense, direction = 1 - 2 * mirrored, 1 - 2 * z_reversed
    assert wrap_rad(found.theta_to_a(theta) - 5.9 - sense * theta) == pytest.approx(0)
    assert found.z_to_a(z) == pytest.approx(1.7 + 0.96 * direction * z)
    assert wrap_rad(found.theta_to_b(found.theta_to_a(theta)) - theta) == pytest.approx(0)
    assert found.z_to_b(found.z_to_a(z)) == pytest.approx(z)
    for turned in (found.theta_to_a(theta), found.theta_to_b(theta)):
        assert ((turned >= 0) & (turned < 2 * np.pi)).all()
    back = found.inverse()
    assert wrap_rad(back.theta_to_a(theta) - found.theta_to_b(theta)) == pytest.approx(0)
    assert back.z_to_a(z) == pytest.approx(found.z_to_b(z))
    assert back.inverse().twist_rad_per_mm == pytest.approx(found.twist_rad_per_mm)
    assert (back.mirrored, back.z_reversed) == (mirrored, z_reversed)


@ORIENTATIONS
def test_errors_go_with_places(mirrored: bool, z_reversed: bool) -> None:
    """Against 20 000 alignments drawn with that covariance."""
    found = alignment(mirrored, z_reversed)
    drawn = np.random.default_rng(0).multivariate_normal([5.9, 1.7, 0.96], COVARIANCE, 20_000)
    direction, z = 1 - 2 * z_reversed, np.array([-1.0, 0.0, 4.0])
    scatter = (drawn[:, 1:2] + drawn[:, 2:] * direction * z).std(axis=0)
    assert found.z_error_mm(z) == pytest.approx(scatter, rel=0.03)
    backs = [replace(found, theta_shift_rad=t, z_shift_mm=s, z_scale=c).inverse() for t, s, c in drawn[:4000]]
    turns = wrap_rad(np.array([back.theta_shift_rad for back in backs]) - found.inverse().theta_shift_rad)
    scattered = np.cov([turns, [back.z_shift_mm for back in backs], [back.z_scale for back in backs]])
    stated = np.array(found.inverse().covariance)
    of_one = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(scattered / np.outer(of_one, of_one), stated / np.outer(of_one, of_one), atol=0.08)


def test_an_unknown_covariance_stays_unknown() -> None:
    unknown = Alignment(1.0, 2.0)
    assert unknown.inverse().covariance is None
    assert not unknown.z_error_mm([0.0, 3.0]).any()
