"""The board: one static page with the standings of all submissions in a folder, where endoct is beaten first."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from endoct.base.arrays import Coordinates
from endoct.base.errors import visible
from endoct.base.files.contents import is_marked, write_marked
from endoct.base.files.output import new_output
from endoct.workbench.bench.published.board_figures import GENERATORS, costs, curves, styles_of
from endoct.workbench.bench.published.definition import Difficulty, Generator, load_definition
from endoct.workbench.bench.published.specimen_set import Entry
from endoct.workbench.bench.published.standings import Entrant, Loss, TaskBoard, read_boards
from endoct.workbench.bench.published.submitted import OURS, PARTS, Scored
from endoct.workbench.bench.results.plots import Style
from endoct.workbench.bench.task import load_task
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.running.outputs import BOARD

PART = "part of endoct"
UNLIKELY = 0.05
"""What is less likely than this is not taken for chance."""
WORDS_OF_STATUS = {"ok": "", "declined": "declined", "failed": "failed", "missing": "missing"}


def write_board(
    folder: Path, output: Path, *, receipts: Path | None = None, overwrite: bool = False
) -> list[TaskBoard]:
    """Write the board of the submissions in ``folder`` as one HTML file that opens offline; return what is on it.

    Raises :class:`endoct.base.errors.EndoctError` where a submission cannot be used, or ``output`` exists.
    """
    boards = read_boards(folder, receipts)
    names, styles = dict.fromkeys(board.set for board in boards), styles_of(boards)
    page = rendered(
        "bench.published/board.html",
        title=", ".join(f"{name}: {load_definition(name).title}" for name in names),
        boards=[_section(board, styles) for board in boards],
        specimens=_specimens(boards),
        visible=visible,
    )
    with new_output(output, BOARD, overwrite=overwrite, is_ours=is_marked) as scratch:
        write_marked(page, scratch)
    return boards


def _section(board: TaskBoard, styles: Mapping[str, Style]) -> dict[str, object]:
    """Return what the template says of one task."""
    parts = {entrant.name for entrant in board.entrants if is_part(entrant)}
    return {
        "board": board,
        "losses": [_sentence(loss, loss.method in parts) for loss in board.losses()],
        "success": load_task(board.task).success,
        "tables": [
            (", ".join(filter(None, (GENERATORS[generator], side))), board.standings(generator, side=side))
            for generator in board.generators
            for side in board.sides(generator)
        ],
        "curves": curves(board, styles),
        "uneven": uneven_difficulty(board),
        "costs": costs(board, styles),
        "specimens": [(GENERATORS[generator], _by_case(board, generator)) for generator in board.generators],
        "origins": [
            [visible(entrant.name), visible(entrant.origin), entrant.file, PART if entrant.name in parts else ""]
            for entrant in board.entrants
        ],
        "runs": _runs(board),
        "parts": parts,
        "number": number,
        "check": _check,
        "interval": interval,
        "ours": OURS,
    }


def _check(entrant: Entrant) -> str:
    """Return how far an entrant's scores were checked, in words."""
    if entrant.checked < 0:
        return "other scores when run again"
    n_specimens = len(entrant.submission.specimens)
    return f"{entrant.checked} of {n_specimens} specimens" if entrant.checked else "not checked"


def is_part(entrant: Entrant) -> bool:
    """Say whether a method is a step of endoct, or endoct with other settings, by the function that it is."""
    return entrant.origin.partition(" ")[0] in PARTS


def _sentence(loss: Loss, of_endoct: bool) -> str:
    name = f"{visible(loss.method)} ({PART})" if of_endoct else visible(loss.method)
    even = f", even in {loss.even}" if loss.even else ""
    where = ", ".join(filter(None, (GENERATORS[loss.generator], loss.side)))
    return (
        f"{name} on {where}: succeeds in {loss.successes[0]} cases, endoct in {loss.successes[1]}; "
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


def uneven_difficulty(board: TaskBoard) -> list[str]:
    """Return where endoct's median is better on harder specimens than on easier ones, and whether that may be chance.

    ``p`` is that of the rank test (Mann and Whitney) of specimens, each with the median of its cases; where there are
    several easier difficulties, the least.
    """
    ours = next((entrant for entrant in board.entrants if entrant.name == OURS), None)
    if ours is None:
        return []
    sentences = []
    for generator in board.generators:
        levels: dict[Difficulty, tuple[float, Coordinates, str]] = {}
        for word in board.difficulties(generator):
            scores: dict[str, list[float]] = {}
            for row in board.rows(ours, generator, word):
                score = board.sign * row.score_of(board.scored.score)
                scores.setdefault(row.specimen, []).append(score if math.isfinite(score) else -math.inf)
            cases = [score for of_specimen in scores.values() for score in of_specimen]
            median, medians = float(np.median(cases)), np.array([np.median(each) for each in scores.values()])
            counted = f"{_counted(len(cases), 'case')} of {_counted(len(scores), 'specimen')}"
            levels[word] = median, medians, f"{word} ones ({number(board.sign * median)}; {counted})"
            easier = [other for other in levels.values() if other[0] < median]
            if easier:
                p = min(float(stats.mannwhitneyu(medians, other[1], method="exact").pvalue) for other in easier)
                sentences.append(
                    f"On {GENERATORS[generator]}, endoct's median is better on {levels[word][2]} than on "
                    f"{' and '.join(other[2] for other in easier)}. "
                    f"By the rank test, p = {p:.2g}{': that may be chance' if p > UNLIKELY else ''}."
                )
    return sentences


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def _specimens(boards: Sequence[TaskBoard]) -> list[tuple[str, list[tuple[str, str, list[list[str]]]]]]:
    """Return each set's title and its specimens: name, generator and difficulty, and a line a case of any task.

    A line says of which task the case is, and which methods succeed and which do not, the best first.
    """
    by_set: dict[str, dict[str, tuple[Entry, list[list[str]]]]] = {}
    for board in boards:
        specimens = by_set.setdefault(f"{board.set}, {board.half} half, {board.size}", {})
        for entry in board.entrants[0].submission.specimens:
            specimens.setdefault(entry.name, (entry, []))
        cases: dict[tuple[str, str], list[tuple[str, Scored]]] = {}
        for entrant in board.entrants:
            for row in entrant.rows:
                cases.setdefault((row.specimen, row.case), []).append((entrant.name, row))
        for (specimen, case), rows in cases.items():
            label = " ".join(filter(None, (board.task, visible(case.removeprefix(specimen).strip("/-")))))
            specimens[specimen][1].append([label, *_by_success(board, rows)])
    return [
        (
            title,
            [
                (visible(entry.name), f"{GENERATORS[entry.generator]}, {entry.difficulty}", lines)
                for entry, lines in given.values()
            ],
        )
        for title, given in by_set.items()
    ]


def _by_success(board: TaskBoard, rows: Sequence[tuple[str, Scored]]) -> list[str]:
    """Return which methods succeed on a case and which do not, with their main scores, the best first."""
    scores = {name: row.score_of(board.scored.score) for name, row in rows}
    ordered = sorted(
        rows, key=lambda pair: -board.sign * scores[pair[0]] if math.isfinite(scores[pair[0]]) else math.inf
    )
    return [
        ", ".join(
            f"{visible(name)} {number(scores[name]) if row.status == 'ok' else WORDS_OF_STATUS[row.status]}"
            for name, row in ordered
            if row.succeeds == success
        )
        or "–"
        for success in (True, False)
    ]


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
