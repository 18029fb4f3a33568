"""Masks with most of the wall as cell are doubted, as a side and as truth."""

import numpy as np

from endoct.fusion.evidence.side import DrawnMask, Side
from endoct.fusion.scoring.raters import Drawing
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.pipeline.hand_masks import Against, doubts_of_drawings

EVERYWHERE = np.ones((2, 10), np.bool_)


def mask(cells: int) -> np.ndarray:
    return np.tile(np.arange(10) < cells, (2, 1))


def test_a_mask_with_most_of_the_wall_as_cell_is_doubted() -> None:
    grid = SurfaceGrid.full_circle(2, 10, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    drawn = [DrawnMask(grid, mask(cells), "anna", "1", file=f"anna_{cells}.png") for cells in (5, 6)]
    sides = [Side("mask", each.panorama, each) for each in drawn] + [Side("oct", drawn[1].panorama)]
    (doubt,) = doubts_of_drawings(sides, Against({}))
    assert (doubt.code, doubt.value, doubt.expected) == ("mask-mostly-cells", 0.6, (0.0, 0.5))
    assert "In the mask anna_6.png 60% of the wall is cell" in doubt.what


def test_a_truth_is_doubted_over_what_was_drawn() -> None:
    observed = np.tile(np.arange(10) >= 4, (2, 1))
    drawings = tuple(Drawing("anna", str(k), mask(7), valid) for k, valid in enumerate((EVERYWHERE, observed)))
    truth = {"some/anna_0.png": {}, "some/anna_1.png": {}}
    doubts = list(doubts_of_drawings((), Against(truth, drawings)))
    assert [(doubt.value, "mask anna_0.png 70%" in doubt.what) for doubt in doubts] == [(0.7, True)]
    nothing = Drawing("anna", "1", mask(7), ~EVERYWHERE)
    assert not list(doubts_of_drawings((), Against({"anna_1.png": {}}, (nothing,))))
