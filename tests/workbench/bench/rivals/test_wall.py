"""Rivals of the task "wall": sides joined by rules, and OCT interpolated between its rows."""

from dataclasses import replace

import numpy as np
import pytest
from wall_sides import GRID, disc, sides

from endoct.workbench.bench.rivals.baselines import all_wall_cells, no_wall_cells
from endoct.workbench.bench.rivals.wall import (
    believed,
    endoscope,
    intersection,
    kriged,
    linear,
    mean_of_distances,
    oct_alone,
    oct_kriged,
    oct_linear,
    staple,
    union,
)
from endoct.workbench.bench.tasks.wall import ShownPair

SMALL, LARGE = disc(2.5, 0.05, 0.2), disc(2.5, 0.05, 0.4)
PARALLAX_MM = np.full(GRID.shape, 0.7, np.float32)
SHOWN = ShownPair(sides(SMALL, LARGE, parallax_mm=PARALLAX_MM), np.ones(GRID.shape, np.float32), 0)


def test_sides_are_joined_by_their_rules() -> None:
    assert np.array_equal(endoscope(SHOWN).cells, SMALL)
    assert np.array_equal(endoscope(SHOWN).relief_mm, PARALLAX_MM)
    assert np.array_equal(oct_alone(SHOWN).cells, LARGE)
    assert np.array_equal(union(SHOWN).cells, LARGE)
    assert np.array_equal(intersection(SHOWN).cells, SMALL)
    for join in (oct_alone, union, intersection):
        assert join(SHOWN).relief_mm is SHOWN.sides.relief_mm
    between = mean_of_distances(SHOWN).cells
    assert between.sum() == pytest.approx(disc(2.5, 0.05, 0.3).sum(), rel=0.06)  # over the seam


def test_what_is_had_for_nothing_is_no_cell_or_one_of_all() -> None:
    nothing, constant = no_wall_cells(SHOWN), all_wall_cells(SHOWN)
    assert not nothing.cells.any()
    assert (nothing.relief_mm == 0).all()
    assert constant.cells.all()
    assert (constant.relief_mm > 0).all()


def test_the_other_side_may_measure_depth() -> None:
    turned = replace(SHOWN.sides, depth_side=0, light_side=1)
    assert np.array_equal(oct_alone(replace(SHOWN, sides=turned)).cells, SMALL)


def test_the_side_is_believed_of_which_endoct_doubts_less() -> None:
    assert np.array_equal(believed(SHOWN).cells, SMALL)
    assert np.array_equal(believed(replace(SHOWN, believed=1)).cells, LARGE)


def test_staple_of_two_raters_lies_between_intersection_and_union() -> None:
    pytest.importorskip("SimpleITK")
    cells = staple(SHOWN).cells
    assert (cells >= SMALL).all()
    assert (cells <= LARGE).all()


def test_a_line_between_rows_and_kriging_keep_rows_and_a_constant() -> None:
    rows = SHOWN.sides.rows
    ramp = np.broadcast_to(rows.z_mm[:, None], rows.relief_mm.shape).astype(np.float32)
    inside = (GRID.z_mm > rows.z_mm[0]) & (GRID.z_mm < rows.z_mm[-1])
    assert np.allclose(linear(ramp, rows, GRID)[inside], GRID.z_mm[inside, None], atol=1e-5)
    assert linear(ramp, rows, GRID).max() <= ramp.max()  # nothing is continued beyond the rows
    noise = np.random.default_rng(2).normal(size=ramp.shape).cumsum(axis=1).astype(np.float32)
    noise -= noise.mean(axis=1, keepdims=True)
    fine = kriged(noise, rows, GRID)
    at = np.searchsorted(GRID.z_mm, rows.z_mm[1:-1])
    assert np.abs(fine[at] - noise[1:-1]).mean() < 0.2 * np.abs(noise).mean()
    lost = np.where(np.arange(GRID.n_theta) < 50, np.float32(np.nan), np.float32(0.2))
    filled = kriged(np.broadcast_to(lost, ramp.shape).copy(), rows, GRID)
    assert np.isnan(filled[:, 25]).all()
    assert np.isfinite(filled[:, 50:]).all()
    assert np.allclose(filled[np.isfinite(filled)], 0.2, atol=1e-4)  # up to the edge of what is known


def test_oct_alone_fills_cells_between_its_rows() -> None:
    for fill in (oct_linear, oct_kriged):
        cells = fill(SHOWN).cells
        assert (cells & LARGE).sum() > 0.8 * LARGE.sum()
        assert (cells & ~LARGE).sum() < 0.2 * LARGE.sum()
    relief_mm = oct_kriged(SHOWN).relief_mm
    assert relief_mm is not None
    assert np.median(relief_mm[SMALL]) == pytest.approx(0.3, abs=0.02)
    assert np.array_equal(oct_linear(SHOWN).relief_mm, SHOWN.sides.relief_mm)
