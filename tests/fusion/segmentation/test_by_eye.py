"""What Jaccard index a learned eye expects, by hand."""

from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.evidence.side import Side
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.segmentation import by_eye
from endoct.fusion.segmentation.by_eye import cells_by_eye, check_eye, expected_jaccard, is_sure, view_of
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
    monkeypatch.setattr(by_eye, "LEAST_SHARED", 1.1)
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
    assert all(doubt.value == expected for doubt in cells.doubts)
