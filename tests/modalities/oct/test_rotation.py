"""How the catheter turned: found from lines drawn here by formula, and taken out of the angles."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import FREE_START_RAD, START_RAD, TURN_RAD

from endoct.modalities.oct.face.capillary import Faces
from endoct.modalities.oct.face.lines import Points
from endoct.modalities.oct.face.sine import Sine
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.fixed_lines import points_off
from endoct.modalities.oct.turning.rotation import Rotation, even_rotation
from endoct.modalities.oct.turning.start_angle import measure_starts
from endoct.modalities.oct.turning.uneven_turn import measure_turns, turned
from endoct.stitching.circle import wrap_rad

RADIUS_MM = 0.85
AXIS_MM = 0.3
SHEATHS_MM = ((-0.4, 0.02, 0.7), (-0.3, 0.022, 2.9), (-0.2, 0.018, 5.0))  # depth of the axis, wobble, its direction
N_COLUMNS = 256
NOMINAL = 2 * np.pi * (np.arange(N_COLUMNS) + 0.5) / N_COLUMNS
Array = NDArray[np.float64]


def depth_of_circle(alpha: Array, x: float, y: float) -> Array:
    """Where beams from (x, y) meet a circle about 0, by the quadratic's formula."""
    along = x * np.cos(alpha) + y * np.sin(alpha)
    return np.asarray(-along + np.sqrt(along**2 - (x * x + y * y - RADIUS_MM**2)))


def evidence(error: Array, start: float, offset: complex, seed: int, *, sheaths: int = 3) -> SliceEvidence:
    """A slice whose beams look to NOMINAL + error in its frame, which begins at ``start``; a µm of noise."""
    rng = np.random.default_rng(seed)
    alpha, seen = NOMINAL + error, offset * np.exp(-1j * start)
    depths, lines = [AXIS_MM + depth_of_circle(alpha, seen.real, seen.imag)], [[seen.real, seen.imag, AXIS_MM, 1.0]]
    for depth, wobble, direction in SHEATHS_MM[:sheaths]:
        mark = wobble * np.exp(1j * (direction - start))
        depths.append(depth + depth_of_circle(alpha, mark.real, mark.imag))
        lines.append([mark.real, mark.imag, depth, 1.0])
    every = np.concatenate(depths) + 0.001 * rng.normal(size=N_COLUMNS * len(depths))
    points = Points(np.tile(NOMINAL, len(depths)), every, np.ones(every.size))
    return SliceEvidence(points, N_COLUMNS, np.array(lines), np.zeros((4, 600), np.float32), NOMINAL[::64])


def faces_of(slices: list[SliceEvidence]) -> Faces:
    """The faces as a first fit, with even turns, would have them: near enough."""
    n = len(slices)
    first = np.array([one.lines[0] for one in slices])
    return Faces(
        first[:, 0], first[:, 1], first[:, 2], np.ones(n), np.zeros(n), np.zeros(n, bool),
        (Sine(0.1, 1.0, 0.0, 1.0),) * n, np.zeros((n, 10)),
    )  # fmt: skip


def smooth(rng: np.random.Generator, peak_rad: float) -> Array:
    """An uneven turn: two harmonics."""
    c = rng.normal(size=4)
    error = (
        c[0] * np.cos(NOMINAL)
        + c[1] * np.sin(NOMINAL)
        + 0.5 * (c[2] * np.cos(2 * NOMINAL) + c[3] * np.sin(2 * NOMINAL))
    )
    return np.asarray(error * peak_rad / np.abs(error).max())


rotations = st.builds(
    lambda stretch, factors, lost: replace(
        even_rotation(1),
        stretch=np.array([stretch]),
        smooth_rad=np.array([factors]) * np.repeat(1 / np.arange(1, 5), 2),
        lost_at_rad=np.array([2.0 if lost else np.nan]),
        lost_rad=np.array([lost]),
    ),
    st.floats(-0.04, 0.04),
    st.lists(st.floats(-0.06, 0.06), min_size=8, max_size=8),
    st.sampled_from([0.0, 0.03, 0.1]),
)


@settings(max_examples=60, deadline=None)
@given(rotations)
def test_every_ascan_is_found_again_where_it_looked(rotation: Rotation) -> None:
    nominal = 2 * np.pi * np.arange(500) / 500
    beam = rotation.beam_rad(0, nominal)
    found, seen = rotation.nominal_rad(0, np.mod(beam, 2 * np.pi), 500)
    assert seen.all()
    # a direction may be seen twice; what is found looks there all the same
    again = np.abs(wrap_rad(rotation.beam_rad(0, found) - beam))
    away_from_gap = np.abs(nominal - rotation.lost_at_rad[0]) > 0.03 if rotation.lost_rad[0] else np.ones(500, bool)
    assert again[away_from_gap].max() < 2e-4
    assert found.min() >= -np.pi / 500 - 1e-12
    assert found.max() <= 2 * np.pi - np.pi / 500 + 1e-12


@pytest.mark.parametrize(("stretch", "lost"), [(-0.03, 0.0), (0.0, 0.1), (-0.02, 0.08)])
def test_what_no_ascan_looked_at_is_not_seen(stretch: float, lost: float) -> None:
    """A turn short by 3 % leaves 3 % of directions out, a lost block its own angle; less one A-scan's width each."""
    rotation = replace(
        even_rotation(1),
        stretch=np.array([stretch - lost / (2 * np.pi)]),
        lost_at_rad=np.array([2.0 if lost else np.nan]),
        lost_rad=np.array([lost]),
    )
    _, seen = rotation.nominal_rad(0, 2 * np.pi * np.arange(4000) / 4000, 500)
    n_gaps = (stretch < 0) + (lost > 0)
    assert np.mean(~seen) == pytest.approx(-stretch + lost / (2 * np.pi), abs=0.0025 * n_gaps)


def test_an_uneven_turn_is_told_by_the_capillary() -> None:
    rng = np.random.default_rng(1)
    common = smooth(rng, 0.1)
    errors = [common + smooth(rng, 0.02) + 0.02 * rng.normal() * (NOMINAL - np.pi) for _ in range(10)]
    slices = [evidence(error, 0.0, 0.25 * np.exp(0.05j * i), i) for i, error in enumerate(errors)]
    rotation, faces = measure_turns(slices, faces_of(slices), RADIUS_MM, 0.0, OctParameters())
    assert rotation.shape_known.all()
    assert not np.isfinite(rotation.lost_at_rad).any()
    for i, error in enumerate(errors):
        left = error - rotation.error_rad(i, NOMINAL)
        left -= left.mean()
        assert np.sqrt(np.mean(left**2)) < TURN_RAD
        assert np.sqrt(np.mean(left**2)) < 3 * rotation.shape_sigma_rad[i]
    assert np.abs(np.hypot(faces.x_mm, faces.y_mm) - 0.25).max() < 0.002


def test_on_the_axis_nothing_tells_an_uneven_turn_and_nothing_is_changed() -> None:
    error = smooth(np.random.default_rng(2), 0.1)
    slices = [evidence(error, 0.0, 0.002 + 0j, i) for i in range(8)]
    rotation, _ = measure_turns(slices, faces_of(slices), RADIUS_MM, 0.0, OctParameters())
    assert not rotation.shape_known.any()
    assert not rotation.peak_rad().any()
    assert np.isnan(rotation.shape_sigma_rad).all()


@pytest.mark.parametrize("step", ["rotation", "turn_length"])
def test_each_step_can_be_switched_off(step: str) -> None:
    error = smooth(np.random.default_rng(3), 0.05) + 0.01 * (NOMINAL - np.pi)
    slices = [evidence(error, 0.0, 0.25 + 0j, i) for i in range(6)]
    parameters = OctParameters(**{f"correct_{step}": False})
    rotation, _ = measure_turns(slices, faces_of(slices), RADIUS_MM, 0.0, parameters)
    off, on = (rotation.smooth_rad, rotation.stretch) if step == "rotation" else (rotation.stretch, rotation.smooth_rad)
    assert np.abs(off).max() < 1e-6
    assert np.abs(on).max() > 0.003


def test_a_lost_block_is_found_and_only_there() -> None:
    rng = np.random.default_rng(4)
    errors = [smooth(rng, 0.03) for _ in range(8)]
    errors[3] = errors[3] + 0.06 * (NOMINAL >= 2.5)
    slices = [evidence(error, 0.0, 0.25 * np.exp(0.5j), i) for i, error in enumerate(errors)]
    rotation, _ = measure_turns(slices, faces_of(slices), RADIUS_MM, 0.0, OctParameters())
    assert np.flatnonzero(np.isfinite(rotation.lost_at_rad)).tolist() == [3]
    assert rotation.lost_at_rad[3] == pytest.approx(2.5, abs=0.08)
    assert rotation.lost_rad[3] == pytest.approx(0.06, abs=0.01)


def found_starts(starts: Array, offset: Array, sheaths: int) -> tuple[Rotation, str]:
    """Starts found in even turns that begin at ``starts``."""
    slices = [
        evidence(np.zeros(N_COLUMNS), start, at, i, sheaths=sheaths)
        for i, (start, at) in enumerate(zip(starts, offset, strict=True))
    ]
    faces = faces_of(slices)
    rotation = even_rotation(len(slices))
    slices = [turned(one, rotation, i) for i, one in enumerate(slices)]
    return measure_starts(slices, faces, rotation, RADIUS_MM, 1.25, 0.005, OctParameters())


def test_free_starts_are_told_by_the_sheath_though_the_capillary_drifts() -> None:
    rng = np.random.default_rng(5)
    starts = rng.uniform(0, 2 * np.pi, 14)
    drifting = 0.2 * np.exp(1j * np.cumsum(0.1 * rng.normal(size=14)))
    rotation, note = found_starts(starts, drifting, 3)
    left = wrap_rad(rotation.start_rad - starts)
    assert rotation.start_known.all()
    assert np.abs(wrap_rad(left - left[0])).max() < FREE_START_RAD
    assert "sheath" in note
    # what creeps with the sheath cannot be known: the farther, the less sure
    assert rotation.start_sigma_rad[-1] > rotation.start_sigma_rad[1] > 0


def test_triggered_starts_scatter_less_than_before() -> None:
    rng = np.random.default_rng(6)
    starts = 0.03 * rng.normal(size=16)
    rotation, note = found_starts(starts, 0.2 * np.exp(0.1j * np.arange(16)), 3)
    left = starts - rotation.start_rad
    assert np.std(left) < START_RAD
    assert np.std(starts) > 3 * START_RAD
    assert abs(rotation.start_rad.mean()) < 1e-9
    assert not note


def test_starts_that_make_a_steady_capillary_jump_are_not_believed() -> None:
    starts = np.random.default_rng(7).uniform(-1, 1, 16)
    # the capillary is seen in one direction all along, sheath lines in any
    rotation, note = found_starts(starts, 0.2 * np.exp(1j * starts), 3)
    assert not rotation.start_rad.any()
    assert "not used" in note


def test_triggered_starts_are_left_alone_where_one_line_only_could_tell() -> None:
    rotation, _ = found_starts(0.03 * np.random.default_rng(7).normal(size=12), np.full(12, 0.2 + 0j), 1)
    assert not rotation.start_known.any()
    assert not rotation.start_rad.any()


def test_slices_that_start_anywhere_are_turned_back_by_capillary_and_cells(
    unrolled: Callable[..., tuple[Any, Any, Any]], make_phantom: Any
) -> None:
    """One sheath line alone is no mark; the way is from slice to slice, and the twist's uncertainty grows."""
    phantom = make_phantom(turning_rad=0.05)
    pages = phantom.log_counts()
    rolls = np.array([0, 250, 600, 90, 400, 510])
    _, _, straight = unrolled(phantom, pages)
    _, calibration, turned_back = unrolled(
        phantom, np.stack([np.roll(p, r, axis=1) for p, r in zip(pages, rolls, strict=True)])
    )
    assert straight.depth_mm is not None
    assert turned_back.depth_mm is not None
    start = turned_back.per_frame["start_angle_rad"].values
    assert np.abs(wrap_rad(start + 2 * np.pi * rolls / 720)).max() < 0.06
    assert np.all(np.diff(turned_back.per_frame["start_angle_sigma_rad"].values) > 0)
    assert any("uncertain" in note for note in calibration.notes)
    both, either = [
        op(straight.depth_mm > 0.1, turned_back.depth_mm > 0.1).sum() for op in (np.logical_and, np.logical_or)
    ]
    assert both / either > 0.85


def test_an_angle_common_to_all_slices_only_rolls_the_panorama(
    unrolled: Callable[..., tuple[Any, Any, Any]], make_phantom: Any
) -> None:
    phantom = make_phantom()
    pages = phantom.log_counts()
    _, _, straight = unrolled(phantom, pages)
    _, _, rolled = unrolled(phantom, np.roll(pages, 180, axis=2))
    shifted = np.roll(straight.depth_mm, 180, axis=1)
    assert np.mean(np.abs(shifted - rolled.depth_mm) > 0.03) < 0.02


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
        one = evidence(np.zeros(N_COLUMNS), 0.0, offset, i)
        lines = np.repeat([depth_mm, depth_mm + 0.03], N_COLUMNS)
        points = Points(angle, np.concatenate([one.points.depth_mm[:N_COLUMNS][seen], lines]), strength)
        slices.append(replace(one, points=points_off(fixed_line, points, pixel_mm)))
    rotation, _ = measure_turns(slices, faces_of(slices), RADIUS_MM, 0.0, OctParameters())
    assert max(np.abs(rotation.error_rad(i, NOMINAL)).max() for i in range(8)) < 0.05
