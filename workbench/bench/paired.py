"""How methods differ from one of them, case by case: the same cases, so that their difficulty cancels."""

import csv
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from rich.table import Table

from endoct.stitching.errors import visible
from endoct.stitching.names import spreadsheet_text
from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.summary import Spread, spread
from endoct.workbench.bench.task import Task
from endoct.workbench.report.figures.drawing import BLUE, DPI, INK, ORANGE, PAGE_WIDTH_IN, journal_style

UP, DOWN = " up", " down"
"""Endings of two methods that share a line."""
MOST_PANELS = 3


@dataclass(frozen=True)
class Difference:
    """A score of a method minus that of the reference, over the cases that have both.

    ``lower`` and ``higher`` count the cases that went either way.
    """

    method: str
    score: str
    spread: Spread
    lower: int
    higher: int


def differences(rows: Sequence[Row], reference: str, scores: Sequence[str]) -> list[Difference]:
    """Return every method's differences from ``reference``, those of the first score first.

    So a method that has no first score, since it was never aligned, changes nothing in the order of the scores.
    """
    base = {row.case: row.scores for row in rows if row.method == reference}
    methods = dict.fromkeys(row.method for row in rows if row.method != reference)
    found = []
    for score, method in product(scores, methods):
        values = [
            row.scores[score] - base[row.case][score]
            for row in rows
            if row.method == method and score in row.scores and score in base.get(row.case, {})
        ]
        if values:
            lower, higher = sum(value < 0 for value in values), sum(value > 0 for value in values)
            found.append(Difference(method, score, spread(values), lower, higher))
    return found


def write_differences(found: Sequence[Difference], reference: str, path: Path) -> None:
    """Write a line a method and score: median and quartiles of the difference, and how many cases went which way."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["method", "against", "score", "cases", "median", "quartile_1", "quartile_3", "lower", "higher"]
        )
        for one in found:
            s = one.spread
            names = [spreadsheet_text(visible(name)) for name in (one.method, reference, one.score)]
            told = [f"{value:.6g}" for value in (s.median, s.low, s.high)]
            writer.writerow([*names, s.n, *told, one.lower, one.higher])


def difference_table(found: Sequence[Difference], reference: str) -> Table:
    """Return the table for the console: median and quartiles of the first scores' differences, a line a method."""
    scores = list(dict.fromkeys(one.score for one in found))[:MOST_PANELS]
    made = Table(f"less {reference}", *scores, "higher/lower/cases", box=None)
    for column in made.columns[1:]:
        column.justify = "right"
    told = {(one.method, one.score): one for one in found}
    for method in dict.fromkeys(one.method for one in found):
        own = [told.get((method, score)) for score in scores]
        shown = [f"{d.spread.median:+.3g} ({d.spread.low:+.3g} to {d.spread.high:+.3g})" if d else "–" for d in own]
        first = own[0]
        made.add_row(method, *shown, f"{first.higher}/{first.lower}/{first.spread.n}" if first else "–")
    return made


def draw_differences(found: Sequence[Difference], reference: str, task: Task, path: Path) -> None:
    """Draw the differences as bars with quartiles, the largest first (by the first score), up and down on one line."""
    scores = list(dict.fromkeys(one.score for one in found))[:MOST_PANELS]
    lines = _lines(found, scores[0])
    with journal_style():
        figure = Figure(figsize=(PAGE_WIDTH_IN, 0.9 + 0.17 * len(lines)), layout="constrained")
        first = None
        for k, score in enumerate(scores):
            axes = figure.add_subplot(1, len(scores), k + 1, sharey=first)
            first = first or axes
            for one in found:
                if one.score != score:
                    continue
                s, down = one.spread, one.method.endswith(DOWN)
                shift = 0.0 if not _direction(one.method) else 0.2 if down else -0.2
                at, thick = lines.index(_line(one.method)) + shift, 0.7 if not _direction(one.method) else 0.38
                axes.barh(at, s.median, thick, color=ORANGE if down else BLUE)
                axes.plot([s.low, s.high], [at, at], color=INK, linewidth=0.8)
            axes.axvline(0, color=INK, linewidth=0.6)
            axes.grid(axis="x", linewidth=0.3)
            axes.locator_params(axis="x", nbins=4)
            axes.set_xlabel("difference")
            axes.set_title("\n".join(textwrap.wrap(task.scores.get(score, score), 32)), fontsize=7)
            axes.tick_params(labelleft=k == 0)
        if first is not None:
            first.set_yticks(range(len(lines)), lines)
            first.set_ylim(len(lines) - 0.5, -0.5)
        n = max(one.spread.n for one in found)
        figure.suptitle(f"Median difference from {reference}, with quartiles, over {n} cases", fontsize=8)
        if any(_direction(one.method) for one in found):
            handles = [Patch(color=BLUE, label="up"), Patch(color=ORANGE, label="down")]
            figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
        figure.savefig(path, dpi=DPI)


def _direction(method: str) -> str:
    return next((ending for ending in (UP, DOWN) if method.endswith(ending)), "")


def _line(method: str) -> str:
    return method.removesuffix(_direction(method))


def _lines(found: Sequence[Difference], score: str) -> list[str]:
    size = {_line(one.method): 0.0 for one in found}
    for one in found:
        if one.score == score:
            size[_line(one.method)] = max(size[_line(one.method)], float(np.abs(one.spread.median)))
    return sorted(size, key=lambda line: -size[line])
