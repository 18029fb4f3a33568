"""What commands print: lines for people to stdout, JSON for machines, progress to stderr."""

import json
from pathlib import Path

from rich.console import Console

from endoct.workbench.progress import ConsoleStages, SilentStages, Stages
from endoct.workbench.status import DONE, NOT_ALIGNED


class TextConsole(Console):
    """A console that leaves it to the entry point what a reader who went away means."""

    def on_broken_pipe(self) -> None:
        """Raise what was caught."""
        raise BrokenPipeError


def tell_result(folder: Path, *, as_json: bool) -> int:
    """Print what came of the comparison in ``folder``; return the exit status that says so."""
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if as_json:
        print_json(result)
    elif result["aligned"]:
        say(f"Jaccard index {result['jaccard']:.3f}, Dice {result['dice']:.3f} ({' and '.join(result['sides'])})")
    else:
        say(f"not aligned: {result['reason']}")
    if not as_json:
        from endoct.workbench.doubts import on_the_whole  # loads what only a comparison needs

        for doubt in on_the_whole(result) if result["aligned"] else ():
            say(f"not trusted: {doubt}")
        for side, notes in result["notes"].items():
            for note in notes:
                say(f"not trusted ({side}): {note}")
        say(f"report: {folder / 'report.html'}")
    return DONE if result["aligned"] else NOT_ALIGNED


def stages_for(as_json: bool) -> Stages:
    """Return who shows how far a command is; nobody where a program reads along."""
    # progress goes to stderr, so that stdout can be piped
    return SilentStages() if as_json and not Console(stderr=True).is_terminal else ConsoleStages(Console(stderr=True))


def say(line: str) -> None:
    """Print one line, however long, as it is."""
    TextConsole().print(line, highlight=False, markup=False, soft_wrap=True)


def print_json(value: object) -> None:
    """Print ``value`` as JSON."""
    print(json.dumps(value, indent=1, ensure_ascii=False))  # noqa: T201
