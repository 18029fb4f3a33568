"""Draws how methods differ from one of them, case by case."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from endoct.workbench.bench.results.differences import Difference
from endoct.workbench.bench.task import DOWN, UP, AnyTask
from endoct.workbench.report.figures.drawing import BLUE, DPI, INK, ORANGE, PAGE_WIDTH_IN, journal_style

MOST_PANELS = 3


def draw_differences(differing: Sequence[Difference], reference: str, task: AnyTask, path: Path) -> None:
    """Draw the differences as bars with quartiles, the largest first (by the first score), up and down on one line."""
    scores = list(dict.fromkeys(one.score for one in differing))[:MOST_PANELS]
    lines = _lines(differing, scores[0])
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


def _lines(differing: Sequence[Difference], score: str) -> list[str]:
    size = {_line(one.method): 0.0 for one in differing}
    for one in differing:
        if one.score == score:
            size[_line(one.method)] = max(size[_line(one.method)], abs(one.spread.median))
    return sorted(size, key=lambda line: -size[line])
