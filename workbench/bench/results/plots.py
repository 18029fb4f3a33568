"""Plots of the results: each score over all cases and against each varying condition, and how methods differ.

Methods differ from one of them, case by case.
"""

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from endoct.workbench.bench.results.score_summary import (
    CONDITION,
    SCORE,
    Difference,
    by_method,
    columns_of,
    count_true,
    frame_of,
    score_names,
    share,
    spread,
)
from endoct.workbench.bench.runner import MethodResult
from endoct.workbench.bench.task import DOUBTED, DOWN, OF_ONE, SUCCESS, UP, AnyTask
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
MOST_PANELS = 6
FEWEST_IN_BIN, MOST_BINS = 4, 8
UNANSWERED = "not answered"
_MARKERS: tuple[tuple[LineStyle, str], ...] = (("-", "os^D"), ("--", "v<>P"), ("-.", "XphD"))
MOST_DIFFERENCES = 3


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


def draw_plots(rows: Sequence[MethodResult], task: AnyTask, folder: Path) -> list[Path]:
    """Write ``overview.png`` and a figure for each condition that varies into ``folder``, which is made.

    More methods than there are styles of lines could not be told apart: then ``overview.png`` alone.
    """
    folder.mkdir(parents=True)
    frame = frame_of(rows)
    named = score_names(rows, [*task.scores])
    scores = ([name for name in named if name in task.scores] or named)[:MOST_PANELS]
    paths = [_overview(frame, task, scores, folder / "overview.png")]
    varied = [column for column in columns_of(frame, CONDITION) if frame[column].nunique() > 1]
    for column in varied if len(set(frame["method"])) <= len(STYLES) else ():
        file = re.sub(r"[^A-Za-z0-9_-]+", "-", column.removeprefix(CONDITION))
        paths.append(_against(frame, task, scores, column, folder / f"against-{file}.png"))
    return paths


def _overview(frame: pd.DataFrame, task: AnyTask, scores: Sequence[str], path: Path) -> Path:
    """Draw every answer's scores as a dot, with median and quartiles, a line a method."""
    methods = list(dict.fromkeys(frame["method"]))
    with journal_style():
        figure, panels = _panels(len(scores) + 1, 0.75 + 0.19 * len(methods), 0.3)
        for k, axes in enumerate(panels):
            axes.set_yticks(range(len(methods)), methods if k % 3 == 0 else [])
            axes.set_ylim(len(methods) - 0.5, -0.5)
        for name, axes in zip(scores, panels, strict=False):
            _dots(axes, frame, f"{SCORE}{name}")
            axes.set_title(_title(name, task))
        _outcomes(panels[-1], frame)
        figure.savefig(path, dpi=DPI)
    return path


def _panels(n: int, row_in: float, more_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``n`` panels, three in a row of the height ``row_in``, and these."""
    n_columns = min(3, n)
    n_rows = math.ceil(n / n_columns)
    figure = Figure(figsize=(PAGE_WIDTH_IN, n_rows * row_in + more_in), layout="constrained")
    return figure, [figure.add_subplot(n_rows, n_columns, k + 1) for k in range(n)]


def _dots(axes: Axes, frame: pd.DataFrame, column: str) -> None:
    jitter = np.random.default_rng(0)
    for place, (_, own) in enumerate(by_method(frame)):
        values = own[column].dropna()
        if values.empty:
            continue
        at = place + jitter.uniform(-0.25, 0.25, len(values))
        axes.plot(values, at, ".", color=SKY, markersize=2.5, alpha=0.6, zorder=1)
        middle = spread(values)
        axes.plot([middle.low, middle.high], [place, place], color=INK, linewidth=2.0, zorder=2)
        axes.plot(middle.median, place, "o", color=VERMILION, markersize=4, zorder=3)
    _scale(axes, "x", frame[column])
    axes.grid(axis="x", linewidth=0.3)


def _outcomes(axes: Axes, frame: pd.DataFrame) -> None:
    for place, (_, own) in enumerate(by_method(frame)):
        left = 0.0
        for status, colour in (("ok", GREEN), ("declined", ORANGE), ("failed", VERMILION)):
            width = float((own["status"] == status).mean())
            axes.barh(place, width, 0.7, left, color=colour, label=status if place == 0 else None)
            left += width
    axes.set_xlim(0, 1)
    axes.set_title("share answered, declined, failed")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=6, frameon=False)


def _against(frame: pd.DataFrame, task: AnyTask, scores: Sequence[str], condition: str, path: Path) -> Path:
    """Draw scores, success and how many were not answered against one condition, a curve a method."""
    methods = list(dict.fromkeys(frame["method"]))
    frame = frame[frame[condition].notna()]
    named = [*scores, *([SUCCESS] if frame.get(f"{SCORE}{SUCCESS}", pd.Series()).notna().any() else []), UNANSWERED]
    with journal_style():
        figure, panels = _panels(len(named), 1.75, 0.25 * math.ceil(len(methods) / 4))
        for name, axes in zip(named, panels, strict=True):
            for place, method in enumerate(methods):
                shift = (place - (len(methods) - 1) / 2) / max(1, len(methods) - 1)
                _curve(axes, frame[frame["method"] == method], condition, name, STYLES[place], shift)
            axes.set_title(_title(name, task))
            axes.grid(linewidth=0.3)
            if name in scores and not task.scores.get(name, name).startswith(OF_ONE):
                _scale(axes, "y", frame[f"{SCORE}{name}"])
            else:
                axes.set_ylim(-0.03, 1.03)
            _label(axes, frame, condition)
        handles = [
            Line2D([], [], label=method, **style.options) for style, method in zip(STYLES, methods, strict=False)
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
        figure.savefig(path, dpi=DPI)
    return path


def _curve(axes: Axes, own: pd.DataFrame, condition: str, name: str, style: Style, shift: float) -> None:
    """Draw one method's curve; ``shift``, −0.5 to 0.5, keeps the methods' bars apart."""
    at: list[float] = []
    values: list[tuple[float, float, float]] = []
    for x, width, group in _groups(own, condition):
        if name in (SUCCESS, UNANSWERED):
            hits = count_true(group, SUCCESS) if name == SUCCESS else int(_doubtful(group).sum())
            part = share(hits, len(group))
            value = part.k / part.n, part.low, part.high
        else:
            scored = group[f"{SCORE}{name}"].dropna()
            if scored.empty:
                continue
            quartiles = spread(scored)
            value = quartiles.median, quartiles.low, quartiles.high
        at.append(x + 0.5 * width * shift)
        values.append(value)
    if not at:
        return
    numeric = _is_numeric(own, condition)
    if numeric and name not in (SUCCESS, UNANSWERED):
        _cases(axes, own, condition, f"{SCORE}{name}", style)
    middle, low, high = np.transpose(values)
    options = {**style.options, "elinewidth": 0.4} | ({} if numeric else {"linestyle": "none"})
    axes.errorbar(at, middle, np.maximum([middle - low, high - middle], 0), **options)


def _cases(axes: Axes, own: pd.DataFrame, condition: str, score: str, style: Style) -> None:
    """Draw every case, filled, or hollow where it was declined or doubted."""
    doubtful = _doubtful(own)
    options: dict[str, Any] = {"color": style.colour, "markersize": 2.5, "markeredgewidth": 0.5, "alpha": 0.5}
    for group, fill in ((own[~doubtful], style.colour), (own[doubtful], "none")):
        axes.plot(group[condition].astype(float), group[score], style.marker, markerfacecolor=fill, **options)


def _doubtful(frame: pd.DataFrame) -> "pd.Series[bool]":
    doubtful = frame["status"] != "ok"
    return doubtful | (frame[f"{SCORE}{DOUBTED}"] > 0.5) if f"{SCORE}{DOUBTED}" in frame else doubtful


def _groups(own: pd.DataFrame, condition: str) -> Iterator[tuple[float, float, pd.DataFrame]]:
    """Yield (place, width, lines) of words, or of bins with equally many cases, in order of the condition."""
    if own.empty:
        return
    if not _is_numeric(own, condition):
        for k, (_, group) in enumerate(own.groupby(condition)):
            yield float(k), 0.6, group
        return
    ordered = own.assign(**{condition: own[condition].astype(float)}).sort_values(condition, kind="stable")
    values = ordered[condition]
    extent = float(values.iloc[-1] - values.iloc[0])
    if values.nunique() <= MOST_BINS:
        for value, group in ordered.groupby(condition):
            yield float(str(value)), extent / 40, group
        return
    n_bins = max(2, min(MOST_BINS, len(ordered) // FEWEST_IN_BIN))
    for places in np.array_split(np.arange(len(ordered)), n_bins):
        group = ordered.iloc[places]
        yield float(group[condition].median()), extent / n_bins / 3, group


def _label(axes: Axes, frame: pd.DataFrame, condition: str) -> None:
    name = condition.removeprefix(CONDITION)
    axes.set_xlabel(name if "." in name else name.replace("_", " "))
    if _is_numeric(frame, condition):
        values = frame[condition].astype(float)
        margin = 0.04 * (values.max() - values.min())
        axes.set_xlim(values.min() - margin, values.max() + margin)
    else:
        words = sorted(frame[condition].unique())
        axes.set_xticks(range(len(words)), words)
        axes.set_xlim(-0.5, len(words) - 0.5)


def _is_numeric(frame: pd.DataFrame, condition: str) -> bool:
    return not isinstance(frame[condition].iloc[0], str)


def _scale(axes: Axes, axis: str, values: "pd.Series[float]") -> None:
    """Make an axis logarithmic where positive scores span more than two decades."""
    values = values.dropna()
    if not values.empty and values.min() > 0 and values.max() > 100 * values.min():
        axes.set(**{f"{axis}scale": "log"})
        number_decades(axes.xaxis if axis == "x" else axes.yaxis, within=(1.0,))


def _title(name: str, task: AnyTask) -> str:
    usual = {SUCCESS: "share of successes", UNANSWERED: "share declined, failed or called doubtful"}
    return "\n".join(textwrap.wrap(task.scores.get(name, usual.get(name, name)), 34))


def draw_differences(differing: Sequence[Difference], reference: str, task: AnyTask, path: Path) -> None:
    """Draw the differences as bars with quartiles, the largest first (by the first score), up and down on one line."""
    scores = list(dict.fromkeys(one.score for one in differing))[:MOST_DIFFERENCES]
    sizes = dict.fromkeys((_line(one.method) for one in differing), 0.0)
    for one in differing:
        if one.score == scores[0]:
            sizes[_line(one.method)] = max(sizes[_line(one.method)], abs(one.spread.median))
    lines = sorted(sizes, key=lambda line: -sizes[line])
    with journal_style():
        figure = Figure(figsize=(PAGE_WIDTH_IN, 0.9 + 0.17 * len(lines)), layout="constrained")
        panels = figure.subplots(1, len(scores), sharey=True, squeeze=False)[0]
        for axes, score in zip(panels, scores, strict=True):
            _bars(axes, [one for one in differing if one.score == score], lines)
            axes.set_title("\n".join(textwrap.wrap(task.scores.get(score, score), 32)), fontsize=7)
        panels[0].set_yticks(range(len(lines)), lines)
        panels[0].set_ylim(len(lines) - 0.5, -0.5)
        n = max(one.spread.n for one in differing)
        figure.suptitle(f"Median difference from {reference}, with quartiles, over {n} cases", fontsize=8)
        if any(_direction(one.method) for one in differing):
            handles = [Patch(color=BLUE, label="up"), Patch(color=ORANGE, label="down")]
            figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
        figure.savefig(path, dpi=DPI)


def _bars(axes: Axes, differing: Sequence[Difference], lines: Sequence[str]) -> None:
    for one in differing:
        shift, thickness = {"": (0.0, 0.7), UP: (-0.2, 0.38), DOWN: (0.2, 0.38)}[_direction(one.method)]
        at = lines.index(_line(one.method)) + shift
        axes.barh(at, one.spread.median, thickness, color=ORANGE if one.method.endswith(DOWN) else BLUE)
        axes.plot([one.spread.low, one.spread.high], [at, at], color=INK, linewidth=0.8)
    axes.axvline(0, color=INK, linewidth=0.6)
    axes.grid(axis="x", linewidth=0.3)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel("difference")


def _direction(method: str) -> str:
    return next((ending for ending in (UP, DOWN) if method.endswith(ending)), "")


def _line(method: str) -> str:
    return method.removesuffix(_direction(method))
