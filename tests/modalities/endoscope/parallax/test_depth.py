"""Depth by parallax of simulated recordings, held against their truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tolerances import PARALLAX_FLOOR_MM, PARALLAX_WALL_MM

from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.relief import parallax_relief
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax.depth import MOST_ERROR_MM, add_parallax
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


def test_the_seam_is_as_smooth_as_elsewhere(unrolled: Unrolled) -> None:
    depth_mm = unrolled[0].parallax_depth_mm
    assert depth_mm is not None
    jumps = np.nanmean(np.abs(np.diff(depth_mm, axis=1, append=depth_mm[:, :1])), axis=0)
    assert jumps[-1] < np.nanquantile(jumps.reshape(-1, 2).max(axis=1), 0.99)


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


def test_assumed_optics_tell_no_depth_where_openings_lie_with_the_wall(unrolled: Unrolled) -> None:
    panorama, stream, calibration = unrolled
    depth_mm = panorama.parallax_depth_mm
    assert depth_mm is not None
    painted = np.zeros(depth_mm.shape, np.bool_)
    painted[100:200, 300:500] = True
    painted &= np.abs(depth_mm) < 0.02
    bare = replace(
        panorama,
        intensity=np.where(painted, np.float32(0.3), np.float32(0.5)),
        parallax_depth_mm=None,
        parallax_error_mm=None,
    )
    stated, assumed = (
        add_parallax(bare, stream, replace(calibration, optics=replace(calibration.optics, assumed=each)))
        for each in (False, True)
    )
    assert stated.parallax_error_mm is not None
    assert assumed.parallax_depth_mm is not None
    assert np.isnan(assumed.parallax_depth_mm).all()
    error_mm, before_mm = stated.parallax_error_mm, panorama.parallax_error_mm
    assert before_mm is not None
    both = painted & np.isfinite(error_mm) & np.isfinite(before_mm)
    assert both.sum() > 1000
    assert np.median(error_mm[both] / before_mm[both]) > 2  # what is as dark as an opening there is doubted
