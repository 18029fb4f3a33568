"""Printing to the console: lines for people and JSON for machines to stdout, progress to stderr."""

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from endoct.stitching.errors import visible
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.running.progress import ConsoleStages, SilentStages, Stages
from endoct.workbench.running.refusals import visible_lines
from endoct.workbench.running.status import DONE, NOT_ALIGNED


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


def print_result(folder: Path, *, as_json: bool) -> int:
    """Print the result of the comparison in ``folder``; return the exit status."""
    from endoct.fusion.files.result_file import read_result  # loads what only a comparison needs

    result = read_result(folder)
    if as_json:
        print_json(result.to_json())
    elif result.jaccard is not None and result.dice is not None:
        print_line(f"Jaccard index {result.jaccard:.3f}, Dice {result.dice:.3f} ({' and '.join(result.sides)})")
    elif result.aligned:
        print_line(f"aligned, but there is nothing to score ({' and '.join(result.sides)})")
    else:
        print_line(f"not aligned: {result.reason}")
    if not as_json:
        from endoct.workbench.report.doubts import on_the_whole

        for doubt in on_the_whole(result) if result.aligned else ():
            print_line(f"not trusted: {doubt}")
        for side, notes in result.notes.items():
            for note in notes:
                print_line(f"not trusted ({side}): {note}")
        print_line(f"report: {folder / 'report.html'}")
    return DONE if result.aligned else NOT_ALIGNED


def command_stages(as_json: bool) -> Stages:
    """Return what displays the progress of a command; nothing is displayed where a program reads its JSON."""
    # progress goes to stderr, so that stdout can be piped
    console = TextConsole(stderr=True)
    return SilentStages() if as_json and not console.is_terminal else ConsoleStages(console)


def print_line(line: str) -> None:
    """Print one line, however long, unbroken."""
    TextConsole().print(visible(line), soft_wrap=True)


def print_json(value: object) -> None:
    """Print ``value`` as JSON, escaped where the terminal's encoding lacks letters."""
    has_all_letters = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    print(json_text(value) if has_all_letters else json.dumps(value, indent=1))  # noqa: T201
