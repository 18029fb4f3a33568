"""The part of a report on single frames of one side: what was flagged, what is plotted, and all numbers folded away."""

from collections.abc import Iterator
from html import escape

from endoct.workbench.report.flags import flag_rows
from endoct.workbench.report.per_frame import number_rows
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.wording import table


def quality_of(side: SideFindings, main: str, others: str) -> Iterator[str]:
    """Yield the part on ``side`` as HTML, with its figures, ``main`` and ``others``, as HTML.

    The page hides ``main`` where it plots the same numbers itself.
    """
    dim = side.panorama.frame_dim
    if flagged := list(flag_rows(side)):
        yield table(
            flagged, [f"{side.name}: {dim}s flagged", "how many", f"which, by z from {dim} 0", "z in its own frame"]
        )
    yield f'<div class="printed">{main}</div>\n' if main else ""
    if rows := list(number_rows(side)):
        yield (
            f"<details><summary>All that was measured of each {escape(dim)} of {escape(side.name)}</summary>\n{others}"
            + table(rows, ["in the panorama's store", "meaning", "usual", "here, 5th to 95th percentile"], text=(1,))
            + "</details>\n"
        )
