"""All figures of a comparison, and of one recording."""

import gc
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from endoct.workbench.report.figures.agreement import draw_budget, draw_scores
from endoct.workbench.report.figures.cylinder import draw_cylinder
from endoct.workbench.report.figures.frames import draw_depth, draw_frames
from endoct.workbench.report.figures.quality import draw_other_numbers, draw_quality
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panorama, draw_panoramas
from endoct.workbench.report.findings import Findings, SideFindings

Drawing = Callable[[], Drawn | None]


def draw_walls(findings: Findings) -> list[Drawn]:
    """Draw the walls, the cells and the scores, as far as ``findings`` have them."""
    return _drawn(partial(one, findings) for one in (draw_panoramas, draw_masks, draw_budget, draw_scores))


def draw_shapes(findings: Findings) -> list[Drawn]:
    """Draw the bore cut open, and how the sides lie on each other."""
    return _drawn(_shapes(findings))


def draw_side(side: SideFindings) -> list[Drawn]:
    """Draw what one side of a comparison saw in its own frame: nothing that depends on the other side."""
    return _drawn(partial(one, side) for one in (draw_depth, draw_frames, draw_quality, draw_other_numbers))


def draw_wall(side: SideFindings) -> list[Drawn]:
    """Draw every figure of one recording by itself that needs no pictures of its frames."""
    return _drawn(partial(one, side) for one in (draw_panorama, draw_quality, draw_other_numbers))


def draw_pictures(side: SideFindings) -> list[Drawn]:
    """Draw the pictures of single frames of one recording."""
    return _drawn([partial(draw_frames, side)])


def _shapes(findings: Findings) -> Iterator[Drawing]:
    for side in findings.sides:
        if side.depth_mm is not None or all(s.depth_mm is None for s in findings.sides):
            yield partial(draw_cylinder, side, findings.grid)
    yield partial(draw_alignment, findings)


def _drawn(drawings: Iterable[Drawing]) -> list[Drawn]:
    drawn = []
    gc.collect()
    gc.freeze()  # what there was before need not be looked through after every figure
    try:
        for draw in drawings:
            figure = draw()
            gc.collect()  # a figure refers to itself in circles, and holds megabytes
            if figure is not None:
                drawn.append(figure)
    finally:
        gc.unfreeze()
    return drawn
