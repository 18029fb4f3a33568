"""What Jaccard index a learned eye expects, by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.evidence.side import Side
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.segmentation import by_eye
from endoct.fusion.segmentation.by_eye import (
    cells_by_eye,
    check_eye,
    expected_jaccard,
    held_against,
    is_sure,
    view_of,
)
from endoct.fusion.segmentation.learned.looking import Probability
from endoct.fusion.segmentation.learned.network import Eye, save_eye
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

CELL = np.zeros((120, 500), bool)
CELL[30:70, -20:] = CELL[30:70, :20] = True


def marked_side(noise: float) -> Side:
    """Return a wall with a dark cell across the seam, ``CELL``."""
    shape = CELL.shape
    grid = SurfaceGrid.full_circle(*shape, z0_mm=0.0, dz_mm=0.015, radius_mm=1.2)
    light = np.exp(np.random.default_rng(4).normal(0, noise, shape) - 0.8 * CELL).astype(np.float32)
    return Side("endoscope", Panorama(grid, light, None, np.ones(shape, bool), np.ones(shape), "endoscope", True, True))


def seen(side: Side) -> tuple[Segmentation, float]:
    """Return the cells that our eye sees, and the Jaccard index that it expects."""
    view = view_of(side, SegmentParameters())
    assert view is not None
    return cells_by_eye(view, SegmentParameters())


def test_what_is_surely_cell_over_what_may_be() -> None:
    probability = np.array([[0.9, 0.7, 0.2, 0.0, 1.0]], np.float32)
    mask, valid = np.array([[1, 1, 0, 0, 0]], bool), np.array([[1, 1, 1, 1, 0]], bool)
    assert expected_jaccard(probability, mask, valid) == pytest.approx(1.6 / 2.2)


def test_without_cells_all_is_well() -> None:
    none = np.zeros((2, 3), bool)
    assert expected_jaccard(np.zeros((2, 3), np.float32), none, ~none) == 1


@pytest.mark.parametrize(("noise", "familiar"), [(0.02, True), (0.3, False)])
def test_a_wall_with_noise_in_every_sample_is_left_to_the_threshold(noise: float, familiar: bool) -> None:
    side = marked_side(noise)
    view = view_of(side, SegmentParameters())
    assert view is not None
    assert view.is_familiar == familiar
    found = segment_side(side, SegmentParameters(), "dark")
    assert ("learned eye for endoscope" in found.of) == familiar
    declined = None if familiar else "the wall is too grainy for the learned eye"
    assert (found.by, found.eye_declined) == ("eye" if familiar else "rules", declined)
    assert (found.mask & CELL).sum() > 0.8 * CELL.sum()
    off = segment_side(side, SegmentParameters(eye="off"), "dark")
    assert "eye" not in off.of


@pytest.mark.parametrize("sure", [True, False])
def test_who_is_sure_decides(sure: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    side = marked_side(0.02)
    monkeypatch.setattr(by_eye, "SURE_EXPECTED", 0.0 if sure else 1.1)
    monkeypatch.setattr(by_eye, "LEAST_LIKE_SOUND", 1.1)
    assert is_sure(*seen(side)) == sure
    found = segment_side(side, SegmentParameters(), "dark")
    assert found.eye_declined == (None if sure else "the learned eye is not sure of this wall")
    assert not found.doubts
    assert (found.mask & CELL).sum() > 0.9 * CELL.sum()


@pytest.mark.parametrize("of", ["endoscope", "oct", None])
def test_weights_of_the_users_look_at_a_side_or_are_refused(of: str | None, tmp_path: Path) -> None:
    grid = SurfaceGrid.full_circle(6, 16, z0_mm=0.0, dz_mm=0.015, radius_mm=1.2)
    ones = np.ones(grid.shape)
    light, depth = np.random.default_rng(1).uniform(1, 2, (2, *grid.shape)).astype(np.float32)
    endoscope = Side("endoscope", Panorama(grid, light, None, ones > 0, ones, "endoscope", True, True))
    oct_ = Side("oct", Panorama(grid, light, depth, ones > 0, ones, "oct", True, True))
    path = tmp_path / "eye.safetensors"
    save_eye(Eye(), path, {} if of is None else {"modality": of})
    given = SegmentParameters(eye=str(path))
    if of == "endoscope":
        check_eye(given, endoscope, oct_)
        check_eye(given, oct_, endoscope)
        with pytest.raises(EndoctError, match="nothing to look at; found sides with depth"):
            check_eye(given, oct_, oct_)
    else:  # those for "oct" do not look at it either: its depth shows the cells
        with pytest.raises(EndoctError, match="nothing to look at; found endoscope"):
            check_eye(given, endoscope, oct_)
    for eye in ("endoct", "off"):
        check_eye(SegmentParameters(eye=eye), oct_, oct_)


def test_a_comparison_refuses_weights_for_neither_side(tmp_path: Path) -> None:
    grid = SurfaceGrid.full_circle(6, 16, z0_mm=0.0, dz_mm=0.015, radius_mm=1.2)
    ones = np.ones(grid.shape)
    light = np.random.default_rng(1).uniform(1, 2, grid.shape).astype(np.float32)
    one = Panorama(grid, light, None, ones > 0, ones, "endoscope", True, True)
    save_eye(Eye(), tmp_path / "eye.safetensors", {"modality": "oct"})
    with pytest.raises(EndoctError, match="nothing to look at"):
        compare_panoramas(one, one, CompareParameters(eye=str(tmp_path / "eye.safetensors")))


def test_cells_that_the_eye_is_blind_to_are_left_to_the_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    side = marked_side(0.02)
    monkeypatch.setattr(by_eye, "LEAST_PROBABILITY", 1.1)
    assert not seen(side)[0].mask.any()
    found = segment_side(side, SegmentParameters(), "dark")
    assert found.eye_declined == "the learned eye is not sure of this wall"
    assert found.mask.any()


@pytest.mark.parametrize(("least", "doubted"), [(0.0, False), (1.1, True)])
def test_an_eye_that_expects_little_doubts_its_cells(
    least: float, doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    side = marked_side(0.02)
    monkeypatch.setattr(by_eye, "LEAST_EXPECTED", least)
    cells, expected = seen(side)
    assert [doubt.code for doubt in cells.doubts] == ["cells-unsure"] * doubted
    assert all((doubt.value, doubt.expected) == (expected, (least, 1.0)) for doubt in cells.doubts)


ROW = np.arange(20)


def row_of_cells(first: int, last: int, *doubts: Doubt) -> Segmentation:
    """Return cells from sample ``first`` to before ``last`` of 20."""
    return Segmentation(((first <= ROW) & (last > ROW))[None], 0.5, "1", "its own", "dark", "rules", None, None, doubts)


@pytest.mark.parametrize(
    ("first", "last", "stays"), [(0, 10, True), (0, 8, True), (0, 7, False), (0, 13, True), (0, 14, False)]
)
def test_cells_of_the_eye_stay_where_they_are_like_sound_ones_by_rules(first: int, last: int, stays: bool) -> None:
    """The eye sees less than the 10 samples by rules, or more: 8 of 10 and 10 of 13 are alike, 7 and 10 of 14 not."""
    by_eye_, by_rules = row_of_cells(first, last), row_of_cells(0, 10)
    kept = held_against(by_eye_, by_rules)
    assert kept.mask is (by_eye_ if stays else by_rules).mask
    assert kept.of == "its own"
    assert kept.eye_declined == (None if stays else "the learned eye is not sure of this wall")
    assert not kept.doubts
    none = row_of_cells(0, 0)
    assert held_against(by_eye_, none) is by_eye_, "nothing that it could have missed"


@pytest.mark.parametrize(("shared", "agree"), [(10, True), (5, True), (4, False), (0, False)])
def test_cells_of_the_eye_that_doubtful_ones_contradict_are_doubted(shared: int, agree: bool) -> None:
    """Of 10 samples of either, the union is 10; by Jaccard's index, 5 of 10 agree."""
    own = Doubt("own", "Its own.")
    by_eye_, by_rules = row_of_cells(0, 10, own), row_of_cells(10 - shared, 10, Doubt("other", "Another."))
    kept = held_against(by_eye_, by_rules)
    assert kept.mask is by_eye_.mask
    assert kept.of == "its own"
    assert kept.doubts[0] is own
    if agree:
        assert kept is by_eye_
    else:
        (doubt,) = kept.doubts[1:]
        assert (doubt.code, doubt.value) == ("cells-by-eye-alone", pytest.approx(shared / 10))
        assert doubt.expected == (by_eye.LEAST_AGREEMENT, 1.0)
        assert f"of {shared / 10:.2f} with" in doubt.what


def test_an_eye_is_sure_from_what_it_expects_on_and_never_of_nothing() -> None:
    some, none = row_of_cells(3, 4), row_of_cells(3, 3)
    assert is_sure(some, by_eye.SURE_EXPECTED)
    assert not is_sure(some, by_eye.SURE_EXPECTED - 1e-9)
    assert not is_sure(none, 1.0)


def test_what_depth_added_and_dropped_is_counted_beyond_the_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell by both, three samples wider by depth; one by depth alone, of 20 × 40; one without it, of 10 × 40."""
    of_cell, without = np.zeros((2, *CELL.shape), np.float32)
    of_cell[30:70, 97:203], without[30:70, 100:200] = 0.5, 0.5
    of_cell[30:50, 300:340], without[80:90, 300:340] = 0.41, 0.9
    of_cell[100:, 400:440] = 0.39  # too improbable
    monkeypatch.setattr(by_eye, "look", lambda *_: Probability(of_cell, without))
    side = marked_side(0.02)
    known = np.where(np.arange(CELL.shape[1]) < 400, np.float32(0.0), np.float32(np.nan))
    depth_mm = np.broadcast_to(known, CELL.shape).copy()
    panorama = replace(side.panorama, parallax_depth_mm=depth_mm, parallax_error_mm=depth_mm + np.float32(0.02))
    plain = SegmentParameters(open_mm=0, close_mm=0, smallest_mm2=0)
    side = replace(side, panorama=panorama)
    view = view_of(side, plain)
    assert view is not None
    cells, _ = cells_by_eye(view, plain)
    assert cells.by_depth is not None
    assert cells.by_depth.known == pytest.approx(0.8)
    assert cells.by_depth.added == pytest.approx(20 * 40 / CELL.size)
    assert cells.by_depth.dropped == pytest.approx(10 * 40 / CELL.size)
    np.testing.assert_array_equal(cells.mask, of_cell > 0.4)
    assert cells.by == "eye"
    flat = view_of(side, plain.model_copy(update={"by_depth": False}))
    assert flat is not None
    assert cells_by_eye(flat, plain)[0].by_depth is None


@pytest.mark.parametrize(("dz_mm", "has"), [(0.059, True), (0.061, False)])
def test_samples_too_coarse_for_the_eye_are_not_shown_to_it(dz_mm: float, has: bool) -> None:
    panorama = marked_side(0.02).panorama
    along = replace(panorama, grid=replace(panorama.grid, dz_mm=dz_mm))
    assert (view_of(Side("endoscope", along), SegmentParameters()) is not None) is has
    around = replace(panorama, grid=replace(panorama.grid, radius_mm=500 * dz_mm / (2 * np.pi)))
    assert (view_of(Side("endoscope", around), SegmentParameters()) is not None) is has
    assert view_of(Side("endoscope", panorama), SegmentParameters(eye="off")) is None
