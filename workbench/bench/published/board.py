"""The board: one static page with the standings of all submissions in a folder, where endoct is beaten first."""

import io
import math
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from endoct.base.errors import visible
from endoct.base.files.contents import is_marked, write_marked
from endoct.base.files.output import new_output
from endoct.workbench.bench.published.definition import Generator, load_definition
from endoct.workbench.bench.published.standings import Entrant, Loss, Standing, TaskBoard, read_boards
from endoct.workbench.bench.published.submitted import OURS
from endoct.workbench.bench.results.plots import STYLES, Style
from endoct.workbench.report.figures.drawing import PAGE_WIDTH_IN, journal_style, number_decades
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.running.outputs import BOARD

GENERATORS = {"simulator": "endoct's simulator", "second": "the second generator"}
WORDS_OF_STATUS = {"ok": "", "declined": "declined", "failed": "failed", "missing": "missing"}


def write_board(
    folder: Path, output: Path, *, receipts: Path | None = None, overwrite: bool = False
) -> list[TaskBoard]:
    """Write the board of the submissions in ``folder`` as one HTML file that opens offline; return what is on it.

    Raises :class:`endoct.base.errors.EndoctError` where a submission cannot be used, or ``output`` exists.
    """
    boards = read_boards(folder, receipts)
    names = dict.fromkeys(board.set for board in boards)
    page = rendered(
        "bench.published/board.html",
        title=", ".join(f"{name}: {load_definition(name).title}" for name in names),
        boards=[_section(board) for board in boards],
    )
    with new_output(output, BOARD, overwrite=overwrite, is_ours=is_marked) as scratch:
        write_marked(page, scratch)
    return boards


def _section(board: TaskBoard) -> dict[str, object]:
    """Return what the template says of one task."""
    return {
        "board": board,
        "losses": [_sentence(loss) for loss in board.losses()],
        "tables": [
            (", ".join(filter(None, (GENERATORS[generator], side))), board.standings(generator, side=side))
            for generator in board.generators
            for side in board.sides(generator)
        ],
        "curves": _svg(_curves(board)),
        "costs": _svg(_costs(board)),
        "specimens": [(GENERATORS[generator], _by_case(board, generator)) for generator in board.generators],
        "origins": [[visible(entrant.name), visible(entrant.origin), entrant.file] for entrant in board.entrants],
        "runs": _runs(board),
        "number": number,
        "check": _check,
        "interval": interval,
        "visible": visible,
        "ours": OURS,
    }


def _check(entrant: Entrant) -> str:
    """Return how far an entrant's scores were checked, in words."""
    if entrant.checked < 0:
        return "other scores when run again"
    n_specimens = len(entrant.submission.specimens)
    return f"{entrant.checked} of {n_specimens} specimens" if entrant.checked else "not checked"


def _sentence(loss: Loss) -> str:
    even = f", even in {loss.even}" if loss.even else ""
    where = ", ".join(filter(None, (GENERATORS[loss.generator], loss.side)))
    return (
        f"{visible(loss.method)} on {where}: succeeds in {loss.successes[0]} cases, endoct in {loss.successes[1]}; "
        f"better in {loss.better} cases, worse in {loss.worse}{even} (p = {loss.p:.2g}); "
        f"median {number(loss.theirs)} against {number(loss.ours)} where both answered"
    )


def _by_case(board: TaskBoard, generator: Generator) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Return the names of the entrants, and a line a case: the main score of each, or why there is none."""
    by_case: dict[str, dict[str, str]] = {}
    for entrant in board.entrants:
        for row in board.rows(entrant, generator):
            value = row.scores.get(board.scored.score)
            reason = ": ".join(filter(None, (WORDS_OF_STATUS[row.status], visible(row.reason))))
            by_case.setdefault(row.case, {})[entrant.name] = reason or (number(value) if value is not None else "–")
    names = [entrant.name for entrant in board.entrants]
    return names, [(case, [cells.get(name, "–") for name in names]) for case, cells in by_case.items()]


def _runs(board: TaskBoard) -> list[list[str]]:
    """Return a line a submission: its file, its data, endoct's version, the processor and the hours it took."""
    submissions = {entrant.file: entrant.submission for entrant in board.entrants}
    return [
        [
            file,
            one.data_digest[:16],
            ", ".join(f"{name} {digest}" for name, digest in one.sources.items()),
            ", ".join(f"{name} {one.versions[name]}" for name in ("endoct", "python", "numpy") if name in one.versions),
            f"{one.machine.get('processor', '–')}, {one.machine.get('cores_usable', '–')} cores",
            f"{one.workers}",
            f"{one.seconds / 60:.1f}",
            "; ".join(f"{name}: {reason}" for name, reason in one.left_out.items()) or "–",
        ]
        for file, one in submissions.items()
    ]


def number(value: float) -> str:
    """Return a score with three digits, a dash where there is none."""
    return f"{value:.3g}" if math.isfinite(value) else "–"


def interval(low: float, high: float) -> str:
    """Return an interval, a dash where there is none."""
    return f"{number(low)}–{number(high)}" if math.isfinite(low) and math.isfinite(high) else "–"


def _styles(entrants: Sequence[Entrant]) -> dict[str, Style]:
    return {one.name: style for one, style in zip(entrants, cycle(STYLES), strict=False)}


def _curves(board: TaskBoard) -> Figure:
    """Draw the share of successes and the main score against difficulty, a panel a generator and a line a method."""
    styles, generators = _styles(board.entrants), board.generators
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
        return figure


def _line(axes: Axes, style: Style, name: str, values: Sequence[float]) -> None:
    options = {**style.options, "markersize": 4, "linewidth": 2.2 if name == OURS else 1.0}
    # matplotlib lists no line whose name begins with "_"
    axes.plot(range(len(values)), values, label=visible(name).lstrip("_") or "_", **options)
    axes.grid(axis="y", linewidth=0.3)


def _costs(board: TaskBoard) -> Figure:
    """Draw the share of successes against seconds a case, a point a method."""
    styles = _styles(board.entrants)
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
        return figure


def _svg(figure: Figure) -> Markup:
    """Return a figure as SVG for a page; the same figure gives the same text."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "endoct", "svg.fonttype": "none"}):
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return Markup(drawn.getvalue()[drawn.getvalue().index("<svg") :])
