"""A bore forty times as wide gives what one of 2.5 mm gives, every length times forty."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair

from endoct.base.errors import EndoctError
from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.doubts import doubts_of_parts, doubts_of_step
from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.fusion.geometry.alignment import LandmarkPair, Place
from endoct.fusion.geometry.placement import bore_scale, scaled_grid, scaled_panorama
from endoct.fusion.pose.observation import observe
from endoct.fusion.registration.rigidity import LoosePart
from endoct.fusion.registration.steps import LEAST_STEP_MM, Step
from endoct.fusion.segmentation.side_cells import segment
from endoct.stitching.grid import SurfaceGrid

FACTOR = 40.0


def test_bores_in_bone_are_seen_as_they_are(pair: Pair) -> None:
    assert [bore_scale(radius_mm) for radius_mm in (0.8, 1.25, 1.4, 5.0)] == [1, 1, 1, 1]
    assert bore_scale(50.0) == FACTOR
    side = Side("a", pair.a)
    assert side.in_reference is side


def test_every_length_is_scaled_and_nothing_else(pair: Pair) -> None:
    depth = np.full(pair.b.grid.shape, 0.25, np.float32)
    error = np.full(pair.b.grid.shape, 0.125, np.float32)
    wide = scaled_panorama(replace(pair.b, parallax_depth_mm=depth, parallax_error_mm=error), 2.0)
    assert np.array_equal(wide.z_mm, 2 * pair.b.z_mm)
    assert np.array_equal(wide.depth_mm, 2 * pair.b.depth_mm)
    assert (wide.parallax_depth_mm == 0.5).all()
    assert (wide.parallax_error_mm == 0.25).all()
    assert np.array_equal(wide.intensity, pair.b.intensity)
    assert (wide.grid.radius_mm, wide.grid.dtheta_rad) == (2.5, pair.b.grid.dtheta_rad)
    uneven = SurfaceGrid.full_circle(3, 16, z0_mm=1.0, dz_mm=1.0, radius_mm=1.0).with_rows([1, 2, 4])
    assert scaled_grid(uneven, 3.0).rows_mm == (3, 6, 12)


def test_masks_are_the_same(pair: Pair) -> None:
    for panorama in (pair.a, pair.b):
        cells = segment(panorama)
        assert 0.02 < cells.mean() < 0.5
        assert np.array_equal(cells, segment(scaled_panorama(panorama, FACTOR)))


def test_two_sides_are_compared_alike(pair: Pair) -> None:
    parameters, known = CompareParameters(n_theta=512), np.zeros(pair.a.grid.shape, np.float32)
    seen = replace(pair.a, parallax_depth_mm=known, parallax_error_mm=known + np.float32(0.125))
    small = compare_panoramas(seen, pair.b, parameters)
    wide = compare_panoramas(*(scaled_panorama(one, FACTOR) for one in (seen, pair.b)), parameters)
    one, two = small.alignment, wide.alignment
    assert one is not None
    assert two is not None
    assert two.theta_shift_rad == pytest.approx(one.theta_shift_rad, abs=1e-5)
    assert two.z_shift_mm == pytest.approx(FACTOR * one.z_shift_mm, abs=1e-3)
    assert two.z_scale == pytest.approx(one.z_scale, abs=1e-6)
    assert two.overlap_mm2 == pytest.approx(FACTOR**2 * one.overlap_mm2, rel=1e-4)
    assert two.twist_rad_per_mm == pytest.approx(one.twist_rad_per_mm / FACTOR, rel=1e-3)
    z_mm = 3.0
    assert two.z_error_mm(FACTOR * z_mm) == pytest.approx(FACTOR * one.z_error_mm(z_mm), rel=1e-3)
    assert two.covariance[0][1] == pytest.approx(FACTOR * one.covariance[0][1], rel=1e-2)
    assert wide.result.jaccard == pytest.approx(small.result.jaccard, abs=0.01)
    for name, threshold in small.result.threshold.items():
        other = wide.result.threshold[name]
        factor = FACTOR if threshold.unit == "mm" else 1.0
        assert other.value == pytest.approx(factor * threshold.value, rel=1e-4)
        assert other.of == f"{threshold.of}; lengths as in a bore of 2.5 mm"
    deepest = [np.nanmax(comparison.sides[1].relief_mm) for comparison in (small, wide)]
    assert deepest[1] == pytest.approx(FACTOR * deepest[0], rel=0.01)
    # what light tells of depth is known for bores in bone alone; parallax is a measurement
    assert np.nanmax(small.sides[0].relief_mm) > 0.1
    assert np.nanmax(np.abs(wide.sides[0].relief_mm)) < 0.01 * FACTOR
    of_wide = wide.sides[0].relief_error_mm
    assert of_wide[np.isfinite(of_wide)] == pytest.approx(FACTOR * 0.125)


def test_both_sides_are_scaled_alike(pair: Pair) -> None:
    wide = [scaled_panorama(one, FACTOR) for one in (pair.a, pair.b)]
    other = replace(wide[1], grid=replace(wide[1].grid, radius_mm=49.5))
    assert [side.scale for side in two_sides(wide[0], other)] == [FACTOR, FACTOR]
    assert Side("b", other).scale == pytest.approx(49.5 / 1.25)


def test_a_mask_drawn_on_the_other_side_stays_there(pair: Pair) -> None:
    wide = scaled_panorama(pair.a, FACTOR)
    a, b = two_sides(wide, DrawnMask(wide.grid, pair.cells_a, "a", "1", drawn_on=wide))
    assert b.is_drawn_on(a)
    assert b.in_reference.is_drawn_on(a.in_reference)


def test_doubts_are_in_mm_of_the_bore() -> None:
    part = LoosePart("band", 1.0, 2.0, 0.3, 0.4, (0.9, 0.1))
    (doubt,) = doubts_of_parts([part], "b", FACTOR)
    assert "between z = 40.0 and 80.0 mm it fits best +12.00 mm along and +16.00 mm around" in doubt.what
    assert doubt.value == pytest.approx(FACTOR * part.off_mm)
    assert doubt.expected == (0.0, FACTOR * part.limit_mm)
    (doubt,) = doubts_of_step(Step(1.5, -0.5), "b", FACTOR)
    assert "From about z = 60.0 mm on, the wall of b fits best -20.00 mm" in doubt.what
    assert (doubt.value, doubt.expected) == (20.0, (0.0, FACTOR * LEAST_STEP_MM))


def test_landmark_pairs_are_refused_in_wide_bores(pair: Pair) -> None:
    wide = [scaled_panorama(one, FACTOR) for one in (pair.a, pair.b)]
    pairs = [LandmarkPair(a=Place(0.1, 1.0), b=Place(0.1, 1.0))]
    with pytest.raises(EndoctError, match="landmark pairs"):
        compare_panoramas(*wide, pairs=pairs)


def test_no_pose_is_looked_for_in_wide_bores(pair: Pair) -> None:
    with pytest.raises(EndoctError, match="as wide as those in bone"):
        observe(Side("a", scaled_panorama(pair.a, FACTOR)))
