"""The wall as it was seen: intensity, and depth where there is depth."""

from collections.abc import Sequence

import numpy as np

from endoct.stitching.arrays import Image
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.drawing import (
    DEPTH_COLOURS,
    INTENSITY_COLOURS,
    journal_style,
    letters,
    render,
    robust_limits,
)
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.wall_panels import (
    colour_bar,
    panel_figure,
    scale_text,
    show_surface,
    thinned,
    wall_panel,
)
from endoct.workbench.report.side_findings import SideFindings


def draw_panorama(side: SideFindings) -> Drawn | None:
    """Draw intensity, and depth where there is depth, of one side in its own frame."""
    return draw_walls_of([side], side.panorama.grid, "In its own frame, on its own rows")


def draw_walls_of(sides: Sequence[SideFindings], grid: SurfaceGrid, frame: str) -> Drawn | None:
    """Draw the walls of ``sides``, all on ``grid``; None where none of them saw any. ``frame`` says how they lie."""
    panels: list[tuple[str, SideFindings, Image, str, str]] = []
    for side in sides:
        if not side.is_drawn_mask:
            panels.append((side.name, side, side.intensity, INTENSITY_COLOURS, "intensity (a.u.)"))
        if side.depth_mm is not None:
            panels.append((f"{side.name}, depth", side, side.depth_mm, DEPTH_COLOURS, "wall radius − bore radius (mm)"))
    if not panels:
        return None
    with journal_style():
        figure, axes = panel_figure(grid, len(panels))
        for k, (name, side, values, colours, unit) in enumerate(panels):
            coarse, thin, valid = thinned(grid, np.where(side.valid, values, np.nan), side.valid)
            wall_panel(axes[k], grid, f"{letters(len(panels))[k]} {name}", first=k == 0)
            low, high = robust_limits(thin, valid)
            image = show_surface(axes[k], coarse, thin, valid & np.isfinite(thin), colours, low, high)
            colour_bar(axes[k], image, unit)
        rendered = render(figure, "panoramas")
    return Drawn(
        rendered,
        "panoramas",
        "The unrolled wall",
        f"{frame}. θ runs clockwise as seen looking in, z inward from the mouth; {scale_text(grid)}. "
        "Hatched: not observed by that side. Colour bars end at the 0.5th and 99.5th percentile.",
    )
