"""The words that a reader of a report needs, each in a line."""

from collections.abc import Iterator

from endoct.fusion.registration.align import BELIEVABLE
from endoct.fusion.result import Result
from endoct.workbench.report.findings import overlaps_of
from endoct.workbench.report.wording import table


def words(result: Result) -> str:
    """Return the words that the report on ``result`` uses, as HTML."""
    return table(_words(result), text=(1,))


def _words(result: Result) -> Iterator[tuple[str, str]]:
    a, b = result.sides
    if overlaps_of(result):
        yield (
            "Jaccard index",
            "Area that both call cell, over the area that either does: 1 where they agree, 0 where not.",
        )
        yield "Dice index", "Twice the area that both call cell, over the sum of both areas: another scale of the same."
        yield "Place", "A connected area in which either of the two shows a cell; intervals are over places."
    if result.aligned:
        yield "Common grid", f"Samples in the frame of {a}, on which both are scored; {b} is interpolated there."
        yield (
            "Confidence",
            f"How far the alignment stands out from the next best, 0 to 1; accepted from {BELIEVABLE:g} on.",
        )
    yield "Observed", "Really recorded. Nothing else is scored; nothing is filled in."
    yield "Doubt", "What speaks against the whole result, or one side as a whole. It heads this page."
    yield "Note", "What is to be known of a recording, or of some of its frames or rows, and is no reason for doubt."
