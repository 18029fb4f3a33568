"""Plots of the results: each score over all cases, and against each condition that varies."""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from endoct.workbench.bench.results.score_summary import by_method, count_true, score_names, share, spread, values_of
from endoct.workbench.bench.runner import MethodResult
from endoct.workbench.bench.task import OF_ONE, SUCCESS, AnyTask
from endoct.workbench.report.figures.drawing import (
    BLUE,
    DPI,
    GREEN,
    INK,
    ORANGE,
    PAGE_WIDTH_IN,
    PURPLE,
    SKY,
    VERMILION,
    journal_style,
    number_decades,
)

LineStyle = Literal["-", "--", "-."]
Rows = Sequence[MethodResult]
MOST_PANELS = 6
FEWEST_IN_BIN, MOST_BINS = 4, 8
UNANSWERED = "not answered"
SHARES = {SUCCESS: "share of successes", UNANSWERED: "share declined or failed"}
_MARKERS: tuple[tuple[LineStyle, str], ...] = (("-", "os^D"), ("--", "v<>P"), ("-.", "XphD"))


@dataclass(frozen=True)
class Style:
    """How a method's points and lines look."""

    colour: str
    marker: str
    line: LineStyle

    @property
    def options(self) -> dict[str, Any]:
        """Return the same for matplotlib."""
        return {"color": self.colour, "marker": self.marker, "linestyle": self.line, "markersize": 3, "linewidth": 1}


STYLES = [
    Style(colour, marker, line)
    for line, markers in _MARKERS
    for marker, colour in zip(markers * 2, (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK), strict=False)
]


def draw_plots(rows: Rows, task: AnyTask, folder: Path) -> list[Path]:
    """Write ``overview.png`` and a figure for each condition that varies into ``folder``, which is made.

    More methods than there are styles of lines could not be told apart: then ``overview.png`` alone.
    """
    folder.mkdir(parents=True)
    named, methods = score_names(rows, [*task.scores]), by_method(rows)
    scores = ([name for name in named if name in task.scores] or named)[:MOST_PANELS]
    figures = {"overview": _overview(methods, task, scores)}
    for condition in dict.fromkeys(name for row in rows for name in row.conditions):
        varies = len({row.conditions.get(condition) for row in rows} - {None}) > 1
        if varies and len(methods) <= len(STYLES):
            figures[f"against-{re.sub(r'[^A-Za-z0-9_-]+', '-', condition)}"] = _against(rows, task, scores, condition)
    paths = {folder / f"{name}.png": figure for name, figure in figures.items()}
    with journal_style():
        for path, figure in paths.items():
            figure.savefig(path, dpi=DPI)
    return [*paths]


def _overview(methods: Mapping[str, Rows], task: AnyTask, scores: Sequence[str]) -> Figure:
    """Draw every answer's scores as a dot, with median and quartiles, a line a method."""
    with journal_style():
        figure, panels = _panels(len(scores) + 1, 0.75 + 0.19 * len(methods), 0.3)
        for k, axes in enumerate(panels):
            axes.set_yticks(range(len(methods)), [*methods] if k % 3 == 0 else [])
            axes.set_ylim(len(methods) - 0.5, -0.5)
        for name, axes in zip(scores, panels, strict=False):
            _dots(axes, [values_of(own, name) for own in methods.values()])
            axes.set_title(_title(name, task))
        _outcomes(panels[-1], [*methods.values()])
        return figure


def _panels(n: int, row_in: float, more_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``n`` panels, three in a row of the height ``row_in``, and these."""
    n_columns = min(3, n)
    n_rows = math.ceil(n / n_columns)
    figure = Figure(figsize=(PAGE_WIDTH_IN, n_rows * row_in + more_in), layout="constrained")
    return figure, [figure.add_subplot(n_rows, n_columns, k + 1) for k in range(n)]


def _dots(axes: Axes, of_methods: Sequence[Sequence[float]]) -> None:
    jitter = np.random.default_rng(0)
    for place, values in enumerate(of_methods):
        if values:
            at, middle = place + jitter.uniform(-0.25, 0.25, len(values)), spread(values)
            axes.plot(values, at, ".", color=SKY, markersize=2.5, alpha=0.6, zorder=1)
            axes.plot([middle.low, middle.high], [place, place], color=INK, linewidth=2.0, zorder=2)
            axes.plot(middle.median, place, "o", color=VERMILION, markersize=4, zorder=3)
    _scale(axes, "x", [value for values in of_methods for value in values])
    axes.grid(axis="x", linewidth=0.3)


def _outcomes(axes: Axes, methods: Sequence[Rows]) -> None:
    before = np.zeros(len(methods))
    for status, colour in (("ok", GREEN), ("declined", ORANGE), ("failed", VERMILION)):
        shares = np.array([np.mean([row.status == status for row in own]) for own in methods])
        axes.barh(range(len(methods)), shares, 0.7, before, color=colour, label=status)
        before += shares
    axes.set_xlim(0, 1)
    axes.set_title("share answered, declined, failed")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=6, frameon=False)


def _against(rows: Rows, task: AnyTask, scores: Sequence[str], condition: str) -> Figure:
    """Draw scores, success and how many were not answered against one condition, a curve a method."""
    rows = [row for row in rows if condition in row.conditions]
    methods = by_method(rows)
    named = [*scores, *([SUCCESS] if values_of(rows, SUCCESS) else []), UNANSWERED]
    with journal_style():
        figure, panels = _panels(len(named), 1.75, 0.25 * math.ceil(len(methods) / 4))
        for name, axes in zip(named, panels, strict=True):
            for place, own in enumerate(methods.values()):
                shift = (place - (len(methods) - 1) / 2) / max(1, len(methods) - 1)
                _curve(axes, own, condition, name, STYLES[place], shift)
            axes.set_title(_title(name, task))
            axes.grid(linewidth=0.3)
            if name in scores and not task.scores.get(name, name).startswith(OF_ONE):
                _scale(axes, "y", values_of(rows, name))
            else:
                axes.set_ylim(-0.03, 1.03)
            _label(axes, rows, condition)
        pairs = zip(STYLES, methods, strict=False)
        handles = [Line2D([], [], label=method, **style.options) for style, method in pairs]
        figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
        return figure


def _curve(axes: Axes, own: Rows, condition: str, name: str, style: Style, shift: float) -> None:
    """Draw one method's curve; ``shift``, −0.5 to 0.5, keeps the methods' bars apart."""
    points = []
    for x, width, group in _groups(own, condition):
        if name in SHARES:
            part = share(
                count_true(group, SUCCESS) if name == SUCCESS else sum(row.status != "ok" for row in group), len(group)
            )
            points.append((x + width * shift, part.k / part.n, part.low, part.high))
        elif values := values_of(group, name):
            quartiles = spread(values)
            points.append((x + width * shift, quartiles.median, quartiles.low, quartiles.high))
    if not points:
        return
    numeric = _is_numeric(own, condition)
    if numeric and name not in SHARES:
        _cases(axes, own, condition, name, style)
    at, middle, low, high = np.transpose(points)
    options = {**style.options, "elinewidth": 0.4} | ({} if numeric else {"linestyle": "none"})
    axes.errorbar(at, middle, np.maximum([middle - low, high - middle], 0), **options)


def _cases(axes: Axes, own: Rows, condition: str, score: str, style: Style) -> None:
    """Draw every case, filled, or hollow where it was declined."""
    options: dict[str, Any] = {"color": style.colour, "markersize": 2.5, "markeredgewidth": 0.5, "alpha": 0.5}
    for answered, fill in ((True, style.colour), (False, "none")):
        some = [row for row in own if (row.status == "ok") == answered and score in row.scores]
        at, values = [row.conditions[condition] for row in some], values_of(some, score)
        axes.plot(at, values, style.marker, markerfacecolor=fill, **options)


def _groups(own: Rows, condition: str) -> Iterator[tuple[float, float, Rows]]:
    """Yield (place, half a width, rows) of words, or of bins with equally many cases, in order of the condition."""
    if not _is_numeric(own, condition):
        for k, word in enumerate(sorted({str(row.conditions[condition]) for row in own})):
            yield float(k), 0.3, [row for row in own if row.conditions[condition] == word]
        return
    ordered = sorted(own, key=lambda row: float(row.conditions[condition]))
    values = np.array([float(row.conditions[condition]) for row in ordered])
    distinct = np.unique(values)
    if distinct.size <= MOST_BINS:
        bins, width = [np.flatnonzero(values == value) for value in distinct], np.ptp(values) / 80
    else:
        bins = np.array_split(np.arange(values.size), max(2, min(MOST_BINS, values.size // FEWEST_IN_BIN)))
        width = np.ptp(values) / len(bins) / 6
    for places in bins:
        yield float(np.median(values[places])), float(width), [ordered[k] for k in places]


def _label(axes: Axes, rows: Rows, condition: str) -> None:
    axes.set_xlabel(condition if "." in condition else condition.replace("_", " "))
    if _is_numeric(rows, condition):
        values = [float(row.conditions[condition]) for row in rows]
        margin = 0.04 * (max(values) - min(values))
        axes.set_xlim(min(values) - margin, max(values) + margin)
    else:
        words = sorted({str(row.conditions[condition]) for row in rows})
        axes.set_xticks(range(len(words)), words)
        axes.set_xlim(-0.5, len(words) - 0.5)


def _is_numeric(rows: Rows, condition: str) -> bool:
    return not isinstance(rows[0].conditions[condition], str)


def _scale(axes: Axes, axis: str, values: Sequence[float]) -> None:
    """Make an axis logarithmic where positive scores span more than two decades."""
    if values and min(values) > 0 and max(values) > 100 * min(values):
        axes.set(**{f"{axis}scale": "log"})
        number_decades(axes.xaxis if axis == "x" else axes.yaxis, within=(1.0,))


def _title(name: str, task: AnyTask) -> str:
    return "\n".join(textwrap.wrap(task.scores.get(name, SHARES.get(name, name)), 34))
