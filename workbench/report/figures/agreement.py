"""How far two sides agree: the budget of what is missing as one bar, and scores by kinds of cells."""

from functools import partial

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from endoct.base.arrays import Coordinates
from endoct.fusion.result import Budget, Limits, Strata
from endoct.fusion.scoring.cells import areas_mm2
from endoct.workbench.report.figures.drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PAGE_WIDTH_IN,
    PAPER,
    SKY,
    VERMILION,
    journal_style,
    new_figure,
    number_decades,
    place,
    render,
)
from endoct.workbench.report.figures.rendered import Drawing, Drawn
from endoct.workbench.report.findings import Findings

CAUSE_COLOURS = {"alignment": SKY, "sampling": ORANGE, "visibility": GREEN, "segmentation": VERMILION}
STRATA_TITLES = {"diameter_mm": "diameter (mm)", "depth_mm": "depth (mm)", "contrast": "contrast"}


def drawings_of_findings(findings: Findings) -> list[Drawing]:
    """Return what draws the cells and scores of a comparison."""
    return [partial(draw, findings) for draw in (draw_budget, draw_scores)]


def draw_budget(findings: Findings) -> Drawn | None:
    """Draw the Jaccard index and what is missing of 1, by causes, as one bar; None where there is no budget."""
    budget = findings.result.budget
    if not findings.aligned or not budget:
        return None
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 0.4)
        axes = place(figure, 0.1, 0.0, PAGE_WIDTH_IN - 0.2, 0.45)
        jaccard = 1 - budget.one_minus_jaccard
        axes.barh(0, jaccard, color=PAPER, edgecolor=INK, linewidth=0.6)
        axes.text(jaccard / 2, 0, f"Jaccard index {jaccard:.3f}", ha="center", va="center")
        entries, left = [], jaccard
        for cause, part in budget.parts.by_cause().items():
            share, interval, colour = part.share, part.interval, CAUSE_COLOURS[cause]
            width = min(max(share, 0.0), 1 - left)  # a negative rest takes from the part before it
            axes.barh(0, width, left=left, color=colour, edgecolor=INK, linewidth=0.6)
            left += width
            between = f" ({_number(interval[0])} to {_number(interval[1])})" if interval else ""
            entries.append(Patch(facecolor=colour, edgecolor=INK, label=f"{cause} {_number(share)}{between}"))
        axes.set_xlim(0, 1)
        axes.set_ylim(-0.5, 0.5)
        axes.set_yticks([])
        axes.set_xlabel("share of the area that either side calls cell")
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.legend(
            handles=entries, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=5.2, ncols=2, frameon=False,
            handlelength=1.2,
        )  # fmt: skip
        rendered = render(figure, "budget")
    return Drawn(rendered, "agreement", "What stands in the way of full agreement", _budget_caption(budget))


def _budget_caption(budget: Budget) -> str:
    caption = (
        "On the common grid, where both observed the wall. Alignment: what its likely error costs. Sampling: what it "
        "costs that each side has samples at other places. Visibility: cells of one side of which the other shows no "
        "trace. Segmentation: the rest, such as cells that one side misses or outlines differently, and what a "
        "rotation, a shift and a scale cannot bring together. In brackets: 95 % intervals. "
    )
    if not budget.alignment_known:
        caption += "The uncertainty of the alignment is not known: what it costs counts as segmentation. "
    if budget.parts.segmentation.share < 0:
        caption += "Segmentation is negative: the causes before it predict more loss than there is. "
    invisible = [
        f"{of.cells} cell{'s' if of.cells != 1 else ''} ({of.area_mm2:.2f} mm²) not visible to {name}"
        for name, of in budget.not_visible.items()
        if of.cells
    ]
    uncovered = [
        f"{area:.2f} mm² of cells outside of what {name} observed"
        for name, area in budget.not_covered.items()
        if area >= 0.005
    ]
    text_after = ", ".join([*invisible, *(f"{text} (in no score)" for text in uncovered)])
    return caption + (f"{text_after[0].upper()}{text_after[1:]}." if text_after else "")


def draw_scores(findings: Findings) -> Drawn | None:
    """Draw the Jaccard index by kinds of cells, and how areas of matched cells agree; None without scores."""
    scores = findings.result.scores
    if not findings.aligned or scores is None or scores.strata is None or not scores.strata.by_kind():
        return None
    pairs = areas_mm2(*findings.result.sides, findings.cells)
    area = scores.area_mm2 if pairs.size else None
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 2.2)
        plot_by_kind(
            place(figure, 0.95, 0.0, 3.1 if area else 6.1, 1.95), scores.strata, "(a) Jaccard index by kind of cell"
        )
        if area:
            axes = place(figure, 4.7, 0.0, 2.45, 1.95)
            a, b = (side.name for side in findings.sides)
            plot_differences(axes, pairs, area, f"{b} − {a} (mm²)", ("(b) area of matched cells", "mean area (mm²)"))
            axes.set_xscale("log")
            number_decades(axes.xaxis)
        rendered = render(figure, "scores")
    caption = (
        "(a) Jaccard index over n places at which either side shows a cell, with its 95 % interval where n is at "
        "least five: by the diameter of the place, and by its median depth and contrast where a side knows them."
    )
    if area:
        a, b = (side.name for side in findings.sides)
        caption += (
            f" (b) Area of {area.pairs} matched whole cells, {b} − {a}, against the mean of both (Bland and Altman). "
            f"Line: mean difference, {_number(area.bias)} mm². Dashed: between these lie 95 % of the differences, "
            f"{_number(area.low)} to {_number(area.high)} mm²."
        )
    return Drawn(rendered, "agreement", "Agreement by kinds of cells", caption)


def plot_by_kind(axes: Axes, strata: Strata, title: str) -> None:
    """Plot the Jaccard index of every stratum with its interval, a line each."""
    place, ticks, names = 0.0, [], []
    for kind, rows in strata.by_kind().items():
        axes.text(-0.02, place, STRATA_TITLES[kind], ha="right", va="center", fontweight="bold", fontsize=7.0)
        place += 1
        for row in rows:
            ticks.append(place)
            names.append(f"{_range(row.low, row.to)}   n = {row.sites}")
            if row.jaccard is not None:
                if row.jaccard_interval:
                    axes.plot(row.jaccard_interval, [place, place], color=BLUE, linewidth=1.4, solid_capstyle="butt")
                axes.plot(row.jaccard, place, "o", color=BLUE, markersize=4, clip_on=False)
            place += 1
        place += 0.4
    axes.set_ylim(place - 0.6, -0.8)
    axes.set_xlim(0, 1)
    axes.set_yticks(ticks, names)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#e3e3e3", linewidth=0.4)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_title(title, pad=4)
    axes.set_xlabel("Jaccard index")


def plot_differences(axes: Axes, pairs: Coordinates, limits: Limits, differs: str, titles: tuple[str, str]) -> None:
    """Plot ``pairs`` (n, 2) as Bland and Altman do: the second less the first, against the mean of both.

    ``differs`` names the difference; ``titles`` are that of the plot, and what the mean is.
    """
    axes.plot(pairs.mean(axis=1), pairs[:, 1] - pairs[:, 0], "o", color=INK, markersize=2.5)
    axes.axhline(0, color="#b0b0b0", linewidth=0.6)
    axes.axhline(limits.bias, color=VERMILION, linewidth=1.0)
    for limit in (limits.low, limits.high):
        axes.axhline(limit, color=VERMILION, linewidth=0.8, linestyle="--")
    axes.set_title(titles[0], pad=4)
    axes.set_xlabel(titles[1])
    axes.set_ylabel(differs)
    axes.spines[["top", "right"]].set_visible(False)


def _range(low: float | None, high: float | None) -> str:
    if low is None:
        return f"< {high:g}"
    return f"≥ {low:g}" if high is None else f"{low:g}–{high:g}"


def _number(value: float) -> str:
    return f"{value if abs(value) >= 0.0005 else 0.0:.3f}".replace("-", "−")
