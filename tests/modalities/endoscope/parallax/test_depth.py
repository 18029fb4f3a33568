"""Depth by parallax of simulated recordings, held against their truth, and the plane sweep by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import COORDINATE_ATOL, PARALLAX_FLOOR_MM, PARALLAX_WALL_MM

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import gaussian
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.relief import parallax_relief
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax import depth
from endoct.modalities.endoscope.parallax.depth import (
    COST,
    MOST_ERROR_MM,
    UNSEEN,
    Costs,
    add_parallax,
    best_depths,
    places_seen,
    sweep,
)
from endoct.modalities.endoscope.plugin import ENDOSCOPE
from endoct.modalities.registry import open_recording
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama, read_outline, save_panorama
from endoct.workbench import unroll
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose, true_relief

Unrolled = tuple[Panorama, FrameStream, EndoscopeCalibration]


@pytest.fixture(scope="module")
def unrolled(quick_specimen: Path) -> Unrolled:
    _, stream = open_recording(quick_specimen / "endoscope")
    return unroll(quick_specimen / "endoscope"), stream, ENDOSCOPE.survey(stream, ENDOSCOPE.parameters())


def test_wall_and_floors_lie_where_they_are_as_surely_as_is_said(unrolled: Unrolled, quick_specimen: Path) -> None:
    panorama, _, _ = unrolled
    depth_mm, error_mm = panorama.parallax_depth_mm, panorama.parallax_error_mm
    assert depth_mm is not None
    assert error_mm is not None
    truth = load_truth(quick_specimen)
    pose = true_pose(panorama, truth)
    cell, relief_mm = true_cells(truth, pose, panorama), true_relief(truth, pose, panorama)
    known = np.isfinite(depth_mm)
    assert known.mean() > 0.7
    assert (error_mm[known] <= MOST_ERROR_MM).all()
    np.testing.assert_array_equal(known, np.isfinite(error_mm))
    assert not known[~panorama.valid].any()
    relief = parallax_relief(panorama)
    assert relief is not None
    for where, most_mm in (
        (known & ~cell & (np.abs(relief_mm) < 0.01), PARALLAX_WALL_MM),
        (known & cell & (relief_mm > 0.05) & (relief_mm < 0.3), PARALLAX_FLOOR_MM),
    ):
        error = (relief.relief_mm - relief_mm)[where]
        assert where.sum() > 1000
        assert robust_sigma(error - np.median(error)) < most_mm
        assert abs(np.median(error)) < most_mm
        assert (np.abs(error) <= 2 * error_mm[where]).mean() > 0.8
        assert np.sqrt(np.mean((error / error_mm[where]) ** 2)) > 0.25, "nor is it overstated: 0.4 and 0.9"


def test_the_seam_is_as_smooth_as_elsewhere(unrolled: Unrolled) -> None:
    depth_mm = unrolled[0].parallax_depth_mm
    assert depth_mm is not None
    jumps = np.nanmean(np.abs(np.diff(depth_mm, axis=1, append=depth_mm[:, :1])), axis=0)
    assert jumps[-1] < np.nanquantile(jumps.reshape(-1, 2).max(axis=1), 0.99)


@pytest.fixture(scope="module")
def otherwise(unrolled: Unrolled) -> Panorama:
    """The same with pieces of another length, and optics that are assumed, or not, the other way round."""
    panorama, stream, calibration = unrolled
    optics = replace(calibration.optics, assumed=not calibration.optics.assumed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(depth, "PIECE_MM", 1.26)
        return add_parallax(panorama, stream, replace(calibration, optics=optics))


def test_nothing_shows_where_pieces_meet(unrolled: Unrolled, otherwise: Panorama) -> None:
    one, other = unrolled[0].parallax_depth_mm, otherwise.parallax_depth_mm
    assert one is not None
    assert other is not None
    known = np.isfinite(one) & np.isfinite(other)
    apart = np.where(known, np.abs(one - other), 0)
    assert (apart[known] < 0.01).mean() > 0.98
    assert (apart.sum(axis=1) / np.maximum(known.sum(axis=1), 1)).max() < 0.02, "in no row"


def test_assumed_optics_make_every_depth_less_sure(unrolled: Unrolled, otherwise: Panorama) -> None:
    """An error in proportion to the depth, 15 % instead of 3 %, adds to the others as errors do."""
    panorama, _, calibration = unrolled
    stated, assumed = (otherwise, panorama) if calibration.optics.assumed else (panorama, otherwise)
    depths = stated.parallax_depth_mm, assumed.parallax_depth_mm
    errors = stated.parallax_error_mm, assumed.parallax_error_mm
    same = np.abs(np.subtract(*depths)) < 1e-6  # type: ignore[arg-type]
    deep = same & (np.abs(depths[0]) > 0.15)  # type: ignore[arg-type]
    assert deep.sum() > 1000
    more = errors[1][deep] ** 2 - errors[0][deep] ** 2  # type: ignore[index]
    share = np.sqrt(np.maximum(more, 0)) / np.abs(depths[0][deep])  # type: ignore[index]
    assert np.median(share) == pytest.approx(np.sqrt(0.15**2 - 0.03**2), rel=0.02)
    assert np.nanmin(errors[1]) >= np.nanmin(errors[0])  # type: ignore[arg-type]


def test_what_fewer_than_two_frames_see_is_unknown(unrolled: Unrolled) -> None:
    panorama, _, calibration = unrolled
    known = np.isfinite(panorama.parallax_depth_mm).any(axis=1)  # type: ignore[call-overload]
    z_mm, half_mm = panorama.grid.z_mm, calibration.strip_z_mm
    from_frame = z_mm[:, None] - calibration.z_mm
    seen = ((from_frame > half_mm[0] - 0.02) & (from_frame < half_mm[-1] + 0.02)).sum(axis=1)
    assert (seen < 2).sum() > 3
    assert not known[seen < 2].any()
    assert known[seen > 2].mean() > 0.95


def test_a_store_keeps_it(unrolled: Unrolled, tmp_path: Path) -> None:
    save_panorama(unrolled[0], tmp_path / "p.zarr")
    again = load_panorama(tmp_path / "p.zarr")
    for name in ("parallax_depth_mm", "parallax_error_mm"):
        np.testing.assert_array_equal(getattr(again, name), getattr(unrolled[0], name))
    assert read_outline(tmp_path / "p.zarr").has_parallax


def test_frames_that_are_all_the_same_show_no_depth(unrolled: Unrolled) -> None:
    panorama, stream, calibration = unrolled
    bare = replace(panorama, parallax_depth_mm=None, parallax_error_mm=None)

    class Still:
        acquisition = stream.acquisition

        def __len__(self) -> int:
            return len(stream)

        def __getitem__(self, index: int) -> object:
            return replace(stream[0], index=index)

    assert add_parallax(bare, Still(), calibration).parallax_depth_mm is None  # type: ignore[arg-type]


def test_nobody_looks_where_it_is_not_wanted(quick_specimen: Path) -> None:
    panorama = unroll(quick_specimen / "endoscope", settings={"parallax": False})
    assert panorama.parallax_depth_mm is None


ALONG_MM = np.linspace(-0.4, 0.4, 81)
SLANT = 0.2 + 0.4 * ALONG_MM
STRIP = ALONG_MM, SLANT
ROW_MM, N_COLUMNS = 0.005, 128
FRAME_Z_MM = np.array([0.5, 0.7, 0.9, 1.1])
DEPTHS_MM = np.linspace(-0.1, 0.5, 25)


def test_a_ray_passes_the_wall_short_of_what_it_ends_at() -> None:
    z_mm = np.array([1.0])
    assert places_seen(z_mm, np.array([1.0]), 0.0, STRIP) == pytest.approx(1.0, abs=COORDINATE_ATOL)
    # s + 0.5·(0.2 + 0.4 s) = 0 where s = −0.1/1.2
    assert places_seen(z_mm, np.array([1.0]), 0.5, STRIP) == pytest.approx(1 - 0.1 / 1.2, abs=1e-4)
    assert np.isnan(places_seen(z_mm, np.array([2.0]), 0.0, STRIP)).all()


@given(depth_mm=st.floats(0, 1), from_middle_mm=st.floats(-0.3, 0.3))
def test_what_a_place_is_seen_by_ends_at_that_place(depth_mm: float, from_middle_mm: float) -> None:
    passed_mm = places_seen(np.array([from_middle_mm]), np.zeros(1), depth_mm, STRIP)
    if np.isfinite(passed_mm).all():
        ended = passed_mm + np.interp(passed_mm, ALONG_MM, SLANT) * depth_mm
        assert ended == pytest.approx(from_middle_mm, abs=1e-6)


def drawn(depth_mm: Coordinates, rng: np.random.Generator) -> tuple[NDArray[np.int8], Coordinates]:
    """Return what four frames show of a textured surface ``depth_mm`` (n_columns,) behind the wall, with noise."""
    fine_mm = ROW_MM * np.arange(400)
    texture = gaussian(rng.normal(size=(400, N_COLUMNS)).astype(np.float32), 2, 2)
    texture *= 30 / texture.std()
    frames = np.empty((4, ALONG_MM.size * 2 - 1, N_COLUMNS), np.int8)
    rows_mm = np.linspace(-0.4, 0.4, frames.shape[1])
    for k, z_mm in enumerate(FRAME_Z_MM):
        for j in range(N_COLUMNS):
            ends_mm = z_mm + rows_mm + np.interp(rows_mm, ALONG_MM, SLANT) * depth_mm[j]
            passed_mm = np.interp(ends_mm, fine_mm, texture[:, j]) + rng.normal(0, 5, rows_mm.size)
            frames[k, :, j] = np.clip(np.rint(passed_mm), -127, 127)
    return frames, FRAME_Z_MM - 0.4


def costs_of(frames: NDArray[np.int8], first_mm: Coordinates) -> Costs:
    z_mm = (0.6 + ROW_MM * np.arange(160)).reshape(40, 4)
    return sweep(frames, first_mm, ROW_MM, FRAME_Z_MM, STRIP, z_mm, DEPTHS_MM)


def test_a_step_in_the_surface_is_found_where_it_lies_and_across_the_seam() -> None:
    depth_mm = np.zeros(N_COLUMNS)
    depth_mm[-30:] = depth_mm[:20] = 0.25
    costs = costs_of(*drawn(depth_mm, np.random.default_rng(3)))
    assert costs.shape == (40, N_COLUMNS // 2, DEPTHS_MM.size)
    found = best_depths(costs, COST // 5, COST, DEPTHS_MM)
    truth = depth_mm.reshape(-1, 2).mean(axis=1)
    error = np.abs(found - truth)[:, np.r_[2:8, 12:47, 51:62]]  # away from the two steps
    assert np.median(error) < PARALLAX_WALL_MM
    assert (error < 0.05).mean() > 0.9
    seam = found[:, np.r_[-3:0, 0:3]]
    assert np.abs(seam - 0.25).mean() < 0.05


def test_turning_the_bore_turns_the_depths() -> None:
    depth_mm = np.where(np.arange(N_COLUMNS) < 40, 0.2, 0.0)
    frames, first_mm = drawn(depth_mm, np.random.default_rng(4))
    costs = costs_of(frames, first_mm)
    turned = costs_of(np.roll(frames, 50, axis=2), first_mm)
    np.testing.assert_array_equal(turned, np.roll(costs, 25, axis=1))
    one, other = (best_depths(each, COST // 5, COST, DEPTHS_MM) for each in (costs, turned))
    # a path begins at the seam, and two laps nearly forget where
    assert (np.abs(other - np.roll(one, 25, axis=1)) < 1e-6).mean() > 0.97


def test_what_one_frame_alone_sees_is_not_known() -> None:
    frames, first_mm = drawn(np.zeros(N_COLUMNS), np.random.default_rng(5))
    frames[:, :, 10:20] = -128
    frames[1:, :, 40:50] = -128
    costs = costs_of(frames, first_mm)
    assert (costs[:, 5:10] == UNSEEN).all()
    assert (costs[:, 20:25] == UNSEEN).all()
    assert (costs[10:30, 30:] <= COST).all()


def test_noise_alone_costs_the_same_at_every_depth() -> None:
    rng = np.random.default_rng(6)
    frames = rng.integers(-60, 60, (4, 161, N_COLUMNS)).astype(np.int8)
    costs = costs_of(frames, FRAME_Z_MM - 0.4).astype(float)
    means = costs.mean(axis=(0, 1))
    assert np.ptp(means) < 0.1 * COST
    assert means.min() > 0.7 * COST
