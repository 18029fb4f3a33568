"""Figures of many comparisons: what is plotted, and what the captions say."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import MaskScores, PairScores, Raters, Result, StoredAlignment, Strata
from endoct.fusion.result.scores import RaterPair
from endoct.workbench.report.figures import cohort
from endoct.workbench.report.figures.cohort import Cohort, draw_cohort, pooled_strata
from endoct.workbench.report.figures.rendered import Rendered


def strata(*jaccards: float | None, sites: int = 2) -> Strata:
    limits = ((None, 0.3), (0.3, 0.6), (0.6, None))
    rows = [
        {"from": low, "to": to, "sites": sites, "jaccard": jaccard, "jaccard_interval": None}
        for (low, to), jaccard in zip(limits, jaccards, strict=True)
    ]
    return Strata.model_validate({"diameter_mm": rows})


def result(count_a: int, count_b: int) -> Result:
    kinds = strata(0.1, 0.5, 0.9).model_dump(by_alias=True, exclude_unset=True)
    scores = {"grid": {}, "cells": {"of_reference": count_a, "of_other": count_b}, "strata": kinds}
    alignment = StoredAlignment.of(Alignment(0.0, 0.0, confidence=0.5))
    return Result(
        sides=("eye", "ear"), aligned=True, alignment=alignment, jaccard=0.5, dice=0.6, valid_fraction=1.0,
        scores=PairScores.model_validate(scores),
    )  # fmt: skip


def of(*results: Result, areas: Any = (), repeats: Any = None) -> Cohort:
    return Cohort(("eye", "ear"), results, np.array(areas, np.float64).reshape(-1, 2), repeats or {})


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """What is drawn, not rendered; each twice, as PNG and as SVG."""
    made: list[Figure] = []
    monkeypatch.setattr(cohort, "render", lambda figure, name: made.append(figure) or Rendered(name, 1.0, b"", None))
    return made


def test_areas_and_counts_are_differences_against_means(figures: list[Figure], tmp_path: Path):
    told, _ = draw_cohort(of(result(4, 6), result(8, 8), result(10, 13), areas=[(1, 2), (2, 4), (4, 7)]), tmp_path)
    areas, counts = figures[0].axes
    assert areas.lines[0].get_xydata().tolist() == [[1.5, 1], [3, 2], [5.5, 3]]
    assert counts.lines[0].get_xydata().tolist() == [[5, 2], [8, 0], [11.5, 3]]
    assert counts.lines[2].get_ydata() == pytest.approx([5 / 3, 5 / 3])
    assert (areas.get_xscale(), counts.get_xscale()) == ("log", "linear")
    assert areas.get_ylabel() == "ear − eye (mm²)"
    # bias 2, SD 1
    assert "mean difference 2 mm², 95 % of the differences lie between 0.04 and 3.96 mm², of 3 pairs" in told.caption
    assert "mean difference 1.67, 95 % of the differences lie between −1.33 and 4.66, of 3 comparisons" in told.caption


def test_too_few_are_not_plotted(figures: list[Figure], tmp_path: Path):
    (kinds,) = draw_cohort(of(result(4, 6), result(8, 8), areas=[(1, 2), (2, 4)]), tmp_path)
    assert kinds.rendered.name == "kinds"
    assert draw_cohort(of(), tmp_path) == []


def test_kinds_of_cells_are_pooled_over_comparisons():
    pooled = pooled_strata([strata(0.1, 0.5, None), strata(0.3, 0.6, None, sites=5), strata(0.2, None, None)])
    assert [(row.low, row.to, row.sites, row.jaccard) for row in pooled.diameter_mm] == [
        (None, 0.3, 9, 0.2), (0.3, 0.6, 9, pytest.approx(0.55)), (0.6, None, 9, None),
    ]  # fmt: skip
    assert all(row.jaccard_interval is None for row in pooled.diameter_mm)  # of three
    interval = pooled_strata([strata(0.2, 0.5, 0.9)] * 5).diameter_mm[0].jaccard_interval
    assert interval == (0.2, 0.2)


def test_repeats_and_raters_are_dots_by_line(figures: list[Figure], tmp_path: Path):
    scores = {"eye": MaskScores(jaccard=0.7), "ear": MaskScores(jaccard=None), "nose": MaskScores(jaccard=0.1)}
    pair = {"first": ("a", "1"), "dice": None, "boundary_mean_mm": None, "boundary_p95_mm": None}
    pair |= {"boundary_within_share": None}
    pairs = [
        RaterPair.model_validate({**pair, "second": ("b", "1"), "jaccard": 0.6, "within": False}),
        RaterPair.model_validate({**pair, "second": ("a", "2"), "jaccard": 0.8, "within": True}),
    ]
    raters = Raters.model_construct(pairs=tuple(pairs))
    judged = result(4, 6).model_copy(update={"truth": {"x.png": scores}, "raters": raters, "scores": None})
    drawn = draw_cohort(of(judged, repeats={"bore-1": (0.5, 0.7)}), tmp_path)
    assert [one.section for one in drawn] == ["repeatability", "raters"]
    repeats, raters_drawn = figures[0].axes[0], figures[2].axes[0]
    assert repeats.lines[0].get_xydata().tolist() == [[0.5, 0], [0.7, 0]]
    assert repeats.lines[1].get_xdata() == pytest.approx([0.6, 0.6])  # the mean
    assert [text.get_text() for text in raters_drawn.get_yticklabels()] == [
        "eye, against a mask   n = 1", "one rater against another   n = 1", "one rater, drawn twice   n = 1",
    ]  # fmt: skip
    assert [float(line.get_xdata()[0]) for line in raters_drawn.lines[::2]] == [0.7, 0.6, 0.8]


def test_every_plot_is_an_svg_with_text(tmp_path: Path):
    (kinds,) = draw_cohort(of(result(4, 6)), tmp_path)
    assert kinds.rendered.png.startswith(b"\x89PNG")
    texts = {text.text for text in ElementTree.parse(tmp_path / "kinds.svg").iter("{http://www.w3.org/2000/svg}text")}
    assert "0.3–0.6   n = 2" in texts
