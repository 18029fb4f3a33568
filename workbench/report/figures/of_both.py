"""The figures of a comparison that show both of its sides."""

from collections.abc import Iterator
from functools import partial

from endoct.workbench.report.figures.agreement import draw_budget, draw_scores
from endoct.workbench.report.figures.cylinder import draw_cylinder
from endoct.workbench.report.figures.of_one import Drawing, drawn
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panoramas
from endoct.workbench.report.findings import Findings


def draw_walls(findings: Findings) -> list[Drawn]:
    """Draw the walls, the cells and the scores, as far as ``findings`` have them."""
    return drawn(partial(one, findings) for one in (draw_panoramas, draw_masks, draw_budget, draw_scores))


def draw_shapes(findings: Findings) -> list[Drawn]:
    """Draw the bore cut open, and how the sides lie on each other."""
    return drawn(_shapes(findings))


def _shapes(findings: Findings) -> Iterator[Drawing]:
    for side in findings.sides:
        if side.depth_mm is not None or all(s.depth_mm is None for s in findings.sides):
            yield partial(draw_cylinder, side, findings.grid)
    yield partial(draw_alignment, findings)
