"""What a simulated specimen is to be reaches the simulator."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.synthetic.bone.drawn_cells import CutWall
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from endoct.workbench.bench.cases import specimens
from endoct.workbench.bench.cases.specimens import uniform_cells
from endoct.workbench.bench.task import rng_of


def test_the_size_of_cells_reaches_the_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[dict[str, Any]] = []

    def simulate(folder: Path, **arguments: Any) -> None:
        folder.mkdir()
        calls.append(arguments)

    monkeypatch.setattr("endoct.synthetic.specimen.simulate", simulate)
    for difficulties in ({"cell_mm": 0.6, "oct.wall_db": 3.0}, {"oct.wall_db": 3.0}):
        specimens.simulated("learning", 5, 0, difficulties).cleanup()
    sample, none = Sample.model_validate(calls[0]["sample"]), calls[1]["sample"]
    assert none is None
    assert {round(cell.diameter_mm / math.sqrt(math.cos(cell.lean_rad)), 6) for cell in sample.bore.cells} == {0.6}
    usual = draw("learning", 5, ranges={"oct.wall_db": (3.0, 3.0)})
    assert sample.bore.cells != usual.bore.cells
    assert sample.model_copy(update={"bore": usual.bore}) == usual  # all else is what it is without that range


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
