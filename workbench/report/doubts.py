"""Doubts and notes of a comparison, as HTML."""

from collections.abc import Sequence
from html import escape

from endoct.fusion.result import Result
from endoct.stitching.doubt import Doubt
from endoct.workbench.report.wording import table


def count_doubts(doubts: Sequence[Doubt]) -> str:
    """Return "1 doubt" or "2 doubts"."""
    return f"{len(doubts)} doubt{'s' if len(doubts) != 1 else ''}"


def doubts_box(doubts: Sequence[Doubt]) -> str:
    """Return every doubt in full in one box, in the words and the order of ``result.json``; "" without any."""
    if not doubts:
        return ""
    items = "".join(
        f"<li>{_side(doubt)}{escape(doubt.what)} <span class=code>{escape(doubt.code)}</span></li>" for doubt in doubts
    )
    return f'<div class="doubts" id="doubts"><b>{count_doubts(doubts).capitalize()}</b><ul>{items}</ul></div>\n'


def notes_table(result: Result) -> str:
    """Return what is to be known besides, a line for each note; "" without any."""
    rows = [(side, note) for side, said in result.notes.items() for note in said]
    if not rows:
        return ""
    return table(rows, text=(1,))


def count_notes(result: Result) -> int:
    """Return how many notes a result has."""
    return sum(len(said) for said in result.notes.values())


def _side(doubt: Doubt) -> str:
    return "" if doubt.side is None else f"<b>{escape(doubt.side)}:</b> "
