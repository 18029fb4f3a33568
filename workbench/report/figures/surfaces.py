"""Figures of the wall as each side saw it, of the cells, and of how well the two sides lie on each other.

A wall is drawn with its intensity, and its depth where there is depth; cells with where the sides differ.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.ranks import robust_limits
from endoct.fusion.scoring.overlap import BOTH, ONLY_A, ONLY_B, difference
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.drawing import (
    BLUE,
    DEPTH_COLOURS,
    INK,
    INTENSITY_COLOURS,
    MASK_COLOURS,
    ORANGE,
    PAPER,
    journal_style,
    letters,
    render,
    width_of,
)
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.wall_panels import (
    ABOVE_PT,
    colour_bar,
    draw_outline,
    not_observed_patch,
    panel_figure,
    scale_text,
    show_surface,
    thinned,
    wall_panel,
)
from endoct.workbench.report.side_findings import BothSides, SideFindings

DIFFERENCE_COLOURS = (PAPER, INK, ORANGE, BLUE)


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
            for plane in side.planes:
                axes[k].plot(np.arange(361), plane.z_at(np.radians(np.arange(361))), color=ORANGE, linewidth=0.6)
        rendered = render(figure, "panoramas")
    drawn_planes = "Orange lines: planes that cut the bore. " if any(side.planes for side in sides) else ""
    return Drawn(
        rendered,
        "panoramas",
        "The unrolled wall",
        f"{frame}. θ runs clockwise as seen looking in, z inward from the mouth; {scale_text(grid)}. "
        f"Hatched: not observed by that side. {drawn_planes}Colour bars end at the 0.5th and 99.5th percentile.",
    )


def draw_panoramas(both: BothSides) -> Drawn | None:
    """Draw intensity, and depth where there is depth, of each side on the common grid."""
    frame = (
        f"Both lie on one grid in the frame of {both.sides[0].name}"
        if both.aligned
        else "Each lies in its own frame: the two could not be aligned, so places do not correspond"
    )
    return draw_walls_of(both.sides, both.grid, frame)


def draw_masks(both: BothSides) -> Drawn:
    """Draw the cells of each side and, where the sides are aligned, the difference image."""
    a, b = both.sides
    observed = a.valid & b.valid
    with journal_style():
        figure, axes = panel_figure(both.grid, 3 if both.aligned else 2)
        for k, (letter, side) in enumerate(zip(letters(2), (a, b), strict=True)):
            wall_panel(axes[k], both.grid, f"{letter} cells, {side.name}", first=k == 0)
            coarse, mask, valid = thinned(both.grid, side.mask, side.valid)
            show_surface(axes[k], coarse, mask, valid, MASK_COLOURS)
            bone = Patch(facecolor=PAPER, edgecolor=INK, linewidth=0.4, label="bone")
            _legend(axes[k], [Patch(facecolor=INK, label="cell"), bone])
        title, caption = "Cells", "Air cells found by each side. "
        if both.aligned:
            wall_panel(axes[2], both.grid, "(c) difference", first=False)
            coarse, mask_a, mask_b, known = thinned(both.grid, a.mask, b.mask, observed)
            thin_kinds = difference(mask_a, mask_b, known)
            show_surface(axes[2], coarse, thin_kinds, known, ListedColormap(DIFFERENCE_COLOURS), 0, 3)
            kinds = difference(a.mask, b.mask, observed)
            area_mm2 = both.grid.dz_mm * both.grid.dtheta_mm
            counts = {kind: int((kinds == kind).sum()) for kind in (BOTH, ONLY_A, ONLY_B)}
            names = {BOTH: "both", ONLY_A: f"only {a.name}", ONLY_B: f"only {b.name}"}
            handles = [
                Patch(facecolor=DIFFERENCE_COLOURS[kind], label=f"{names[kind]}, {count * area_mm2:.2f} mm²")
                for kind, count in counts.items()
            ]
            _legend(axes[2], [*handles, not_observed_patch()], columns=1)
            title = "Cells, and where the two differ"
            caption += (
                f"(c) A cell for both, for one only, or for neither (light); scored only where both sides observed "
                f"the wall, {observed.mean():.1%} of the grid."
            )
        else:
            caption += "No difference image: the two sides could not be aligned."
        rendered = render(figure, "masks")
    return Drawn(rendered, "masks", title, caption)


def draw_alignment(both: BothSides) -> Drawn | None:
    """Draw how the two sides lie on each other: checkerboard, outlines, and agreement along the bore."""
    if not both.aligned:
        return None
    a, b = both.sides
    grid = both.grid
    observed = a.valid & b.valid
    coarse, left, right, known = thinned(grid, _features(a), _features(b), observed)
    left, right = _scaled(left, known), _scaled(right, known)
    of_a, of_b = left[known], right[known]
    flipped = known.any() and float(np.mean((of_a - of_a.mean()) * (of_b - of_b.mean()))) < 0
    right = 1 - right if flipped else right
    with journal_style():
        figure, axes = panel_figure(grid, 3)
        wall_panel(axes[0], grid, f"(a) {a.name} | {b.name}")
        show_surface(axes[0], coarse, np.where(_tiles(coarse), left, right), known, "gray")
        wall_panel(axes[1], grid, f"(b) outlines on {a.name}", first=False)
        show_surface(axes[1], coarse, left, known, "gray", -0.3, 1)
        for side, colour in ((a, ORANGE), (b, BLUE)):
            _, cells = thinned(grid, (side.mask & observed).astype(np.float32))
            draw_outline(axes[1], coarse, cells, colour)
        _legend(axes[1], [Line2D([], [], color=ORANGE, label=a.name), Line2D([], [], color=BLUE, label=b.name)])
        _agreement(axes[2], grid, a.mask, b.mask, observed)
        rendered = render(figure, "alignment")
    tile = _tile_mm(grid)
    return Drawn(
        rendered,
        "alignment",
        "How well the two lie on each other",
        f"(a) Tiles of {tile:g} mm from either side by turns, showing {_feature_name(a)} and "
        f"{_feature_name(b)}{', the latter inverted' if flipped else ''}: edges should run on across tiles. "
        "(b) Outlines of both masks. (c) Jaccard index over windows of 0.5 mm along the bore, and the share of the "
        "circle that both sides observed.",
    )


def _agreement(axes: Axes, grid: SurfaceGrid, a: Mask, b: Mask, observed: Mask) -> None:
    window = max(1, round(0.5 / grid.dz_mm))
    both, either = (a & b & observed).sum(axis=1), ((a | b) & observed).sum(axis=1)
    kernel = np.ones(min(window, grid.n_z))
    both, either = np.convolve(both, kernel, "same"), np.convolve(either, kernel, "same")
    there = (either > 0) & observed.any(axis=1)
    jaccard = np.divide(both, either, out=np.full(grid.n_z, np.nan), where=there)
    z_mm: Coordinates = grid.z_mm
    axes.fill_betweenx(z_mm, observed.mean(axis=1), color="#e6e4dc", label="observed by both", linewidth=0)
    axes.plot(jaccard, z_mm, color=INK, linewidth=1.0, label="Jaccard index")
    axes.set_xlim(0, 1)
    axes.set_ylim(grid.z0_mm + (grid.n_z - 0.5) * grid.dz_mm, grid.z0_mm - grid.dz_mm / 2)
    axes.tick_params(labelleft=False)
    axes.grid(color="#e3e3e3", linewidth=0.4)
    axes.set_title("(c) along the bore", pad=ABOVE_PT)
    axes.set_xlabel("index, share")
    _legend(axes, None)


def _features(side: SideFindings) -> Image:
    """Return what shows a side's cells best: its depth, else its mask drawn by hand, else its intensity."""
    if side.depth_mm is not None:
        return np.where(side.valid, side.depth_mm, np.nan)
    if side.is_drawn_mask:
        return np.where(side.valid, side.mask, np.nan).astype(np.float32)
    return np.where(side.valid, side.intensity, np.nan)


def _feature_name(side: SideFindings) -> str:
    return f"{side.name}'s " + ("depth" if side.depth_mm is not None else "mask" if side.is_drawn_mask else "intensity")


def _scaled(values: NDArray[Any], known: Mask) -> NDArray[Any]:
    """Return ``values`` scaled so that most of what is known lies within 0 and 1, whatever the unit."""
    low, high = robust_limits(values, known, 2, 98)
    return np.clip((values - low) / (high - low), 0, 1)


def _tile_mm(grid: SurfaceGrid) -> float:
    return 1.0 if grid.n_z * grid.dz_mm > 3 else 0.5


def _tiles(grid: SurfaceGrid) -> Mask:
    around = max(2, 2 * round(np.pi * grid.radius_mm / _tile_mm(grid)))  # an even number: the board closes
    columns = np.floor(np.arange(grid.n_theta) * around / grid.n_theta).astype(int)
    rows = np.floor(np.arange(grid.n_z) * grid.dz_mm / _tile_mm(grid)).astype(int)
    return np.asarray((rows[:, np.newaxis] + columns[np.newaxis]) % 2 == 0)


def _legend(axes: Axes, handles: list[Any] | None, *, columns: int = 2) -> None:
    options: dict[str, Any] = {
        "loc": "upper center", "bbox_to_anchor": (0.5, -0.02), "bbox_transform": axes.transAxes,
        "ncols": columns if width_of(axes) > 1.9 else 1, "frameon": False, "borderaxespad": 4.2,
        "handlelength": 1.2, "columnspacing": 1.0,
    }  # fmt: skip
    if handles is None:
        axes.legend(**options)
    else:
        axes.legend(handles=handles, **options)
