"""Sides of a comparison: what a mask lies on, what they are called, and which evidence their cells have."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

GRID = SurfaceGrid.full_circle(8, 32, z0_mm=0.0, dz_mm=0.05, radius_mm=1.2)
LIGHT = np.random.default_rng(3).uniform(0.5, 1, GRID.shape).astype(np.float32)
DEPTH = np.where(LIGHT > 0.9, np.float32(0.3), np.float32(0.0))
CAMERA = Panorama(GRID, LIGHT, None, LIGHT > 0, LIGHT, "endoscope", True, True)
RANGER = Panorama(GRID, LIGHT, DEPTH, LIGHT > 0, LIGHT, "oct", True, True)


def test_a_mask_lies_on_what_it_was_drawn_on_alone() -> None:
    drawn = DrawnMask(GRID, LIGHT > 0.9, "anna", "1", CAMERA, "anna_1.png")
    assert drawn.lies_on(CAMERA)
    assert not replace(drawn, drawn_on=None).lies_on(CAMERA)
    assert not drawn.lies_on(replace(CAMERA, grid=replace(GRID, dz_mm=0.06)))
    one, two = two_sides(CAMERA, drawn)
    assert (one.is_drawn_on(two), two.is_drawn_on(one)) == (False, True)
    assert drawn.panorama.handedness_known
    assert not replace(drawn, drawn_on=None).panorama.handedness_known
    assert drawn.panorama.provenance["mask"] == "anna_1.png"
    np.testing.assert_array_equal(drawn.panorama.intensity, LIGHT > 0.9)


def test_sides_are_called_by_their_modality_and_numbered_where_that_is_one() -> None:
    assert [side.name for side in two_sides(CAMERA, RANGER)] == ["endoscope", "oct"]
    assert [side.name for side in two_sides(CAMERA, CAMERA)] == ["endoscope-1", "endoscope-2"]


@pytest.mark.parametrize(("panorama", "of", "kind"), [
    (CAMERA, "relief", "darkness"), (CAMERA, "intensity", "darkness"), (RANGER, "relief", "relief"),
    (RANGER, "intensity", "darkness"),
])  # fmt: skip
def test_cells_show_by_depth_where_that_is_wanted_and_there(panorama: Panorama, of: str, kind: str) -> None:
    side = Side("x", panorama)
    assert side.cell_evidence(of).kind == kind  # type: ignore[arg-type]
    assert (side.relief is not None) is (panorama is RANGER)
    assert side.parallax is None
    drawn = two_sides(CAMERA, DrawnMask(GRID, LIGHT > 0.9, "anna", "1"))[1]
    assert drawn.cell_evidence(of).kind == "mask"  # type: ignore[arg-type]


def test_bright_cells_are_the_dark_ones_the_other_way_round() -> None:
    side = Side("x", CAMERA)
    dark, bright = side.contrast("dark"), side.contrast("bright")
    assert np.corrcoef(dark.values.ravel(), bright.values.ravel())[0, 1] < -0.9
