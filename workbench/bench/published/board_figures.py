"""The figures of the board: success and the main score against difficulty and time, as SVG."""

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from endoct.base.errors import visible
from endoct.workbench.bench.published.standings import Standing, TaskBoard
from endoct.workbench.bench.published.submitted import OURS
from endoct.workbench.bench.results.plots import STYLES, Style
from endoct.workbench.report.figures.drawing import PAGE_WIDTH_IN, journal_style, number_decades

GENERATORS = {"simulator": "endoct's simulator", "second": "the second generator"}


def styles_of(boards: Sequence[TaskBoard]) -> dict[str, Style]:
    """Return how every method of a page looks, in all of its figures: endoct first, then those of most tasks.

    There are fewer styles than methods: two that no figure shows together may look alike. Where a figure shows more
    methods than there are styles, the least used ones repeat.
    """
    methods = [dict.fromkeys(entrant.name for entrant in board.entrants) for board in boards]
    shown_in = Counter(name for names in methods for name in names)
    styles: dict[str, Style] = {}
    for name in sorted(shown_in, key=lambda name: (name != OURS, -shown_in[name])):
        used = Counter(styles[other] for names in methods if name in names for other in names if other in styles)
        styles[name] = min(STYLES, key=lambda style: used[style])
    return styles


def curves(board: TaskBoard, styles: Mapping[str, Style]) -> Markup:
    """Draw the share of successes and the main score against difficulty, a panel a generator and a line a method."""
    generators = board.generators
    with journal_style():
        figure = Figure(figsize=(PAGE_WIDTH_IN, 4.2), layout="constrained")
        panels = figure.subplots(2, len(generators), squeeze=False, sharex="col", sharey="row")
        for column, generator in enumerate(generators):
            words = board.difficulties(generator)
            lines: dict[str, list[Standing]] = {}
            for word in words:
                for standing in board.standings(generator, word):
                    lines.setdefault(standing.entrant.name, []).append(standing)
            for name, points in lines.items():
                _line(panels[0][column], styles[name], name, [point.success.k / point.success.n for point in points])
                _line(panels[1][column], styles[name], name, [point.median for point in points])
            panels[0][column].set(title=GENERATORS[generator], ylim=(-0.03, 1.03))
            panels[1][column].set_xticks(range(len(words)), words)
            if board.scored.better == "lower":
                panels[1][column].set_yscale("log")
                number_decades(panels[1][column].yaxis)
        panels[0][0].set_ylabel("share of successes")
        panels[1][0].set_ylabel(f"median {board.scored.score}")
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
        return _svg(figure)


def _line(axes: Axes, style: Style, name: str, values: Sequence[float]) -> None:
    options = {**style.options, "markersize": 4, "linewidth": 2.2 if name == OURS else 1.0}
    # matplotlib lists no line whose name begins with "_"
    axes.plot(range(len(values)), values, label=visible(name).lstrip("_") or "_", **options)
    axes.grid(axis="y", linewidth=0.3)


def costs(board: TaskBoard, styles: Mapping[str, Style]) -> Markup:
    """Draw the share of successes against seconds a case, a point a method."""
    with journal_style():
        figure = Figure(figsize=(PAGE_WIDTH_IN, 2.4), layout="constrained")
        panels = figure.subplots(1, len(board.generators), squeeze=False, sharey=True)[0]
        for axes, generator in zip(panels, board.generators, strict=True):
            for standing in board.standings(generator):
                style, at = styles[standing.entrant.name], standing.success.k / standing.success.n
                error = [[max(0.0, at - standing.success.low)], [max(0.0, standing.success.high - at)]]
                options: dict[str, Any] = {"color": style.colour, "markersize": 5, "linewidth": 0.6}
                axes.errorbar(max(standing.seconds, 1e-3), at, error, fmt=style.marker, **options)
            axes.set(xscale="log", ylim=(-0.03, 1.03), title=GENERATORS[generator], xlabel="median seconds a case")
            number_decades(axes.xaxis)
            axes.grid(linewidth=0.3)
        panels[0].set_ylabel("share of successes")
        return _svg(figure)


def _svg(figure: Figure) -> Markup:
    """Return a figure as SVG for a page; the same figure gives the same text."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "endoct", "svg.fonttype": "none"}):
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return Markup(drawn.getvalue()[drawn.getvalue().index("<svg") :])
