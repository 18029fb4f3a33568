"""Plots of the results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_tasks import row
from matplotlib.figure import Figure

from endoct.workbench.bench.results.plots import draw_plots
from endoct.workbench.bench.results.score_summary import score_names, summarise
from endoct.workbench.bench.task import AnyTask, Task

TASK: AnyTask = Task("one", "", lambda *of: of, lambda *of: {})


def test_success_is_no_score_of_its_own(tmp_path: Path) -> None:
    scores = [{"success": 1.0, "j": k / 9} for k in range(9)]
    rows = [replace(row("main", str(k), "ok", **scores[k]), conditions={"size": float(k)}) for k in range(9)]
    (summary,) = summarise(rows)
    assert summary.ok == 9
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


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """What is drawn, by the name of its file, not written."""
    drawn: dict[str, Figure] = {}
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: drawn.update({Path(path).name: figure}))
    return drawn


def test_the_overview_has_a_line_a_method_with_median_quartiles_and_outcomes(
    figures: dict[str, Figure], tmp_path: Path
) -> None:
    rows = [row("main", str(k), "ok", j=float(k), success=1.0) for k in range(5)]
    rows += [row("other", str(k), "ok" if k else "declined", **({"j": 10.0 * k} if k else {})) for k in range(5)]
    draw_plots(rows, TASK, tmp_path / "plots")
    score, outcomes = figures["overview.png"].axes
    assert [label.get_text() for label in score.get_yticklabels()] == ["main", "other"]
    assert score.get_ylim() == (1.5, -0.5)
    dots, middle, median, *of_other = score.lines
    assert dots.get_xdata().tolist() == [0, 1, 2, 3, 4]
    assert np.abs(dots.get_ydata()).max() < 0.25
    assert [np.asarray(each.get_xydata()).tolist() for each in (middle, median)] == [[[1, 0], [3, 0]], [[2, 0]]]
    assert of_other[0].get_xdata().tolist() == [10, 20, 30, 40]
    assert np.asarray(of_other[1].get_xydata()).tolist() == [[17.5, 1], [32.5, 1]]
    assert [round(bar.get_y() + bar.get_height() / 2, 6) for bar in outcomes.patches] == [0, 1, 0, 1, 0, 1]
    assert [bar.get_width() for bar in outcomes.patches] == pytest.approx([1, 0.8, 0, 0.2, 0, 0])
    assert [bar.get_x() for bar in outcomes.patches] == pytest.approx([0, 0, 1, 0.8, 1, 1])


def test_against_a_condition_are_medians_of_equal_bins_and_shares(figures: dict[str, Figure], tmp_path: Path) -> None:
    """40 cases in 8 bins of 5; j is the size, and each bin's first is declined."""
    rows = [
        replace(
            row("main", str(k), "ok" if k % 5 else "declined", j=float(k), success=float(k >= 20)),
            conditions={"size": float(k), "word": "ab"[k % 2]},
        )
        for k in range(40)
    ]
    draw_plots(rows, TASK, tmp_path / "plots")
    score, success, unanswered = figures["against-size.png"].axes
    bins = [5.0 * k + 2 for k in range(8)]
    curve = score.containers[0]
    assert curve.lines[0].get_xdata() == pytest.approx(bins)
    assert curve.lines[0].get_ydata() == pytest.approx(bins)
    ((low, high),) = [np.array(segment)[:, 1] for segment in curve.lines[2][0].get_segments()[:1]]
    assert (low, high) == (1, 3), "quartiles"
    assert success.containers[0].lines[0].get_ydata() == pytest.approx([0] * 4 + [1] * 4)
    assert unanswered.containers[0].lines[0].get_ydata() == pytest.approx([0.2] * 8)
    assert success.get_ylim() == unanswered.get_ylim() == (-0.03, 1.03)
    answered, declined = score.lines[:2]
    assert answered.get_xdata().tolist() == [k for k in range(40) if k % 5]
    assert len(declined.get_xdata()) == 8
    assert declined.get_markerfacecolor() == "none"
    assert score.get_xlim() == pytest.approx((-0.04 * 39, 39 + 0.04 * 39))
    by_word = figures["against-word.png"].axes[0]
    assert [label.get_text() for label in by_word.get_xticklabels()] == ["a", "b"]
    assert by_word.containers[0].lines[0].get_ydata() == pytest.approx([19, 20])
    assert by_word.get_xlim() == (-0.5, 1.5)


@pytest.mark.parametrize(("least", "most", "scale"), [(1, 101, "log"), (1, 100, "linear"), (0, 1000, "linear")])
def test_scores_over_more_than_two_decades_have_a_logarithmic_axis(
    least: float, most: float, scale: str, figures: dict[str, Figure], tmp_path: Path
) -> None:
    draw_plots([row("main", str(k), "ok", j=float(j)) for k, j in enumerate((least, most))], TASK, tmp_path / "plots")
    assert figures["overview.png"].axes[0].get_xscale() == scale
