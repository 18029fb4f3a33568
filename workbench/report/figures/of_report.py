"""The figures of a report: of one recording, of each side of a comparison by itself, and of both together.

Loads matplotlib: only the process that draws should.
"""

import gc
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from endoct.stitching.store import load_panorama
from endoct.workbench.report.figures.frames import draw_depth, draw_frames, draw_other_numbers, draw_quality
from endoct.workbench.report.figures.rendered import Drawing, Drawn, OfBoth
from endoct.workbench.report.figures.surfaces import draw_alignment, draw_masks, draw_panorama, draw_panoramas
from endoct.workbench.report.pictures import PICTURES, load_pictures
from endoct.workbench.report.side_findings import BothSides, SideFindings, alone

OF_SIDE = (draw_depth, draw_frames, draw_quality, draw_other_numbers)
"""Functions that draw one side of a comparison in its own frame, whatever the other side is."""


def draw_wall(side: SideFindings) -> list[Drawn]:
    """Draw every figure of one recording by itself that needs no pictures of its frames."""
    return drawn(partial(draw, side) for draw in (draw_panorama, draw_quality, draw_other_numbers))


def draw_pictures(side: SideFindings) -> list[Drawn]:
    """Draw the pictures of single frames of one recording."""
    return drawn([partial(draw_frames, side)])


def draw_sides(folder: Path, names: Sequence[str]) -> list[Drawn]:
    """Draw the sides of a comparison, each by itself, which are stored in its ``folder`` under their ``names``."""
    pictures = load_pictures(folder / PICTURES)
    panoramas = {name: load_panorama(folder / "panoramas" / f"{name}.zarr") for name in names}
    sides = [replace(alone(panoramas[name], pictures.get(name, {})), name=name) for name in names]
    return drawn(partial(draw, side) for side in sides for draw in OF_SIDE)


def draw_both(draw: OfBoth, both: BothSides) -> list[Drawn]:
    """Draw one figure of a comparison, if it has something to draw."""
    return drawn([partial(draw, both)])


def drawings_of_both(with_sides: bool) -> list[OfBoth]:
    """Return what draws both sides on the common grid, agreed or not; ``with_sides``: each in its own frame too."""
    each = [partial(_draw_side, draw=draw, k=k) for k in (0, 1) for draw in OF_SIDE] if with_sides else []
    return [draw_panoramas, draw_masks, draw_alignment, *each]


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


def _draw_side(both: BothSides, draw: Callable[[SideFindings], Drawn | None], k: int) -> Drawn | None:
    return draw(both.sides[k])
