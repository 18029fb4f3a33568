"""Plots of the results."""

from dataclasses import replace
from pathlib import Path

from bench_tasks import row

from endoct.workbench.bench.results.plots import draw_differences, draw_plots
from endoct.workbench.bench.results.score_summary import differences, score_names, summarise
from endoct.workbench.bench.tasks.ablate import TASK


def test_doubted_answers_are_counted_and_are_no_score(tmp_path: Path) -> None:
    scores = [{"success": 1.0, "doubted": float(k > 6), "j": k / 9} for k in range(9)]
    rows = [replace(row("main", str(k), "ok", **scores[k]), conditions={"size": float(k)}) for k in range(9)]
    (summary,) = summarise(rows)
    assert (summary.ok, summary.doubted) == (9, 2)
    assert score_names(rows, []) == ["j"]
    names = {path.name for path in draw_plots(rows, TASK, tmp_path / "plots")}
    assert names == {"overview.png", "against-size.png"}


def test_a_name_with_half_a_formula_is_drawn_as_it_is(tmp_path: Path) -> None:
    names = r"$\frac{1}{$", "$x$"
    rows = [
        replace(row(name, str(k), "ok", j=10.0**k), conditions={"size": float(k), "$y$": "$"})
        for k in range(4)
        for name in names
    ]
    assert len(draw_plots(rows, TASK, tmp_path / "plots")) == 2
    draw_differences(differences(rows, names[0], ["j"]), names[0], TASK, tmp_path / "differences.png")
    assert (tmp_path / "differences.png").stat().st_size > 1000
