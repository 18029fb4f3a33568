"""Where one side lies in the other: there and back, and how errors go with it."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment, Bend, as_covariance

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


BACK = Bend((0.0, 2.0, 2.5, 6.0), (0.1, 0.1, -0.3, 0.0), (0.0, 0.1, 0.1, -0.2), (0.01, 0.01, 0.03, 0.03), (0.1,) * 4)


@ORIENTATIONS
def test_a_bend_moves_places_along_and_around_there_and_back(mirrored: bool, z_reversed: bool) -> None:
    rigid = alignment(mirrored, z_reversed)
    bent = replace(rigid, bend=BACK)
    assert bent.rigid == rigid
    z_rigid = np.array([-1.0, 0.0, 1.0, 4.25, 7.0])
    theta, z = np.linspace(0, 6.2, 5), rigid.z_to_b(z_rigid)
    assert bent.z_to_a(z) == pytest.approx(np.array([-0.9, 0.1, 1.1, 4.1, 7.0]))
    roll = [0.0, 0.0, 0.05, -0.05, -0.2]
    assert wrap_rad(bent.theta_to_a(theta, z) - rigid.theta_to_a(theta) - roll) == pytest.approx(0)
    assert bent.z_to_b(bent.z_to_a(z)) == pytest.approx(z)
    assert wrap_rad(bent.theta_to_b(bent.theta_to_a(theta, z), bent.z_to_a(z)) - theta) == pytest.approx(0)
    back, z_a = bent.inverse(), bent.z_to_a(z)
    assert back.z_to_a(z_a) == pytest.approx(z)
    assert wrap_rad(back.theta_to_a(theta, z_a) - bent.theta_to_b(theta, z_a)) == pytest.approx(0)
    again = back.inverse().bend
    assert again is not None
    for name in ("z_mm", "shift_mm", "roll_rad", "shift_error_mm", "roll_error_rad"):
        assert getattr(again, name) == pytest.approx(getattr(BACK, name))
    assert back.bend is not None
    assert back.bend.shift_error_mm[:: 1 - 2 * z_reversed] == pytest.approx(np.array(BACK.shift_error_mm) / 0.96)
    error = np.hypot(rigid.z_error_mm(z), [0.01, 0.01, 0.01, 0.03, 0.03])
    assert bent.z_error_mm(z) == pytest.approx(error)


def test_a_bent_alignment_turns_no_place_of_unknown_z() -> None:
    bent = Alignment(0.0, 0.0, bend=BACK)
    for ask in (bent.theta_to_a, bent.theta_to_b):
        with pytest.raises(EndoctError, match="z beside θ"):
            ask(0.3)
    assert float(bent.rigid.theta_to_a(0.3)) == pytest.approx(0.3)


@pytest.mark.parametrize(
    "other",
    [
        {"z_mm": (0.0, 2.0, 2.0, 6.0)},
        {"shift_mm": (0.1, 0.7, 0.1, 0.0)},  # it would show wall twice
        {"roll_rad": (0.0, 0.1)},
        {"roll_rad": (0.0, 0.1, np.nan, 0.0)},
        dict.fromkeys(("z_mm", "shift_mm", "roll_rad", "shift_error_mm", "roll_error_rad"), ()),
    ],
)
def test_what_is_no_bend(other: dict) -> None:
    with pytest.raises(EndoctError, match="bend of an alignment is none"):
        replace(BACK, **other)


def test_steps_are_jumps_of_a_bend_the_farthest_along_first() -> None:
    assert BACK.steps == ((pytest.approx(2.15), pytest.approx(-0.4), pytest.approx(0.0)),)
    z_mm, along_mm = (0.0, 1.0, 1.02, 3.0, 3.02, 5.0, 5.02), (0, 0, 0.02, 0.1, 0.4, 0.4, 0.5)
    two = Bend(z_mm, along_mm, (0, 0, 0.07, 0, 0, 0, 0), (0,) * 7, (0,) * 7)
    assert two.steps == (
        (pytest.approx(3.26), pytest.approx(0.3), 0.0),
        (pytest.approx(1.02), pytest.approx(0.02), pytest.approx(0.07)),
    )
    assert Bend((0.0, 2.0), (0.0, 0.9), (0.0, 0.9), (0, 0), (0, 0)).steps == ()
