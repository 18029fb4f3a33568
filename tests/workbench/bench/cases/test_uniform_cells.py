"""Bores whose cells are all of one size."""

import math

import numpy as np
import pytest

from endoct.synthetic.bone.cut_wall import CutWall
from endoct.synthetic.draw import draw
from endoct.workbench.bench.cases.specimens import uniform_cells
from endoct.workbench.bench.task import rng_of


@pytest.mark.parametrize("opening_mm", [0.2, 0.5, 1.2])
def test_cells_are_of_the_size_asked_for_and_cut_what_the_bore_wants(opening_mm: float) -> None:
    bore = draw("learning", 3).bore
    cells = uniform_cells(rng_of(3, 0, "test"), bore, opening_mm)
    openings = [cell.diameter_mm / math.sqrt(math.cos(cell.lean_rad)) for cell in cells]
    # a leaning hole of 0.2 mm would be thinner than the simulator drills
    assert opening_mm <= min(openings) + 1e-9
    assert max(openings) <= (opening_mm * 1.11 if opening_mm == 0.2 else opening_mm + 1e-9)
    assert all(0.05 <= cell.depth_mm <= min(1.5, 1.1 * opening_mm) + 1e-9 for cell in cells)
    assert np.std([cell.depth_mm for cell in cells]) > 0.02
    wall = CutWall(bore)
    assert all(wall.take(cell) for cell in cells)
    assert wall.enough
