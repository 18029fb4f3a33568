"""Cells that end short along z on the side that sees light are said, and by how much, on which side."""

import numpy as np
import pytest
from wall_sides import GRID, NAMES, disc, sides

from endoct.fusion.wall.short_ends import doubt_of_short_ends, short_ends_mm
from endoct.stitching.grid import SurfaceGrid

CELLS = disc(1.8, 0.1, 0.3) | disc(2.6, 2.0, 0.5) | disc(2.8, 4.0, 0.35) | disc(2.0, 5.3, 0.4)
WHOLE = np.ones(GRID.shape, np.bool_)


def shifted(rows: int) -> np.ndarray:
    """Return the cells moved by so many rows toward larger z."""
    return np.roll(CELLS, rows, axis=0)


def test_ends_that_agree_are_not_short() -> None:
    assert short_ends_mm(sides(CELLS, CELLS)) == (0, 0)
    assert doubt_of_short_ends(sides(CELLS, CELLS), NAMES) is None


def test_an_end_is_short_by_so_much_on_its_side() -> None:
    smaller, larger = short_ends_mm(sides(CELLS & shifted(-8), CELLS))  # 8 rows of 0.02 mm
    assert (smaller, larger) == pytest.approx((0, 0.16), abs=0.021)
    assert short_ends_mm(sides(CELLS & shifted(8), CELLS)) == pytest.approx((larger, smaller), abs=0.021)
    doubt = doubt_of_short_ends(sides(CELLS & shifted(-8), CELLS), NAMES)
    assert doubt is not None
    assert (doubt.code, doubt.side, doubt.unit) == ("cells-end-short", "endoscope", "mm")
    assert doubt.value == pytest.approx(0.16, abs=0.021)
    assert "shorter along z than those of oct, mostly at the end toward larger z" in doubt.what


def test_what_an_alignment_shares_out_between_both_ends_counts_together() -> None:
    short = sides(shifted(4) & shifted(-4), CELLS)  # 0.08 mm at either end
    assert short_ends_mm(short) == pytest.approx((0.08, 0.08), abs=0.021)
    doubt = doubt_of_short_ends(short, NAMES)
    assert doubt is not None
    assert "mostly" not in doubt.what


def test_a_misplacement_is_no_lack_and_longer_cells_are_none() -> None:
    assert short_ends_mm(sides(shifted(6), CELLS)) == pytest.approx((0.12, -0.12), abs=0.021)
    assert doubt_of_short_ends(sides(shifted(6), CELLS), NAMES) is None
    assert sum(short_ends_mm(sides(shifted(4) | shifted(-4), CELLS))) < -0.1


def test_rows_farther_apart_than_the_reach_are_compared_with_their_neighbours() -> None:
    coarse = SurfaceGrid.full_circle(GRID.n_z, GRID.n_theta, z0_mm=0.0, dz_mm=0.5, radius_mm=1.25)
    assert short_ends_mm(sides(CELLS, CELLS, grid=coarse)) == (0, 0)


def test_a_few_ends_say_nothing() -> None:
    one = disc(2.5, 3.0, 0.4)
    assert np.isnan(short_ends_mm(sides(one & np.roll(one, -8, axis=0), one))).all()
    assert doubt_of_short_ends(sides(one & np.roll(one, -8, axis=0), one), NAMES) is None
    unseen = sides(CELLS & shifted(-8), CELLS, observed=(WHOLE, np.zeros(GRID.shape, np.bool_)))
    assert np.isnan(short_ends_mm(unseen)).all()
