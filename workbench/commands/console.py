"""Printing to the console: lines for people and JSON for machines to stdout, progress to stderr."""

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from endoct.base.doubt import Doubt
from endoct.base.errors import visible
from endoct.workbench.running.outputs import json_text
from endoct.workbench.running.progress import ConsoleStages, SilentStages, Stages
from endoct.workbench.running.refusals import DONE, DOUBTED, NOT_ALIGNED, visible_lines

if TYPE_CHECKING:
    from endoct.fusion.result import Result


class TextConsole(Console):
    """A console that prints texts as they are: nothing in them is markup, and nothing controls the terminal.

    A reader that went away raises ``BrokenPipeError``, for the entry point to handle.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a text, or a cell of a table, with control characters other than newlines written out."""
        return super().render_str(visible_lines(text), **options)

    def on_broken_pipe(self) -> None:
        """Raise the error that is being handled."""
        raise BrokenPipeError


def print_result(folder: Path, *, as_json: bool, strict: bool = False) -> int:
    """Print the result of the comparison in ``folder``; return the exit status, ``strict`` about doubts."""
    from endoct.fusion.files.result_file import read_result  # loads what only a comparison needs

    result = read_result(folder)
    if as_json:
        print_json(result.to_json())
    elif (overlap := result.overlap) is not None and not overlap.is_empty:
        print_line(
            f"Jaccard index {result.jaccard:.3f}, Dice {result.dice:.3f}{_by_li(result)} ({' and '.join(result.sides)})"
        )
    elif result.aligned:
        print_line(f"aligned, but there is nothing to score ({' and '.join(result.sides)})")
    else:
        print_line(f"not aligned: {result.reason}")
    if not as_json:
        if result.bounds is not None:
            print_line(result.bounds.sentence)
        for line in _against_truth(result):
            print_line(line)
        print_doubts(result.doubts, result.notes)
        print_line(f"report: {folder / 'report.html'}")
    return status_of(result.doubts, strict=strict) if result.aligned else NOT_ALIGNED


def print_doubts(doubts: Sequence[Doubt], notes: Mapping[str, Sequence[str]]) -> None:
    """Print a line for each doubt, then for each note; ``notes`` by side, "" where there is only one."""
    for doubt in doubts:
        print_line(f"DOUBT{_of(doubt.side)}: {doubt.what}")
    for side, said in notes.items():
        for note in said:
            print_line(f"note{_of(side)}: {note}")


def status_of(doubts: Sequence[Doubt], *, strict: bool) -> int:
    """Return the exit status of what was done, where any doubt counts if ``strict``."""
    return DOUBTED if strict and doubts else DONE


def _of(side: str | None) -> str:
    return f" ({side})" if side else ""


def _against_truth(result: "Result") -> Iterator[str]:
    """Yield a line for each mask given as truth: how well each side agrees with that."""
    for path, scores in (result.truth or {}).items():
        each = [f"{side} {_index(of_side.jaccard)}" for side, of_side in scores.items()]
        yield f"Jaccard index against {path}: {', '.join(each)}"
    if result.raters:
        each = [f"{side} {_index(of_side.jaccard)}" for side, of_side in result.raters.majority.sides.items()]
        yield f"Jaccard index against what most raters drew: {', '.join(each)}"


def _by_li(result: "Result") -> str:
    """Return "; by Li's threshold alone 0.701 and 0.824"; "" where there is no such index."""
    if result.by_li is None:
        return ""
    grid = result.by_li.grid
    return f"; by Li's threshold alone {_index(grid.jaccard)} and {_index(grid.dice)}"


def _index(jaccard: float | None) -> str:
    return "not known" if jaccard is None else f"{jaccard:.3f}"


def command_stages(as_json: bool) -> Stages:
    """Return what displays the progress of a command; nothing is displayed where a program reads its JSON."""
    # progress goes to stderr, so that stdout can be piped
    console = TextConsole(stderr=True)
    return SilentStages() if as_json and not console.is_terminal else ConsoleStages(console)


def print_line(line: str) -> None:
    """Print one line, however long, unbroken."""
    TextConsole().print(visible(line), soft_wrap=True)


def print_begun(line: str) -> None:
    """Print to stderr what has begun, where it takes seconds until there is anything to print."""
    TextConsole(stderr=True).print(visible(line), soft_wrap=True)


def print_json(value: object) -> None:
    """Print ``value`` as JSON, escaped where the terminal's encoding lacks letters."""
    has_all_letters = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    print(json_text(value) if has_all_letters else json.dumps(value, indent=1))  # noqa: T201


def print_either(facts: object, lines: Iterable[str], *, as_json: bool) -> int:
    """Print ``facts`` as JSON, or else ``lines`` for people; return the exit status."""
    if as_json:
        print_json(facts)
    else:
        for line in lines:
            print_line(line)
    return DONE
