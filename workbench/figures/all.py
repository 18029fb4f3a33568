"""All figures of a comparison, in the order in which a reader wants them."""

import gc
from collections.abc import Callable, Iterator
from pathlib import Path

from endoct.workbench.figures.agreement import draw_budget, draw_scores
from endoct.workbench.figures.cylinder import draw_cylinder
from endoct.workbench.figures.drawing import Drawn
from endoct.workbench.figures.frames import draw_depth, draw_frames
from endoct.workbench.figures.quality import draw_quality
from endoct.workbench.figures.surfaces import draw_alignment, draw_masks, draw_panoramas
from endoct.workbench.findings import Findings


def draw_all(findings: Findings, folder: Path) -> list[Drawn]:
    """Draw every figure that ``findings`` have matter for into ``folder``, which must exist."""
    drawn = []
    gc.collect()
    gc.freeze()  # what there was before need not be looked through after every figure
    try:
        for draw in _drawings(findings, folder):
            figure = draw()
            gc.collect()  # a figure refers to itself in circles, and holds megabytes
            if figure is not None:
                drawn.append(figure)
    finally:
        gc.unfreeze()
    return drawn


def _drawings(findings: Findings, folder: Path) -> Iterator[Callable[[], Drawn | None]]:
    yield lambda: draw_panoramas(findings, folder)
    yield lambda: draw_masks(findings, folder)
    yield lambda: draw_budget(findings, folder)
    yield lambda: draw_scores(findings, folder)
    yield lambda: draw_alignment(findings, folder)
    for side in findings.sides:
        yield lambda side=side: draw_depth(side, folder)  # type: ignore[misc]
    for side in findings.sides:
        yield lambda side=side: draw_frames(side, folder)  # type: ignore[misc]
    for side in findings.sides:
        if side.depth_mm is not None or all(s.depth_mm is None for s in findings.sides):
            yield lambda side=side: draw_cylinder(side, findings.grid, folder)  # type: ignore[misc]
    for side in findings.sides:
        yield lambda side=side: draw_quality(side, folder)  # type: ignore[misc]
