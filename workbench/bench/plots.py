"""Draws what methods made of the cases: each score over all cases, and against each condition that varies."""

import math
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.summary import score_names, share, spread
from endoct.workbench.bench.task import DOUBTED, SUCCESS, Task
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
)

LineStyle = Literal["-", "--", "-."]
_MARKERS: tuple[tuple[LineStyle, str], ...] = (("-", "os^D"), ("--", "v<>P"), ("-.", "XphD"))
STYLES: list[tuple[str, str, LineStyle]] = [
    (colour, marker, line)
    for line, markers in _MARKERS
    for marker, colour in zip(markers * 2, (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK), strict=False)
]
MOST_PANELS = 6
FEWEST_IN_BIN, MOST_BINS = 4, 8
OF_ONE = "Jaccard", "precision", "recall", "share"
"""How a task's words for a score begin that lies between 0 and 1."""


def draw_plots(rows: Sequence[Row], task: Task, folder: Path) -> list[Path]:
    """Write ``overview.png`` and a figure for each condition that varies into ``folder``, which is made.

    More methods than there are styles of lines could not be told apart: then ``overview.png`` alone.
    """
    folder.mkdir(parents=True)
    named = score_names(rows, [*task.scores])
    scores = ([name for name in named if name in task.scores] or named)[:MOST_PANELS]
    paths = [_overview(rows, task, scores, folder / "overview.png")]
    conditions = dict.fromkeys(name for row in rows for name in row.conditions)
    for name in conditions if len({row.method for row in rows}) <= len(STYLES) else ():
        values = {row.conditions[name] for row in rows if name in row.conditions}
        if len(values) > 1:
            file = re.sub(r"[^A-Za-z0-9_-]+", "-", name)
            paths.append(_against(rows, task, scores, name, folder / f"against-{file}.png"))
    return paths


def _overview(rows: Sequence[Row], task: Task, scores: Sequence[str], path: Path) -> Path:
    """Draw every answer's scores as a dot, with median and quartiles, a line a method."""
    methods = list(dict.fromkeys(row.method for row in rows))
    with journal_style():
        panels = [*scores, ""]
        n_columns = min(3, len(panels))
        n_rows = math.ceil(len(panels) / n_columns)
        figure = Figure(figsize=(PAGE_WIDTH_IN, n_rows * (0.75 + 0.19 * len(methods)) + 0.3), layout="constrained")
        for k, name in enumerate(panels):
            axes = figure.add_subplot(n_rows, n_columns, k + 1)
            axes.set_yticks(range(len(methods)), methods if k % n_columns == 0 else [])
            axes.set_ylim(len(methods) - 0.5, -0.5)
            if name:
                _dots(axes, rows, methods, name)
                axes.set_title(_titled(name, task))
            else:
                _outcomes(axes, rows, methods)
        return _save(figure, path)


def _dots(axes: Axes, rows: Sequence[Row], methods: Sequence[str], name: str) -> None:
    jitter = np.random.default_rng(0)
    everything = [row.scores[name] for row in rows if name in row.scores]
    for place, method in enumerate(methods):
        values = [row.scores[name] for row in rows if row.method == method and name in row.scores]
        if not values:
            continue
        axes.plot(
            values,
            place + jitter.uniform(-0.25, 0.25, len(values)),
            ".",
            color=SKY,
            markersize=2.5,
            alpha=0.6,
            zorder=1,
        )
        found = spread(values)
        axes.plot([found.low, found.high], [place, place], color=INK, linewidth=2.0, zorder=2)
        axes.plot(found.median, place, "o", color=VERMILION, markersize=4, zorder=3)
    _scale(axes, "x", everything)
    axes.grid(axis="x", linewidth=0.3)


def _outcomes(axes: Axes, rows: Sequence[Row], methods: Sequence[str]) -> None:
    for place, method in enumerate(methods):
        own = [row for row in rows if row.method == method]
        left = 0.0
        for status, colour in (("ok", GREEN), ("declined", ORANGE), ("failed", VERMILION)):
            width = sum(row.status == status for row in own) / len(own)
            axes.barh(place, width, 0.7, left, color=colour, label=status if place == 0 else None)
            left += width
    axes.set_xlim(0, 1)
    axes.set_title("share answered, declined, failed")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=6, frameon=False)


def _against(rows: Sequence[Row], task: Task, scores: Sequence[str], condition: str, path: Path) -> Path:
    """Draw scores, success and how many were not answered against one condition, a curve a method."""
    methods = list(dict.fromkeys(row.method for row in rows))
    rows = [row for row in rows if condition in row.conditions]
    succeeds = any(SUCCESS in row.scores for row in rows)
    panels = [*scores, *([SUCCESS] if succeeds else []), "not answered"]
    n_columns = min(3, len(panels))
    n_rows = math.ceil(len(panels) / n_columns)
    with journal_style():
        figure = Figure(
            figsize=(PAGE_WIDTH_IN, 1.75 * n_rows + 0.25 * math.ceil(len(methods) / 4)), layout="constrained"
        )
        for k, name in enumerate(panels):
            axes = figure.add_subplot(n_rows, n_columns, k + 1)
            for place, method in enumerate(methods):
                own = [row for row in rows if row.method == method]
                _curve(axes, own, condition, name, method, place, len(methods))
            axes.set_title(_titled(name, task))
            axes.grid(linewidth=0.3)
            if name in scores and not task.scores.get(name, name).startswith(OF_ONE):
                _scale(axes, "y", [row.scores[name] for row in rows if name in row.scores])
            else:
                axes.set_ylim(-0.03, 1.03)
            _label(axes, rows, condition)
        handles = [_handle(place, method) for place, method in enumerate(methods)]
        figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
        return _save(figure, path)


def _handle(place: int, method: str) -> Line2D:
    colour, marker, line = STYLES[place % len(STYLES)]
    return Line2D([], [], color=colour, marker=marker, linestyle=line, markersize=3, linewidth=1, label=method)


def _curve(axes: Axes, rows: Sequence[Row], condition: str, name: str, method: str, place: int, n_methods: int) -> None:
    colour, marker, line = STYLES[place % len(STYLES)]
    shift = (place - (n_methods - 1) / 2) / max(1, n_methods - 1)
    at: list[float] = []
    values: list[tuple[float, float, float]] = []
    for x, width, group in _groups(rows, condition):
        if name in (SUCCESS, "not answered"):
            hits = [r.scores.get(SUCCESS, 0) > 0.5 if name == SUCCESS else _warned(r) for r in group]
            found = share(sum(hits), len(hits))
            value = found.k / found.n, found.low, found.high
        else:
            scored = [row.scores[name] for row in group if name in row.scores]
            if not scored:
                continue
            quartiles = spread(scored)
            value = quartiles.median, quartiles.low, quartiles.high
        at.append(x + 0.5 * width * shift)
        values.append(value)
    if not at:
        return
    if name not in (SUCCESS, "not answered"):
        _cases(axes, [row for row in rows if name in row.scores], condition, name, colour, marker)
    middle, low, high = np.transpose(values)
    axes.errorbar(
        at,
        middle,
        np.maximum([middle - low, high - middle], 0),
        color=colour,
        marker=marker,
        linestyle=line if _is_number(rows[0].conditions[condition]) else "none",
        markersize=3,
        linewidth=1,
        elinewidth=0.4,
        label=method,
    )


def _cases(axes: Axes, rows: Sequence[Row], condition: str, name: str, colour: str, marker: str) -> None:
    """Draw every case of a condition that is a number, filled, or hollow where it came with a warning."""
    if not rows or not _is_number(rows[0].conditions[condition]):
        return
    for warned, fill in ((False, colour), (True, "none")):
        own = [row for row in rows if _warned(row) == warned]
        at, values = ([row.conditions[condition] for row in own], [row.scores[name] for row in own])
        axes.plot(
            at, values, marker, color=colour, markerfacecolor=fill, markersize=2.5, markeredgewidth=0.5, alpha=0.5
        )


def _warned(row: Row) -> bool:
    return row.status != "ok" or row.scores.get(DOUBTED, 0.0) > 0.5


def _groups(rows: Sequence[Row], condition: str) -> list[tuple[float, float, list[Row]]]:
    """Return (place, width, rows) of words, or of bins with equally many cases, in order of the condition."""
    if not rows:
        return []
    if not _is_number(rows[0].conditions[condition]):
        words = sorted({str(row.conditions[condition]) for row in rows})
        return [
            (float(k), 0.6, [row for row in rows if row.conditions[condition] == word]) for k, word in enumerate(words)
        ]
    ordered = sorted(rows, key=lambda row: float(row.conditions[condition]))
    values = [float(row.conditions[condition]) for row in ordered]
    if len(set(values)) <= MOST_BINS:
        width = (values[-1] - values[0]) / 40
        return [(value, width, [r for r in rows if r.conditions[condition] == value]) for value in sorted(set(values))]
    n_bins = max(2, min(MOST_BINS, len(ordered) // FEWEST_IN_BIN))
    bins = [[ordered[i] for i in indices] for indices in np.array_split(np.arange(len(ordered)), n_bins)]
    width = (values[-1] - values[0]) / n_bins / 3
    return [(float(np.median([float(r.conditions[condition]) for r in rows])), width, rows) for rows in bins if rows]


def _label(axes: Axes, rows: Sequence[Row], condition: str) -> None:
    axes.set_xlabel(condition if "." in condition else condition.replace("_", " "))
    if _is_number(rows[0].conditions[condition]):
        values = [float(row.conditions[condition]) for row in rows]
        margin = 0.04 * (max(values) - min(values))
        axes.set_xlim(min(values) - margin, max(values) + margin)
    else:
        words = sorted({str(row.conditions[condition]) for row in rows})
        axes.set_xticks(range(len(words)), words)
        axes.set_xlim(-0.5, len(words) - 0.5)


def _is_number(value: float | str) -> bool:
    return not isinstance(value, str)


def _scale(axes: Axes, axis: str, values: Sequence[float]) -> None:
    """Make an axis logarithmic where positive scores span more than two decades."""
    positive = [value for value in values if value > 0]
    if len(positive) == len(values) > 0 and max(values) > 100 * min(values):
        (axes.set_xscale if axis == "x" else axes.set_yscale)("log")


def _titled(name: str, task: Task) -> str:
    usual = {SUCCESS: "share of successes", "not answered": "share declined, failed or said to be doubtful"}
    return "\n".join(textwrap.wrap(task.scores.get(name, usual.get(name, name)), 34))


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=DPI)
    return path
