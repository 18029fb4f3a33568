"""How many doubts and notes there are, and the notes as HTML."""

from collections.abc import Sequence

from endoct.fusion.result import Result
from endoct.stitching.doubt import Doubt
from endoct.workbench.report.wording import table


def count_doubts(doubts: Sequence[object]) -> str:
    """Return "1 doubt" or "2 doubts"."""
    return f"{len(doubts)} doubt{'s' if len(doubts) != 1 else ''}"


def notes_table(result: Result) -> str:
    """Return what is to be known besides, a line for each note; "" without any."""
    rows = [(side, note) for side, said in result.notes.items() for note in said]
    if not rows:
        return ""
    return table(rows, text=(1,))


def count_notes(result: Result) -> int:
    """Return how many notes a result has."""
    return sum(len(said) for said in result.notes.values())
