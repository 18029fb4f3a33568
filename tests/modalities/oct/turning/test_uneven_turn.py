"""Uneven turns, measured from lines drawn by formula."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import TURN_RAD

from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.uneven_turn import measure_turns
from tests.modalities.oct.turning.drawn_slices import (
    AXIS_MM,
    N_COLUMNS,
    NOMINAL,
    RADIUS_MM,
    Array,
    depth_of_circle,
    drawn_slice,
    faces_of,
)


def smooth(rng: np.random.Generator, peak_rad: float) -> Array:
    """An uneven turn: two harmonics."""
    c = rng.normal(size=4)
    error = (
        c[0] * np.cos(NOMINAL)
        + c[1] * np.sin(NOMINAL)
        + 0.5 * (c[2] * np.cos(2 * NOMINAL) + c[3] * np.sin(2 * NOMINAL))
    )
    return np.asarray(error * peak_rad / np.abs(error).max())


def test_the_capillary_shows_an_uneven_turn() -> None:
    rng = np.random.default_rng(1)
    common = smooth(rng, 0.1)
    errors = [common + smooth(rng, 0.02) + 0.02 * rng.normal() * (NOMINAL - np.pi) for _ in range(10)]
    slices = [drawn_slice(error, 0.0, 0.25 * np.exp(0.05j * i), i) for i, error in enumerate(errors)]
    rotation, faces = measure_turns(slices, faces_of(slices), Glass(RADIUS_MM), OctParameters())
    assert rotation.shape_known.all()
    assert not np.isfinite(rotation.lost_at_rad).any()
    shares = []
    for i, error in enumerate(errors):
        left = error - rotation.error_rad(i, NOMINAL)
        left -= left.mean()
        assert np.sqrt(np.mean(left**2)) < TURN_RAD
        shares.append(np.sqrt(np.mean(left**2)) / rotation.shape_sigma_rad[i])
    assert max(shares) < 3
    assert np.sqrt(np.mean(np.square(shares))) > 0.3, "nor are errors overstated: it is 0.46"
    assert np.abs(faces.capillary.offset_mm - 0.25).max() < 0.002


def test_on_the_axis_an_uneven_turn_is_not_known_and_nothing_is_changed() -> None:
    error = smooth(np.random.default_rng(2), 0.1)
    slices = [drawn_slice(error, 0.0, 0.002 + 0j, i) for i in range(8)]
    rotation, _ = measure_turns(slices, faces_of(slices), Glass(RADIUS_MM), OctParameters())
    assert not rotation.shape_known.any()
    assert not rotation.peak_rad().any()
    assert np.isnan(rotation.shape_sigma_rad).all()


@pytest.mark.parametrize("step", ["rotation", "turn_length"])
def test_each_step_can_be_switched_off(step: str) -> None:
    error = smooth(np.random.default_rng(3), 0.05) + 0.01 * (NOMINAL - np.pi)
    slices = [drawn_slice(error, 0.0, 0.25 + 0j, i) for i in range(6)]
    parameters = OctParameters.model_validate({f"correct_{step}": False})
    rotation, _ = measure_turns(slices, faces_of(slices), Glass(RADIUS_MM), parameters)
    off, on = (rotation.smooth_rad, rotation.stretch) if step == "rotation" else (rotation.stretch, rotation.smooth_rad)
    assert np.abs(off).max() < 1e-6
    assert np.abs(on).max() > 0.003


def test_a_lost_block_is_found_and_only_there() -> None:
    rng = np.random.default_rng(4)
    errors = [smooth(rng, 0.03) for _ in range(8)]
    errors[3] = errors[3] + 0.06 * (NOMINAL >= 2.5)
    slices = [drawn_slice(error, 0.0, 0.25 * np.exp(0.5j), i) for i, error in enumerate(errors)]
    rotation, _ = measure_turns(slices, faces_of(slices), Glass(RADIUS_MM), OctParameters())
    assert np.flatnonzero(np.isfinite(rotation.lost_at_rad)).tolist() == [3]
    assert rotation.lost_at_rad[3] == pytest.approx(2.5, abs=0.08)
    assert rotation.lost_rad[3] == pytest.approx(0.06, abs=0.01)


def test_a_line_of_the_detector_that_the_face_crosses_is_no_uneven_turn() -> None:
    """Where the face is not seen, two lines at one depth, with them a turn came out uneven by 0.38 rad."""
    offset, pixel_mm, depth_mm = 0.25 * np.exp(1.2j), 0.005, 1.115
    fixed_line = np.zeros(400, bool)
    fixed_line[222:231] = True
    face = AXIS_MM + depth_of_circle(NOMINAL, offset.real, offset.imag)
    seen = (np.abs(face - depth_mm) > 0.02) & (NOMINAL > 1.1)
    angle, strength = np.concatenate([NOMINAL[seen], NOMINAL, NOMINAL]), np.ones(seen.sum() + 2 * N_COLUMNS)
    slices = []
    for i in range(8):
        one = drawn_slice(np.zeros(N_COLUMNS), 0.0, offset, i)
        lines = np.repeat([depth_mm, depth_mm + 0.03], N_COLUMNS)
        points = Points(angle, np.concatenate([one.points.depth_mm[:N_COLUMNS][seen], lines]), strength)
        slices.append(replace(one, points=points.outside_rows(fixed_line, pixel_mm)))
    rotation, _ = measure_turns(slices, faces_of(slices), Glass(RADIUS_MM), OctParameters())
    assert max(np.abs(rotation.error_rad(i, NOMINAL)).max() for i in range(8)) < 0.05
