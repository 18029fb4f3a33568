"""Bars of what is missing, and scores by kinds of cells: what is drawn, and what the caption says."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from endoct.fusion.result import Budget, Limits, Strata
from endoct.workbench.report.figures import agreement
from endoct.workbench.report.figures.agreement import draw_budget, draw_scores


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """What is drawn, not rendered."""
    made: list[Figure] = []
    monkeypatch.setattr(agreement, "render", lambda figure, name: made.append(figure) or name)
    return made


def budget(segmentation: float = 0.2, *, known: bool = True) -> Budget:
    part = {"share": 0.1, "interval": (-0.05, 0.25)}
    parts = {"alignment": part, "sampling": part, "visibility": {**part, "interval": None}}
    return Budget.model_validate({
        "one_minus_jaccard": 0.3 + segmentation,
        "parts": {**parts, "segmentation": {"share": segmentation, "interval": None}},
        "alignment_known": known,
        "not_visible": {"camera": {"cells": 2, "area_mm2": 0.5}, "ranger": {"cells": 0, "area_mm2": 0.0}},
        "not_covered": {"camera": 0.004, "ranger": 0.125},
    })  # fmt: skip


def findings(**changed: Any) -> Any:
    sides = SimpleNamespace(name="camera"), SimpleNamespace(name="ranger")
    return SimpleNamespace(**{"aligned": True, "result": SimpleNamespace(budget=budget()), "sides": sides, **changed})


def test_the_bar_is_the_index_and_what_is_missing_of_one(figures: list[Figure]) -> None:
    told = draw_budget(findings())
    assert told is not None
    axes = figures[0].axes[0]
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([0.5, 0.1, 0.1, 0.1, 0.2])
    assert [bar.get_x() for bar in axes.patches] == pytest.approx([0, 0.5, 0.6, 0.7, 0.8])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "alignment 0.100 (−0.050 to 0.250)", "sampling 0.100 (−0.050 to 0.250)", "visibility 0.100",
        "segmentation 0.200",
    ]  # fmt: skip
    assert axes.texts[0].get_text() == "Jaccard index 0.500"
    assert told.caption.endswith(
        "2 cells (0.50 mm²) not visible to camera, 0.12 mm² of cells outside of what ranger observed (in no score)."
    )
    assert "not known" not in told.caption
    assert "negative" not in told.caption


def test_a_negative_rest_takes_from_the_part_before_it(figures: list[Figure]) -> None:
    told = draw_budget(findings(result=SimpleNamespace(budget=budget(-0.05, known=False))))
    assert told is not None
    bars = figures[0].axes[0].patches
    assert [bar.get_width() for bar in bars] == pytest.approx([0.75, 0.1, 0.1, 0.05, 0])
    assert "Segmentation is negative" in told.caption
    assert "The uncertainty of the alignment is not known" in told.caption
    assert draw_budget(findings(aligned=False)) is None
    assert draw_budget(findings(result=SimpleNamespace(budget=None))) is None


def row(low: float | None, to: float | None, jaccard: float | None, interval: Any = None) -> dict[str, Any]:
    return {"from": low, "to": to, "sites": 7, "jaccard": jaccard, "jaccard_interval": interval}


STRATA = Strata.model_validate({
    "diameter_mm": (row(None, 0.3, 0.25), row(0.3, 0.6, 0.5, (0.4, 0.7)), row(0.6, None, None)),
    "contrast": (row(None, 0.4, 0.75),),
})  # fmt: skip


def test_scores_by_kind_have_a_line_each_and_areas_the_limits_of_their_difference(
    figures: list[Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = np.array([[1.0, 2.0], [0.1, 0.2]])
    monkeypatch.setattr(agreement, "areas_mm2", lambda *_: pairs)
    area = Limits(pairs=2, bias=-0.0004, low=-0.19, high=0.158)
    scores = SimpleNamespace(strata=STRATA, area_mm2=area)
    told = draw_scores(findings(result=SimpleNamespace(scores=scores, sides=("camera", "ranger")), cells=()))
    assert told is not None
    kinds, areas = figures[0].axes
    assert [label.get_text() for label in kinds.get_yticklabels()] == [
        "< 0.3   n = 7", "0.3–0.6   n = 7", "≥ 0.6   n = 7", "< 0.4   n = 7",
    ]  # fmt: skip
    assert kinds.get_yticks().tolist() == pytest.approx([1, 2, 3, 5.4])
    drawn = [np.asarray(line.get_xydata()).tolist() for line in kinds.lines]
    assert drawn == [[[0.25, 1]], [[0.4, 2], [0.7, 2]], [[0.5, 2]], [[0.75, pytest.approx(5.4)]]]
    assert [text.get_text() for text in kinds.texts] == ["diameter (mm)", "contrast"]
    assert np.asarray(areas.lines[0].get_xydata()).tolist() == [[1.5, 1.0], [pytest.approx(0.15), 0.1]]
    assert [float(np.asarray(line.get_ydata())[0]) for line in areas.lines[1:]] == [0, -0.0004, -0.19, 0.158]
    assert areas.get_ylabel() == "ranger − camera (mm²)"
    assert "Area of 2 matched whole cells, ranger − camera" in told.caption
    assert told.caption.endswith(
        "mean difference, 0.000 mm². Dashed: between these lie 95 % of the differences, −0.190 to 0.158 mm²."
    )
    monkeypatch.setattr(agreement, "areas_mm2", lambda *_: np.empty((0, 2)))
    draw_scores(findings(result=SimpleNamespace(scores=scores, sides=("camera", "ranger")), cells=()))
    assert len(figures[1].axes) == 1
    nothing = SimpleNamespace(strata=Strata(), area_mm2=None)
    assert draw_scores(findings(result=SimpleNamespace(scores=nothing, sides=("a", "b")), cells=())) is None
