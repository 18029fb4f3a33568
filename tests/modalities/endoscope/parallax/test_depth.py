"""Depth by parallax of simulated recordings, held against their truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tolerances import PARALLAX_FLOOR_MM, PARALLAX_WALL_MM

from endoct.base.arrays import Image
from endoct.base.compute.memory import Kept
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.depth_against_light import MOST_APART_MM
from endoct.fusion.evidence.relief import parallax_relief
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax import depth
from endoct.modalities.endoscope.parallax.depth import MOST_ERROR_MM, SCALE_ASSUMED, SCALE_STATED, add_parallax
from endoct.modalities.endoscope.parallax.views import Texture, fine_grid
from endoct.modalities.endoscope.plugin import ENDOSCOPE
from endoct.modalities.recognition import open_recording
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
    matched_mm = matched(panorama, unrolled[2].optics.assumed)
    assert (matched_mm[known] <= np.hypot(MOST_ERROR_MM, MOST_APART_MM) + 1e-6).all()
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
        assert (np.abs(error) <= 2 * error_mm[where]).mean() > 0.9
        assert np.sqrt(np.mean((error / error_mm[where]) ** 2)) > 0.25, "nor is it overstated: 0.4 and 0.9"


def test_the_seam_is_as_smooth_as_elsewhere(unrolled: Unrolled) -> None:
    depth_mm = unrolled[0].parallax_depth_mm
    assert depth_mm is not None
    jumps = np.nanmean(np.abs(np.diff(depth_mm, axis=1, append=depth_mm[:, :1])), axis=0)
    assert jumps[-1] < np.nanquantile(jumps.reshape(-1, 2).max(axis=1), 0.99)


def matched(panorama: Panorama, assumed: bool) -> Image:
    """Return the error without what the optics add to it, mm."""
    assert panorama.parallax_depth_mm is not None
    assert panorama.parallax_error_mm is not None
    of_scale_mm = (SCALE_ASSUMED if assumed else SCALE_STATED) * panorama.parallax_depth_mm
    return np.sqrt(np.maximum(panorama.parallax_error_mm**2 - of_scale_mm**2, 0))


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
    """An error in proportion to the depth, 40 % instead of 3 %, adds to the others as errors do."""
    panorama, _, calibration = unrolled
    stated, assumed = (otherwise, panorama) if calibration.optics.assumed else (panorama, otherwise)
    depths = stated.parallax_depth_mm, assumed.parallax_depth_mm
    errors = stated.parallax_error_mm, assumed.parallax_error_mm
    same = np.abs(np.subtract(*depths)) < 1e-6  # type: ignore[arg-type]
    deep = same & (np.abs(depths[0]) > 0.15)  # type: ignore[arg-type]
    assert deep.sum() > 1000
    more = errors[1][deep] ** 2 - errors[0][deep] ** 2  # type: ignore[index]
    share = np.sqrt(np.maximum(more, 0)) / np.abs(depths[0][deep])  # type: ignore[index]
    assert np.median(share) == pytest.approx(np.sqrt(0.4**2 - 0.03**2), rel=0.02)
    assert np.nanmin(errors[1]) >= np.nanmin(errors[0])  # type: ignore[arg-type]
    as_frames_tell = matched(otherwise, not calibration.optics.assumed)
    assert np.nanmax(as_frames_tell) <= MOST_ERROR_MM + 1e-6
    assert (depths[1] > MOST_ERROR_MM / SCALE_ASSUMED).sum() > 100, "what frames tell surely stays known"  # type: ignore[operator]


def test_what_fewer_than_two_frames_see_is_unknown(unrolled: Unrolled) -> None:
    panorama, _, calibration = unrolled
    known = np.isfinite(panorama.parallax_depth_mm).any(axis=1)  # type: ignore[call-overload]
    z_mm, half_mm = panorama.grid.z_mm, calibration.strip_z_mm
    from_frame = z_mm[:, None] - calibration.z_mm
    seen = ((from_frame > half_mm[0] - 0.02) & (from_frame < half_mm[-1] + 0.02)).sum(axis=1)
    assert (seen < 2).sum() > 3
    assert not known[seen < 2].any()
    assert known[seen > 2].mean() > 0.95


def test_a_piece_that_no_frame_shows_is_unknown(unrolled: Unrolled) -> None:
    """As where a pullback with a gap in its positions was recorded."""
    _, _, calibration = unrolled
    away, fine = replace(calibration, z_mm=calibration.z_mm + 100), fine_grid(calibration)
    piece = depth._pieces(fine)[0]
    with Kept[Texture]() as none:
        _, error_mm = depth._swept(piece, none, away, fine)
    assert error_mm.shape == (len(piece.kept), fine.n_blocks[1])
    assert np.isnan(error_mm).all()


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

    looked = add_parallax(bare, Still(), calibration)  # type: ignore[arg-type]
    for of in (looked.parallax_depth_mm, looked.parallax_error_mm):
        assert of is not None
        assert np.isnan(of).all()


def test_nobody_looks_where_it_is_not_wanted(quick_specimen: Path) -> None:
    panorama = unroll(quick_specimen / "endoscope", settings={"parallax": False})
    assert panorama.parallax_depth_mm is None
