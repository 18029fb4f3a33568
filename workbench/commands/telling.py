"""What commands print: lines for people to stdout, JSON for machines, progress to stderr."""

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
    """A console that shows texts as they are, whoever wrote them: no markup in them, nothing that steers a terminal.

    What it means that a reader went away it leaves to the entry point.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Render what is printed, and every cell of a table; only lines still end."""
        return super().render_str(visible_lines(text), **options)

    def on_broken_pipe(self) -> None:
        """Raise what was caught."""
        raise BrokenPipeError


def tell_result(folder: Path, *, as_json: bool) -> int:
    """Print what came of the comparison in ``folder``; return the exit status that says so."""
    from endoct.fusion.files.result_file import read_result  # loads what only a comparison needs

    result = read_result(folder)
    if as_json:
        print_json(result.to_json())
    elif result.jaccard is not None and result.dice is not None:
        say(f"Jaccard index {result.jaccard:.3f}, Dice {result.dice:.3f} ({' and '.join(result.sides)})")
    elif result.aligned:
        say(f"aligned, but there is nothing to score ({' and '.join(result.sides)})")
    else:
        say(f"not aligned: {result.reason}")
    if not as_json:
        from endoct.workbench.report.doubts import on_the_whole

        for doubt in on_the_whole(result) if result.aligned else ():
            say(f"not trusted: {doubt}")
        for side, notes in result.notes.items():
            for note in notes:
                say(f"not trusted ({side}): {note}")
        say(f"report: {folder / 'report.html'}")
    return DONE if result.aligned else NOT_ALIGNED


def stages_for(as_json: bool) -> Stages:
    """Return who shows how far a command is; nobody where a program reads along."""
    # progress goes to stderr, so that stdout can be piped
    console = TextConsole(stderr=True)
    return SilentStages() if as_json and not console.is_terminal else ConsoleStages(console)


def say(line: str) -> None:
    """Print one line, however long, as it is."""
    TextConsole().print(visible(line), soft_wrap=True)


def print_json(value: object) -> None:
    """Print ``value`` as JSON that the terminal's encoding has letters for."""
    everywhere = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    print(json_text(value) if everywhere else json.dumps(value, indent=1))  # noqa: T201
