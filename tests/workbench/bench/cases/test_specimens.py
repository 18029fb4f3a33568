"""What a simulated specimen is to be reaches the simulator."""

import math
from pathlib import Path
from typing import Any

import pytest

from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from endoct.workbench.bench.cases import specimens


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
