"""The figures of a comparison."""

from collections.abc import Iterator
from functools import partial

from endoct.workbench.report.figures.agreement import draw_budget, draw_scores
from endoct.workbench.report.figures.cylinder import draw_cylinder
from endoct.workbench.report.figures.of_one import Drawing, drawings_of_side
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panoramas
from endoct.workbench.report.findings import Findings


def drawings_of(findings: Findings, *, with_sides: bool) -> list[Drawing]:
    """Return what draws the figures of a comparison, one each, as far as ``findings`` have something to draw.

    ``with_sides``: also those that show one side in its own frame, and nothing that depends on the other.
    """
    return list(_drawings(findings, with_sides))


def _drawings(findings: Findings, with_sides: bool) -> Iterator[Drawing]:
    for draw in (draw_panoramas, draw_masks, draw_budget, draw_scores):
        yield partial(draw, findings)
    for side in findings.sides:
        if side.depth_mm is not None or all(s.depth_mm is None for s in findings.sides):
            yield partial(draw_cylinder, side, findings.grid)
    yield partial(draw_alignment, findings)
    if with_sides:
        for side in findings.sides:
            yield from drawings_of_side(side)
