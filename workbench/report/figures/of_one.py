"""The figures of one recording, or of one side of a comparison by itself."""

import gc
from collections.abc import Callable, Iterable
from functools import partial

from endoct.workbench.report.figures.frames import draw_depth, draw_frames
from endoct.workbench.report.figures.quality import draw_other_numbers, draw_quality
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.surfaces import draw_panorama
from endoct.workbench.report.side_findings import SideFindings

Drawing = Callable[[], Drawn | None]

OF_SIDE = (draw_depth, draw_frames, draw_quality, draw_other_numbers)
"""What draws one side of a comparison in its own frame: nothing that depends on the other side."""


def drawings_of_side(side: SideFindings) -> list[Drawing]:
    """Return what draws one side of a comparison by itself."""
    return [partial(one, side) for one in OF_SIDE]


def draw_wall(side: SideFindings) -> list[Drawn]:
    """Draw every figure of one recording by itself that needs no pictures of its frames."""
    return drawn(partial(one, side) for one in (draw_panorama, draw_quality, draw_other_numbers))


def draw_pictures(side: SideFindings) -> list[Drawn]:
    """Draw the pictures of single frames of one recording."""
    return drawn([partial(draw_frames, side)])


def drawn(drawings: Iterable[Drawing]) -> list[Drawn]:
    """Return what ``drawings`` give, one after the other, less those that have nothing to draw."""
    figures = []
    gc.freeze()  # what there was before need not be looked through after every figure
    try:
        for draw in drawings:
            figure = draw()
            gc.collect()  # a figure refers to itself in circles, and holds megabytes
            if figure is not None:
                figures.append(figure)
    finally:
        gc.unfreeze()
    return figures
