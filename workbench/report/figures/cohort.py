"""Figures of many comparisons: how areas and counts agree, agreement by kinds of cells, how scores repeat, raters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from endoct.base.arrays import Coordinates
from endoct.fusion.result import Result, Strata, Stratum
from endoct.fusion.scoring.intervals import bland_altman, interval_of
from endoct.workbench.report.figures.agreement import plot_by_kind, plot_differences
from endoct.workbench.report.figures.drawing import (
    BLUE,
    PAGE_WIDTH_IN,
    VERMILION,
    handed_to,
    journal_style,
    new_figure,
    number_decades,
    place,
    render,
    svg_of,
)
from endoct.workbench.report.figures.rendered import Drawn, Rendered

ROW_IN = 0.17
LONGEST_NAME = 42


@dataclass(frozen=True, eq=False)
class Cohort:
    """What figures need of many comparisons, all of the same two sides, ``names``, A first.

    ``areas_mm2``: of matched whole cells, (n, 2); ``repeats``: Jaccard indices by specimen, of those compared twice.
    """

    names: tuple[str, str]
    results: Sequence[Result]
    areas_mm2: Coordinates
    repeats: Mapping[str, Sequence[float]]


def draw_cohort(cohort: Cohort, folder: Path) -> list[Drawn]:
    """Return the figures of a cohort, and write each as SVG into ``folder``, which is there."""

    def keep(figure: Figure, name: str, inked: Bbox) -> None:
        (folder / f"{name}.svg").write_bytes(svg_of(figure, inked))

    figures = []
    for draw in (partial(one, cohort) for one in (_areas, _kinds, _repeats, _raters)):
        if (drawn := draw()) is not None:
            figures.append(drawn)
            with handed_to(keep):
                draw()
    return figures


def _areas(cohort: Cohort) -> Drawn | None:
    (a, b), areas_mm2 = cohort.names, cohort.areas_mm2
    scored = [result.scores.cells for result in cohort.results if result.scores and result.scores.cells]
    counts = np.array([(cells.of_reference, cells.of_other) for cells in scored], np.float64).reshape(-1, 2)
    of_areas, of_counts = bland_altman(*areas_mm2.T), bland_altman(*counts.T)
    if of_areas is None and of_counts is None:
        return None
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 2.2)
        if of_areas is not None:
            axes = place(figure, 0.6, 0.0, 2.7, 1.95)
            plot_differences(
                axes, areas_mm2, of_areas, f"{b} − {a} (mm²)", ("(a) area of matched cells", "mean area (mm²)")
            )
            axes.set_xscale("log")
            number_decades(axes.xaxis)
        if of_counts is not None:
            axes = place(figure, 4.3, 0.0, 2.7, 1.95)
            plot_differences(axes, counts, of_counts, f"{b} − {a}", ("(b) number of cells", "mean number of cells"))
        rendered = render(figure, "areas")
    parts = [
        f"({letter}) {what}: mean difference {limits.bias:.3g}{unit}, 95 % of the differences lie between "
        f"{limits.low:.3g} and {limits.high:.3g}{unit}, of {limits.pairs} {pairs}."
        for letter, what, unit, limits, pairs in (
            ("a", "Area of matched whole cells", " mm²", of_areas, "pairs of cells, those of one bore not independent"),
            ("b", "Cells that both sides observed, by comparison", "", of_counts, "comparisons"),
        )
        if limits is not None
    ]
    caption = f"{b} less {a} against the mean of both (Bland and Altman). {' '.join(parts)}".replace("-", "−")
    return Drawn(rendered, "agreement", "How areas and numbers of cells agree", caption)


def _kinds(cohort: Cohort) -> Drawn | None:
    strata = pooled_strata(
        [result.scores.strata for result in cohort.results if result.scores and result.scores.strata]
    )
    if not strata.by_kind():
        return None
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 2.2)
        plot_by_kind(place(figure, 0.95, 0.0, 5.0, 1.95), strata, "Jaccard index by kind of cell")
        rendered = render(figure, "kinds")
    caption = (
        "The median over comparisons, with its 95 % interval where there are at least five; n places at which either "
        "side shows a cell, in all comparisons together."
    )
    return Drawn(rendered, "agreement", "Agreement by kinds of cells", caption)


def pooled_strata(many: Sequence[Strata]) -> Strata:
    """Return strata with the median index over comparisons, its interval, and the places of all together."""
    kinds: dict[str, tuple[Stratum, ...]] = {}
    for kind in dict.fromkeys(kind for strata in many for kind in strata.by_kind()):
        rows = [row for strata in many for row in strata.by_kind().get(kind, ())]
        limits = sorted({(row.low, row.to) for row in rows}, key=lambda one: (one[0] or 0.0, one[1] or np.inf))
        kinds[kind] = tuple(_pooled([row for row in rows if (row.low, row.to) == one]) for one in limits)
    return Strata(**kinds)


def _pooled(rows: Sequence[Stratum]) -> Stratum:
    known = np.array([row.jaccard for row in rows if row.jaccard is not None], np.float64)
    return rows[0].model_copy(
        update={
            "sites": sum(row.sites for row in rows),
            "jaccard": float(np.median(known)) if known.size else None,
            "jaccard_interval": interval_of(known),
        }
    )


def _repeats(cohort: Cohort) -> Drawn | None:
    if not cohort.repeats:
        return None
    rendered = _dotted(cohort.repeats, "repeats", "Jaccard index of every comparison")
    caption = "Every comparison of a bore that was recorded or drawn more than once, a line a bore; bar: the mean."
    return Drawn(rendered, "repeatability", "How the Jaccard index repeats", caption)


def _raters(cohort: Cohort) -> Drawn | None:
    rows: dict[str, list[float]] = {f"{side}, against a mask": [] for side in cohort.names}
    rows |= {"one rater against another": [], "one rater, drawn twice": []}
    for result in cohort.results:
        for sides in (result.truth or {}).values():
            for side, scores in sides.items():
                if side in cohort.names and scores.jaccard is not None:
                    rows[f"{side}, against a mask"].append(scores.jaccard)
        for pair in result.raters.pairs if result.raters else ():
            if pair.jaccard is not None:
                rows["one rater, drawn twice" if pair.within else "one rater against another"].append(pair.jaccard)
    rows = {name: values for name, values in rows.items() if values}
    if not rows:
        return None
    caption = "Every dot is a mask drawn by hand, or a pair of such masks; bar: the mean."
    rendered = _dotted(rows, "raters", "Jaccard index")
    return Drawn(rendered, "raters", "Against masks drawn by hand", caption)


def _dotted(rows: Mapping[str, Sequence[float]], name: str, title: str) -> Rendered:
    names = [f"…{row[-LONGEST_NAME:]}" if len(row) > LONGEST_NAME else row for row in rows]
    labels = [f"{row}   n = {len(values)}" for row, values in zip(names, rows.values(), strict=True)]
    with journal_style():
        high = max(0.5, ROW_IN * len(rows))
        figure = new_figure(PAGE_WIDTH_IN, high)
        axes = place(figure, 2.6, 0.0, 4.3, high)
        for row, values in enumerate(rows.values()):
            axes.plot(values, [row] * len(values), "o", color=BLUE, markersize=3, alpha=0.7, clip_on=False)
            axes.plot([float(np.mean(values))] * 2, [row - 0.3, row + 0.3], color=VERMILION, linewidth=1.2)
        axes.set_yticks(range(len(rows)), labels)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlim(0, 1)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x", color="#e3e3e3", linewidth=0.4)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.set_title(title, pad=4)
        return render(figure, name)
