"""Cells as objects: measured, matched, across the seam of θ."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from skimage.measure import label, regionprops
from tolerances import CELL_AREA_REL, CELL_PLACE_MM

from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.files.store import LATER, as_numbers, from_numbers, write_cells
from endoct.fusion.scoring.cells import Cell, measure
from endoct.fusion.scoring.overlap import Surface
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(150, 512, z0_mm=1.0, dz_mm=0.02, radius_mm=1.25)
SEEN = np.ones(GRID.shape, np.bool_)


def disc(z_mm: float, arc_mm: float, radius_mm: float) -> NDArray[np.bool_]:
    """Return a disc on the wall; ``arc_mm`` from θ = 0."""
    away = wrap_rad(GRID.theta_rad - arc_mm / GRID.radius_mm) * GRID.radius_mm
    return np.asarray(np.hypot(GRID.z_mm[:, None] - z_mm, away[None]) < radius_mm)


def measured(a: Surface, b: Surface) -> tuple[Cell, ...]:
    return measure(a, b, GRID, aligned=True)


def side(name: str, *discs: NDArray[np.bool_], valid: NDArray[np.bool_] = SEEN, depth: float | None = None) -> Surface:
    mask = np.logical_or.reduce(discs) & valid
    relief = None if depth is None else np.where(mask, depth, 0.0).astype(np.float32)
    return Surface(name, mask, valid, relief)


def test_a_cell_on_the_seam_is_measured_whole() -> None:
    (cell,) = (
        c for c in measured(side("a", disc(2.5, 0.05, 0.4), depth=0.3), side("b", disc(3.0, 3, 0.3))) if c.side == "a"
    )
    assert cell.area_mm2 == pytest.approx(np.pi * 0.4**2, rel=CELL_AREA_REL)
    assert cell.diameter_mm == pytest.approx(0.8, rel=CELL_AREA_REL)
    assert cell.z_mm == pytest.approx(2.5, abs=CELL_PLACE_MM)
    assert abs(wrap_rad(cell.theta_rad - 0.05 / 1.25)) * 1.25 < CELL_PLACE_MM
    assert cell.depth_median_mm == pytest.approx(0.3)
    # the fan between the bore and 0.3 mm behind it
    assert cell.volume_mm3 == pytest.approx(cell.area_mm2 * 0.3 * (1 + 0.3 / 2.5), rel=1e-5)
    assert not cell.touches_edge
    assert cell.seen_by == "a"
    assert cell.partner is None


def test_as_scikit_image_measures_it() -> None:
    mask = np.logical_or.reduce([disc(z, arc, r) for z, arc, r in ((1.5, 2, 0.2), (2.4, 5, 0.35), (3.2, 3.5, 0.1))])
    own = [c for c in measured(side("a", mask), side("b", mask)) if c.side == "a"]
    theirs = sorted(regionprops(label(mask)), key=lambda region: region.centroid[0])
    for cell, region in zip(own, theirs, strict=True):
        assert cell.area_mm2 == pytest.approx(region.area * GRID.dz_mm * GRID.dtheta_mm)
        assert cell.z_mm == pytest.approx(GRID.z0_mm + region.centroid[0] * GRID.dz_mm)
        assert cell.theta_rad == pytest.approx(region.centroid[1] * GRID.dtheta_rad, abs=1e-3)


def test_partners_and_what_was_observed() -> None:
    half = SEEN.copy()
    half[:, 256:] = False
    a = side("a", disc(2, 1, 0.3), disc(2, 2.5, 0.2), disc(3, 6, 0.3))
    b = side("b", disc(2.05, 1, 0.3), valid=half, depth=0.2)
    cells = {(c.side, c.id): c for c in measured(a, b)}
    same = next(c for c in cells.values() if c.side == "a" and c.partner == 1)
    assert same.is_matched
    assert same.seen_by == "both"
    # two discs of radius 0.3 whose centres are 0.05 apart: the lens over the union
    lens = 2 * 0.09 * np.arccos(0.05 / 0.6) - 0.025 * np.sqrt(4 * 0.09 - 0.0025)
    assert same.overlap == pytest.approx(lens / (2 * np.pi * 0.09 - lens), abs=0.01)
    assert cells["b", 1].overlap == same.overlap
    # only B has depth; A's cell has it from there, over the part that B found hollow
    assert same.depth_of == "b"
    assert same.depth_median_mm == pytest.approx(0.2)
    unseen = [c for c in cells.values() if c.side == "a" and c.observed_by_other == 0]
    assert len(unseen) == 1
    assert not unseen[0].counts
    assert unseen[0].covered is None
    missed = [c for c in cells.values() if c.side == "a" and c.counts and c.partner is None]
    assert len(missed) == 1
    assert missed[0].covered == 0


def test_depth_by_light_comes_last_and_must_be_known_on_half_of_a_cell() -> None:
    exact = side("a", disc(2, 1, 0.3), depth=0.2)
    shown = disc(2, 1, 0.3), disc(3, 4, 0.3), disc(3, 6, 0.3)
    told = side("b", *shown, depth=0.4)
    relief = np.array(told.relief_mm)
    relief[shown[1] & (GRID.theta_rad < 4 / GRID.radius_mm)] = np.nan  # just half of the second is known
    relief[shown[2] & (GRID.theta_rad < 6.1 / GRID.radius_mm)] = np.nan  # less than half of the third
    told = replace(told, relief_mm=relief, relief_error_mm=np.full(GRID.shape, 0.05, np.float32))
    without = replace(exact, valid=exact.valid & (GRID.theta_rad < 3 / GRID.radius_mm), relief_mm=np.where(
        GRID.theta_rad < 3 / GRID.radius_mm, np.array(exact.relief_mm), np.float32(np.nan)))  # fmt: skip
    both, half, less = sorted((c for c in measured(without, told) if c.side == "b"), key=lambda c: c.theta_rad)
    assert (both.depth_of, both.depth_median_mm) == ("a", pytest.approx(0.2))
    assert (half.depth_of, half.depth_median_mm) == ("b", pytest.approx(0.4))
    assert (both.depth_error_mm, half.depth_error_mm, less.depth_error_mm) == (None, pytest.approx(0.05), None)
    own = [(cell.own_depth_mm, cell.own_depth_error_mm) for cell in (both, half)]
    assert own == [(pytest.approx(0.4), pytest.approx(0.05))] * 2
    assert (less.own_depth_mm, less.own_depth_error_mm) == (None, None)
    assert half.volume_mm3 == pytest.approx(half.area_mm2 * 0.4 * (1 + 0.4 / 2.5), rel=0.02)
    assert less.depth_of is None


def test_a_cell_at_the_end_of_what_was_seen() -> None:
    cells = measured(side("a", disc(1.0, 2, 0.3)), side("b", disc(2.5, 2, 0.3), valid=SEEN & (GRID.theta_rad < 1.65)))
    assert [c.touches_edge for c in cells] == [True, True]


def test_not_aligned_nobody_knows_partners() -> None:
    a, b = side("a", disc(2, 1, 0.3)), side("b", disc(2, 1, 0.3), depth=0.2)
    cells = measure(a, b, GRID, aligned=False)
    assert [(c.partner, c.seen_by, c.depth_of) for c in cells] == [(None, "a", None), (None, "b", "b")]


@settings(max_examples=15, deadline=None)
@given(columns=st.integers(1, 511))
def test_rolling_rolls_places_and_nothing_else(columns: int) -> None:
    a = side("a", disc(2, 1, 0.3), disc(3, 0.1, 0.25), depth=0.2)
    b = side("b", disc(2.1, 1, 0.3))

    def turned(surface: Surface) -> Surface:
        relief = surface.relief_mm
        return replace(
            surface,
            mask=np.roll(surface.mask, columns, axis=1),
            relief_mm=None if relief is None else np.roll(relief, columns, axis=1),
        )

    for before, after in zip(measured(a, b), measured(turned(a), turned(b)), strict=True):
        assert abs(wrap_rad(after.theta_rad - before.theta_rad - columns * GRID.dtheta_rad)) < 1e-9
        same = replace(after, theta_rad=before.theta_rad, z_mm=before.z_mm)
        assert same == replace(before, volume_mm3=same.volume_mm3)
        assert after.volume_mm3 == pytest.approx(before.volume_mm3)


def test_a_table_and_back(tmp_path: Path) -> None:
    error_mm = np.where(GRID.z_mm[:, None] < 2.5, np.float32(0.0625), np.float32(0.125)) + np.zeros_like(
        SEEN, np.float32
    )
    by_light = replace(side("b", disc(2.05, 1, 0.3), depth=0.2), relief_error_mm=error_mm)
    cells = measured(side("a", disc(2, 1, 0.3), disc(3, 3, 0.2)), by_light)
    table = as_numbers(cells, ("a", "b"))
    assert from_numbers(table, ("a", "b")) == cells
    assert [cell.depth_error_mm for cell in cells] == [0.0625, 0.125, 0.0625]
    assert [cell.own_depth_mm for cell in cells] == [None, None, pytest.approx(0.2)]
    later = dict.fromkeys(LATER)
    earlier = from_numbers(table[:, : -len(LATER)], ("a", "b"))
    assert earlier == tuple(replace(cell, **later) for cell in cells)
    for columns in (slice(-1), slice(-len(LATER) - 1)):
        with pytest.raises(EndoctError, match="table of cells cannot be used"):
            from_numbers(table[:, columns], ("a", "b"))
    write_cells(cells, tmp_path / "cells.csv")
    lines = (tmp_path / "cells.csv").read_text().splitlines()
    assert lines[0].startswith("side,id,area_mm2,z_mm,theta_rad,depth_median_mm")
    assert len(lines) == 1 + len(cells)
    assert measured(side("a", ~SEEN), side("b", ~SEEN)) == ()
