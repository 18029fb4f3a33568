"""What truth records of the motion is found again in the pixels, by estimators that know neither renderer nor unroller.

Sizes are such that a slice, a sign or half a pixel between truth and recordings fails.
"""

import numpy as np
import pytest
from tolerances import (
    FOUND_FEED_MM,
    FOUND_OFFSET_MM,
    FOUND_PAINT_MM,
    FOUND_PAINT_RAD,
    FOUND_PLACE_MM,
    FOUND_RIM_PX,
    FOUND_ROLL_ON_WALL_RAD,
    FOUND_ROLL_RAD,
    FOUND_TURNING_RAD,
    FOUND_WALL_PX,
)

from benchmarks.physics.estimates import PAINTED, TURNING, Z_SHIFTS_MM, Frames, Slice, frames, slices, specimen
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.sample.parameters import Sample


@pytest.fixture(scope="module")
def rendered() -> tuple[Sample, Wall]:
    return specimen("learning", 1001, TURNING)


@pytest.fixture(scope="module")
def found_slices(rendered: tuple[Sample, Wall]) -> list[Slice]:
    return slices(*rendered, indices=range(1, 16, 3))


@pytest.fixture(scope="module")
def found_frames(rendered: tuple[Sample, Wall]) -> Frames:
    return frames(*rendered, indices=range(12))


def test_offset_and_direction_of_the_catheter_from_the_capillarys_outer_face(found_slices: list[Slice]) -> None:
    for one in found_slices:
        assert abs(one.true_offset_mm) > 0.05
        assert abs(one.offset_mm - one.true_offset_mm) < FOUND_OFFSET_MM
        assert abs(one.deeper_mm) < FOUND_OFFSET_MM


def test_the_wall_begins_at_its_row(found_slices: list[Slice]) -> None:
    assert abs(np.mean([one.wall_px for one in found_slices])) < FOUND_WALL_PX


def test_every_slice_is_where_it_is_said_to_be(found_slices: list[Slice]) -> None:
    for one in found_slices:
        assert abs(Z_SHIFTS_MM[one.at_z.argmax()]) <= FOUND_PLACE_MM


def test_the_error_of_rotation_over_the_turn(found_slices: list[Slice]) -> None:
    found = np.concatenate([one.error_rad[one.tells] for one in found_slices])
    true = np.concatenate([one.true_error_rad[one.tells] for one in found_slices])
    assert found.size > 200
    assert np.sqrt(np.mean(true**2)) > 3 * FOUND_TURNING_RAD
    assert np.median(np.abs(found - true)) < FOUND_TURNING_RAD
    assert np.corrcoef(found, true)[0, 1] > 0.9


def test_feed_and_roll_between_frames(found_frames: Frames) -> None:
    feed_mm = found_frames.feed_mm - found_frames.true_feed_mm
    roll_rad = found_frames.roll_rad - found_frames.true_roll_rad
    assert np.ptp(found_frames.true_feed_mm) > 5 * FOUND_FEED_MM
    assert np.std(found_frames.true_roll_rad) > 3 * FOUND_ROLL_RAD
    assert np.sqrt(np.mean(feed_mm**2)) < FOUND_FEED_MM
    assert np.sqrt(np.mean(roll_rad**2)) < FOUND_ROLL_RAD


def test_frames_lie_on_the_true_wall_where_they_are_said_to_be(found_frames: Frames) -> None:
    assert np.abs(np.median(found_frames.z_error_mm)) < FOUND_PLACE_MM
    assert np.abs(np.median(found_frames.roll_error_rad)) < FOUND_ROLL_ON_WALL_RAD


def test_paint_on_a_smooth_wall_is_where_it_is_said_to_be() -> None:
    """Without cells, whose depth moves what is seen of them, a tenth of a pixel can be told."""
    found = frames(*specimen("learning", 1000, PAINTED), indices=range(8))
    assert abs(np.mean(found.feed_mm - found.true_feed_mm)) < FOUND_PAINT_MM
    assert abs(np.mean(found.z_error_mm)) < FOUND_PAINT_MM
    assert abs(np.mean(found.roll_rad - found.true_roll_rad)) < FOUND_PAINT_RAD
    assert abs(np.mean(found.roll_error_rad)) < FOUND_PAINT_RAD


def test_the_annulus_is_centred_where_the_truth_has_its_centre(found_frames: Frames) -> None:
    assert np.abs(found_frames.rim_px[:, :2]).max() < FOUND_RIM_PX
