"""Figures of both sides: which samples each panel shows, what its legend counts, and how agreement runs along."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from endoct.base.arrays import Image
from endoct.fusion.result import CuttingPlane
from endoct.fusion.scoring.overlap import BOTH, NEITHER, ONLY_A, ONLY_B
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.report.figures import surfaces
from endoct.workbench.report.figures.drawing import ORANGE
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panoramas, draw_walls_of
from endoct.workbench.report.side_findings import BothSides, SideFindings

GRID = SurfaceGrid.full_circle(40, 64, z0_mm=0.0, dz_mm=0.1, radius_mm=64 * 0.1 / (2 * np.pi))
VALID = np.ones(GRID.shape, np.bool_)


def side(name: str, cells: slice, depth: Image | None, unseen: slice, modality: str = "oct") -> SideFindings:
    mask, valid = np.zeros(GRID.shape, np.bool_), VALID.copy()
    mask[cells, 10:20] = True
    valid[unseen] = False
    light = np.where(mask, np.float32(0.2), np.float32(0.8)) * np.ones(GRID.shape, np.float32)
    panorama = Panorama(GRID, light, None, VALID, light, modality, True, True)
    return SideFindings(name, light, depth, mask & valid, valid, panorama, {})


DEPTH = np.where(np.arange(40)[:, None] < 20, np.float32(0.5), np.float32(0.0)) * np.ones(GRID.shape, np.float32)
A, B = side("camera", slice(10, 20), None, slice(0, 2)), side("ranger", slice(15, 30), DEPTH, slice(38, 40))
Panels = list[tuple[SurfaceGrid, Any, Any, tuple[Any, ...]]]


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """What is drawn, not rendered."""
    made: list[Figure] = []
    monkeypatch.setattr(surfaces, "render", lambda figure, name: made.append(figure) or name)
    return made


@pytest.fixture
def panels(monkeypatch: pytest.MonkeyPatch, figures: list[Figure]) -> Panels:
    """Grid, values, where they are known, and how they are coloured, of each panel."""
    made: Panels = []
    show = surfaces.show_surface

    def noted(axes: Any, grid: SurfaceGrid, values: Any, known: Any, *colours: Any) -> Any:
        made.append((grid, values, known, colours))
        return show(axes, grid, values, known, *colours)

    monkeypatch.setattr(surfaces, "show_surface", noted)
    assert figures == []
    return made


def titles(figure: Figure) -> list[str]:
    return [title for axes in figure.axes if (title := axes.get_title("left").replace("\n", " "))]


def test_planes_are_drawn_into_their_sides_walls(panels: Panels, figures: list[Figure]) -> None:
    plane = CuttingPlane(
        z_mm=2.0, dip_rad=0.6, azimuth_rad=1.0, z_error_mm=0.0, dip_error_rad=0.0, azimuth_error_rad=0.0, support=0.9,
        radius_mm=1.25,
    )  # fmt: skip
    told = draw_panoramas(BothSides(GRID, (A, replace(B, planes=(plane,))), aligned=True))
    assert told is not None
    assert "Orange lines: planes that cut the bore." in told.caption
    assert "Orange" not in getattr(draw_panoramas(BothSides(GRID, (A, B), aligned=True)), "caption", "")
    orange = [[line for line in axes.lines if line.get_color() == ORANGE] for axes in figures[0].axes[:3]]
    assert [len(lines) for lines in orange] == [0, 1, 1]
    degrees, z_mm = orange[1][0].get_data()
    np.testing.assert_allclose(z_mm, plane.z_at(np.radians(degrees)))
    assert len(panels) == 6


def test_walls_are_intensity_and_depth_of_whoever_has_it(panels: Panels, figures: list[Figure]) -> None:
    told = draw_panoramas(BothSides(GRID, (A, B), aligned=True))
    assert told is not None
    assert told.caption.startswith("Both lie on one grid in the frame of camera.")
    assert titles(figures[0]) == ["(a) camera", "(b) ranger", "(c) ranger, depth"]
    for (_, values, known, _), of, expected in zip(panels, (A, B, B), (A.intensity, B.intensity, DEPTH), strict=True):
        np.testing.assert_array_equal(known, of.valid)
        np.testing.assert_allclose(values[known], expected[known])
    apart = draw_panoramas(BothSides(GRID, (A, B), aligned=False))
    assert apart is not None
    assert apart.caption.startswith("Each lies in its own frame")
    drawn = side("anna", slice(3, 4), None, slice(0, 0), "mask")
    assert draw_walls_of([drawn], GRID, "") is None, "a mask has no intensity"


def test_cells_and_their_difference_are_counted_where_both_observed(panels: Panels, figures: list[Figure]) -> None:
    told = draw_masks(BothSides(GRID, (A, B), aligned=True))
    assert titles(figures[0]) == ["(a) cells, camera", "(b) cells, ranger", "(c) difference"]
    assert [int(values.sum()) for _, values, _, _ in panels[:2]] == [100, 150]
    _, kinds, known, _ = panels[2]
    assert {kind: int((kinds[known] == kind).sum()) for kind in (BOTH, ONLY_A, ONLY_B, NEITHER)} == {
        BOTH: 50, ONLY_A: 50, ONLY_B: 100, NEITHER: 36 * 64 - 200,
    }  # fmt: skip
    legend = figures[0].axes[2].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "both, 0.50 mm²", "only camera, 0.50 mm²", "only ranger, 1.00 mm²", "not observed",
    ]  # fmt: skip
    assert "90.0% of the grid" in told.caption
    assert "could not be aligned" in draw_masks(BothSides(GRID, (A, B), aligned=False)).caption
    assert len(titles(figures[1])) == 2


def test_two_sides_lie_on_each_other_in_tiles_outlines_and_along_the_bore(
    panels: Panels, figures: list[Figure]
) -> None:
    told = draw_alignment(BothSides(GRID, (A, B), aligned=True))
    assert told is not None
    # cells are dark for one and deep for the other: inverted
    assert "camera's intensity and ranger's depth, the latter inverted" in told.caption
    assert "Tiles of 1 mm" in told.caption
    assert len(panels) == 2
    tiles = surfaces._tiles(GRID)
    assert tiles[:10, :10].all()
    assert not tiles[:10, 11:20].any()
    assert not tiles[10:20, :10].any()
    assert tiles[0, 0] != tiles[0, -1], "the board closes"
    along = figures[0].axes[2]
    index, z_mm = along.lines[0].get_xdata(), along.lines[0].get_ydata()
    assert np.asarray(z_mm).tolist() == pytest.approx(GRID.z_mm.tolist())
    # windows of 5 rows: both have cells in rows 15–19, one in 10–14, the other in 20–29
    assert np.asarray(index)[[12, 15, 17, 20, 25]] == pytest.approx([0, 3 / 5, 1, 2 / 5, 0])
    assert np.isnan(np.asarray(index)[[0, 5, 39]]).all()
    assert draw_alignment(BothSides(GRID, (A, B), aligned=False)) is None
    same = draw_alignment(BothSides(GRID, (A, A), aligned=True))
    assert same is not None
    assert "inverted" not in same.caption
