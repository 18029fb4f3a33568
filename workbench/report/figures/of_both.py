"""The figures of a comparison."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from endoct.workbench.report.figures.cylinder import draw_cylinder
from endoct.workbench.report.figures.of_one import OF_SIDE, Drawing
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panoramas
from endoct.workbench.report.side_findings import BothSides, SideFindings

if TYPE_CHECKING:
    from endoct.workbench.report.findings import Findings

OfBoth = Callable[[BothSides], Drawn | None]
"""A function of a module, which another process can be asked to call."""


def drawings_of(findings: "Findings") -> list[Drawing]:
    """Return what draws the figures of a comparison, one each, as far as ``findings`` have something to draw."""
    before_scoring = [*drawings_of_wall(findings), *drawings_of_sides()]
    return [*(partial(draw, findings) for draw in before_scoring), *drawings_of_scores(findings)]


def drawings_of_wall(both: BothSides) -> list[OfBoth]:
    """Return what draws ``both`` on the common grid, whether they agree or not."""
    knows_depth = [side.depth_mm is not None for side in both.sides]
    cut_open = [k for k in (0, 1) if knows_depth[k] or not any(knows_depth)]
    return [draw_panoramas, draw_masks, *(partial(_draw_cylinder, k=k) for k in cut_open), draw_alignment]


def drawings_of_sides() -> list[OfBoth]:
    """Return what draws each of two sides in its own frame: nothing that depends on the other side."""
    return [partial(_draw_side, draw=draw, k=k) for k in (0, 1) for draw in OF_SIDE]


def drawings_of_scores(findings: "Findings") -> list[Drawing]:
    """Return what draws how far the two sides agree."""
    from endoct.workbench.report.figures.agreement import draw_budget, draw_scores  # they load what compares

    return [partial(draw, findings) for draw in (draw_budget, draw_scores)]


def _draw_cylinder(both: BothSides, k: int) -> Drawn | None:
    return draw_cylinder(both.sides[k], both.grid)


def _draw_side(both: BothSides, draw: Callable[[SideFindings], Drawn | None], k: int) -> Drawn | None:
    return draw(both.sides[k])
