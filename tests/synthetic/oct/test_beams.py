"""Beams of the OCT, against ray tracing by Snell's law and values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import COORDINATE_ATOL

from endoct.base.numeric.circle import wrap_rad
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.oct.beams import beam_angle_rad, capillary_axis_mm, refract, stream_position, trace
from endoct.synthetic.sample.parameters import LostAscans, Sample

N = 512  # A-scans a turn of preset learning
TURN = 2 * np.pi / N * np.arange(N)


@pytest.fixture(scope="module")
def sample() -> Sample:
    drawn = draw("learning", 3, ranges={"oct.scan": ("step",)})
    return drawn.model_copy(update={"oct": drawn.oct.model_copy(update={"lost_ascans": ()})})


@pytest.fixture(scope="module")
def wall(sample: Sample) -> Wall:
    return build_wall(sample)


def _with(sample: Sample, **oct_: object) -> Sample:
    return sample.model_copy(update={"oct": sample.oct.model_copy(update=oct_)})


def _onto_circle(at: NDArray[np.float64], way: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    b, c = at @ way, at @ at - radius**2
    return at + (-b + math.sqrt(b * b - c)) * way


def _bent(at: NDArray[np.float64], way: NDArray[np.float64], from_index: float, to_index: float) -> NDArray[np.float64]:
    """Snell's law in vectors, at a circle about the origin."""
    normal = -at / np.linalg.norm(at)
    ratio, cosine = from_index / to_index, -float(normal @ way)
    return ratio * way + (ratio * cosine - math.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal


@given(
    offset=st.floats(0.0, 0.4),
    gamma=st.floats(0, 6.3),
    outer=st.floats(0.75, 1.0),
    glass=st.floats(0.05, 0.2),
    index=st.floats(1.0, 1.6),
)
def test_glass_bends_beams_as_snell_says(offset: float, gamma: float, outer: float, glass: float, index: float) -> None:
    found = refract(offset, np.array([gamma]), outer - glass, outer, index)
    start, way = np.array([offset, 0.0]), np.array([math.cos(gamma), math.sin(gamma)])
    first = _onto_circle(start, way, outer - glass)
    within = _bent(first, way, 1, index)
    second = _onto_circle(first, within, outer)
    onward = _bent(second, within, index, 1)
    assert found.inner_mm[0] == pytest.approx(np.linalg.norm(first - start), abs=COORDINATE_ATOL)
    assert found.glass_mm[0] == pytest.approx(np.linalg.norm(second - first), abs=COORDINATE_ATOL)
    for angle, vector in ((found.exit_rad[0], second), (found.onward_rad[0], onward)):
        assert wrap_rad(angle - math.atan2(vector[1], vector[0])) == pytest.approx(0, abs=1e-8)
    # the angle to the normal, of which a cosine near 1 says little
    assert math.sin(found.outer_rad[0]) == pytest.approx(offset * math.sin(gamma) / outer, abs=COORDINATE_ATOL)


def test_glass_of_index_one_bends_nothing() -> None:
    found = refract(0.3, TURN, 0.7, 0.9, 1.0)
    np.testing.assert_allclose(found.onward_rad, TURN, atol=COORDINATE_ATOL)


def test_beams_of_an_offset_catheter_by_hand() -> None:
    found = refract(0.2, np.array([0.0, np.pi / 2]), 0.65, 0.85, 1.46)
    np.testing.assert_allclose(found.inner_mm, [0.45, math.sqrt(0.65**2 - 0.2**2)])
    assert found.glass_mm[0] == pytest.approx(0.2)
    assert found.onward_rad[0] == pytest.approx(0)


def test_lost_ascans_let_the_angle_jump(sample: Sample) -> None:
    lost = (LostAscans(slice_index=2, ascan=100, count=5), LostAscans(slice_index=2, ascan=300, count=2))
    position = stream_position(_with(sample, lost_ascans=lost).oct, 2, N)
    np.testing.assert_array_equal(position[[0, 99, 100, 299, 300, N - 1]], [0, 99, 105, 304, 307, N + 6])
    np.testing.assert_array_equal(stream_position(_with(sample, lost_ascans=lost).oct, 1, N), np.arange(N))


def test_angles_follow_their_formula(sample: Sample) -> None:
    oct_ = sample.oct.model_copy(
        update={
            "sense": -1,
            "theta_origin_rad": 1.0,
            "start_angle_rad": (0.25,) * 16,
            "rotation_error_rad": (((0.01, 0.0), (0.0, 0.02)),) * 16,
        }
    )
    turn = np.array([0.0, np.pi / 4])
    expected = [1 - 0.25 - 0.01, 1 - np.pi / 4 - 0.25 - 0.01 * math.sqrt(0.5) - 0.02]
    np.testing.assert_allclose(beam_angle_rad(oct_, 5, turn), expected)


def test_a_long_turn_goes_beyond_the_circle_and_a_helical_one_along_z(sample: Sample, wall: Wall) -> None:
    odd = _with(
        sample,
        turn_length=(1.02,) * 16,
        rotation_error_rad=(((0.0, 0.0),),) * 16,
        start_angle_rad=(0.0,) * 16,
        z_advance_mm=-0.2,
    )
    echoes = trace(odd, wall.scene, 4, np.arange(N + 1.0))
    swept = echoes.alpha_rad[-1] - echoes.alpha_rad[0]
    assert swept == pytest.approx(odd.oct.sense * 1.02 * 2 * np.pi)
    assert echoes.wall_z_mm[0] == odd.oct.z_mm[4]
    np.testing.assert_allclose(echoes.wall_z_mm[-1] - echoes.wall_z_mm[0], -0.2 * 1.02)


def test_the_capillary_leans_against_the_bore(sample: Sample) -> None:
    bore = sample.bore.model_copy(update={"tilt_rad": 0.01, "tilt_direction_rad": np.pi / 2})
    x, y = capillary_axis_mm(bore, np.array([0.0, bore.length_mm / 2, bore.length_mm]))
    np.testing.assert_allclose(x, 0, atol=COORDINATE_ATOL)
    np.testing.assert_allclose(y, np.tan(0.01) * bore.length_mm / 2 * np.array([1, 0, -1]), atol=COORDINATE_ATOL)


def test_the_wall_is_met_where_it_is(sample: Sample, wall: Wall) -> None:
    echoes = trace(sample, wall.scene, 0, np.arange(float(N)))
    square = echoes.wall_cosine > 0.9  # on the steep side of a cell the map's grid is too coarse
    relief = wall.at(wall.relief_mm, echoes.wall_z_mm, echoes.wall_theta_rad)
    miss = np.abs(echoes.wall_radius_mm - wall.radius_mm - relief)[square]
    assert square.mean() > 0.5
    assert np.median(miss) < 0.001
    # and at the path that leads there
    axis = np.stack(capillary_axis_mm(sample.bore, echoes.wall_z_mm), axis=1)
    e, beta = sample.oct.offset_mm[0], sample.oct.offset_direction_rad[0]
    outer = sample.oct.capillary_outer_diameter_mm / 2
    glass = refract(e, echoes.alpha_rad - beta, outer - sample.oct.glass_mm, outer, sample.oct.glass_index)
    leaves = axis + outer * np.stack([np.cos(beta + glass.exit_rad), np.sin(beta + glass.exit_rad)], axis=1)
    ends = echoes.wall_radius_mm[:, None] * np.stack(
        [np.cos(echoes.wall_theta_rad), np.sin(echoes.wall_theta_rad)], axis=1
    )
    dry = np.isfinite(echoes.wall_path_mm) & ~np.isfinite(echoes.fluid_path_mm)
    beyond = np.linalg.norm(ends - leaves, axis=1)[dry]
    np.testing.assert_allclose(beyond, (echoes.wall_path_mm - echoes.outer_path_mm)[dry], atol=1e-6)


def test_the_angle_on_the_wall_differs_from_the_beams(sample: Sample, wall: Wall) -> None:
    apart = np.abs(wrap_rad(trace(sample, wall.scene, 0, np.arange(float(N))).wall_theta_rad - _alpha(sample)))
    # refraction takes a little off asin(e/R)
    assert 0.7 < apart.max() / math.asin(sample.oct.offset_mm[0] / wall.radius_mm) < 1.1


def _alpha(sample: Sample) -> NDArray[np.float64]:
    return beam_angle_rad(sample.oct, 0, TURN * sample.oct.turn_length[0])
