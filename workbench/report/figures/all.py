"""All figures of a comparison, and of one recording."""

import gc
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from endoct.workbench.report.figures.agreement import draw_budget, draw_scores
from endoct.workbench.report.figures.cylinder import draw_cylinder
from endoct.workbench.report.figures.drawing import Drawn
from endoct.workbench.report.figures.frames import draw_depth, draw_frames
from endoct.workbench.report.figures.quality import draw_other_numbers, draw_quality
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panorama, draw_panoramas
from endoct.workbench.report.findings import Findings, SideFindings

Drawing = Callable[[], Drawn | None]


def draw_walls(findings: Findings, folder: Path) -> list[Drawn]:
    """Draw the walls, the cells and the scores, as far as ``findings`` have them, into ``folder``, which must exist."""
    return _drawn(_walls(findings, folder))


def draw_details(findings: Findings, folder: Path) -> list[Drawn]:
    """Draw all other figures: how the sides lie on each other, and what each saw in its own frame.

    More than half of the work: who has the walls drawn beside this cuts tiles as well.
    """
    return _drawn(_details(findings, folder))


def draw_recording(side: SideFindings, folder: Path) -> list[Drawn]:
    """Draw every figure of one recording by itself."""
    draw = draw_panorama, draw_frames, draw_quality, draw_other_numbers
    return _drawn(partial(one, side, folder) for one in draw)


def _walls(findings: Findings, folder: Path) -> Iterator[Drawing]:
    yield lambda: draw_panoramas(findings, folder)
    yield lambda: draw_masks(findings, folder)
    yield lambda: draw_budget(findings, folder)
    yield lambda: draw_scores(findings, folder)
    for side in findings.sides:
        if side.depth_mm is not None or all(s.depth_mm is None for s in findings.sides):
            yield partial(draw_cylinder, side, findings.grid, folder)


def _details(findings: Findings, folder: Path) -> Iterator[Drawing]:
    yield lambda: draw_alignment(findings, folder)
    for side in findings.sides:
        yield partial(draw_depth, side, folder)
        yield partial(draw_frames, side, folder)
        yield partial(draw_quality, side, folder)
        yield partial(draw_other_numbers, side, folder)


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
