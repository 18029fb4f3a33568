"""What a simulated specimen is asked to be reaches the simulator, and doubts of a comparison reach the results."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.fusion.segmentation.segment import segment
from endoct.synthetic.bone.opening import CutWall
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.specimen import simulate
from endoct.workbench import unroll
from endoct.workbench.bench import compared, specimens
from endoct.workbench.bench.one_size import cells_of
from endoct.workbench.bench.plots import draw_plots
from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.summary import score_names, summarise
from endoct.workbench.bench.task import Case, rng_of
from endoct.workbench.pipeline.truth import jaccard, load_truth, true_cells, true_pose


@pytest.mark.parametrize("opening_mm", [0.2, 0.5, 1.2])
def test_cells_are_of_the_size_asked_for_and_cut_what_the_bore_wants(opening_mm: float) -> None:
    bore = draw("learning", 3).bore
    cells = cells_of(rng_of(3, 0, "test"), bore, opening_mm)
    openings = [cell.diameter_mm / math.sqrt(math.cos(cell.lean_rad)) for cell in cells]
    # a leaning hole of 0.2 mm would be thinner than the simulator drills
    assert opening_mm <= min(openings) + 1e-9
    assert max(openings) <= (opening_mm * 1.11 if opening_mm == 0.2 else opening_mm + 1e-9)
    assert all(0.05 <= cell.depth_mm <= min(1.5, 1.1 * opening_mm) + 1e-9 for cell in cells)
    assert np.std([cell.depth_mm for cell in cells]) > 0.02
    wall = CutWall(bore)
    assert all(wall.take(cell) for cell in cells)
    assert wall.enough


def test_the_size_of_cells_reaches_the_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, Any]] = []

    def asked_for(folder: Path, **arguments: Any) -> None:
        folder.mkdir()
        asked.append(arguments)

    monkeypatch.setattr("endoct.synthetic.specimen.simulate", asked_for)
    for difficulties in ({"cell_mm": 0.6, "oct.wall_db": 3.0}, {"oct.wall_db": 3.0}):
        specimens.simulated("learning", 5, 0, difficulties).cleanup()
    sample, none = Sample.model_validate(asked[0]["sample"]), asked[1]["sample"]
    assert none is None
    assert {round(cell.diameter_mm / math.sqrt(math.cos(cell.lean_rad)), 6) for cell in sample.bore.cells} == {0.6}
    usual = draw("learning", 5, wishes={"oct.wall_db": (3.0, 3.0)})
    assert sample.bore.cells != usual.bore.cells
    assert sample.model_copy(update={"bore": usual.bore}) == usual  # all else is what it is without that wish


def test_doubts_of_a_comparison_are_scored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compared, "_against_drawn", lambda folder, answer: {"oct_truth": 0.4})
    for doubts, told in (([], 0.0), (["What was taken for cells may be noise."], 1.0)):
        comparison = SimpleNamespace(alignment="there", result={"doubts": {"endoscope": [], "oct": doubts}})
        answer: Any = SimpleNamespace(comparison=comparison)
        scores = compared.judge(Case("one", (), tmp_path, {}), answer)
        assert scores == {"success": 1.0, "doubted": told, "oct_truth": 0.4}


def test_doubted_answers_are_counted_and_are_no_score(tmp_path: Path) -> None:
    rows = [
        Row(
            str(k),
            "main",
            "ok",
            "",
            1.0,
            1.0,
            {"size": float(k)},
            {"success": 1.0, "doubted": float(k > 6), "j": k / 9},
        )
        for k in range(9)
    ]
    (summary,) = summarise(rows)
    assert (summary.ok, summary.doubted) == (9, 2)
    assert score_names(rows, []) == ["j"]
    names = {path.name for path in draw_plots(rows, compared_task(), tmp_path / "plots")}
    assert names == {"overview.png", "against-size.png"}


def compared_task() -> Any:
    from endoct.workbench.bench.ablate import TASK

    return TASK


def test_a_helical_pullback_is_judged_where_it_was_recorded(tmp_path: Path) -> None:
    wishes: dict[str, Any] = {"oct.scan": ("helical",), "bore.bone": ("phantom",), "oct.wall_db": (20.0, 20.0)}
    simulate(tmp_path / "bore", preset="learning", seed=13, wishes=wishes)
    truth, panorama = load_truth(tmp_path / "bore"), unroll(tmp_path / "bore" / "oct")
    pose, cells = true_pose(panorama, truth), segment(panorama)
    scored = {
        shift_mm: jaccard(
            cells, true_cells(truth, replace(pose, z_bore_mm=pose.z_bore_mm + shift_mm), panorama), panorama.valid
        )
        for shift_mm in (-0.1, 0.0, 0.1)  # half a pitch
    }
    assert scored[0.0] > max(scored[-0.1], scored[0.1]) + 0.05
