"""Figures of a pose and of an outlook: the CT cut along the bore, the wall of each side, and what the CT predicts."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.ranks import robust_limits
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.placement import IN_PLACE, Sampling, common_grid
from endoct.fusion.pose import search
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.structures import mask_of, name_of, segments_in
from endoct.fusion.pose.summary import radius_of
from endoct.fusion.pose.support import LONG_BARE_MM, drawn_on
from endoct.modalities.ct.ct_volume import CtVolume, part_around
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.posing.prediction import COLUMNS, ROWS_MM
from endoct.workbench.report.figures.drawing import (
    BLUE,
    DEPTH_COLOURS,
    GREEN,
    INTENSITY_COLOURS,
    ORANGE,
    PAGE_WIDTH_IN,
    PURPLE,
    SKY,
    VERMILION,
    journal_style,
    new_figure,
    place,
    render,
)
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.figures.wall_panels import (
    colour_bar,
    draw_outline,
    panel_figure,
    scale_text,
    show_surface,
    thinned,
    wall_panel,
)

BEFORE_MM, AFTER_MM, ASIDE_MM, STEP_MM = 4.0, 9.0, 7.0, 0.1
"""How much of the CT a cut shows around the bore, and its samples."""
WINDOW_HU = (-1000.0, 2000.0)
DEEPEST_MM = 1.0
STRUCTURE_COLOURS = {"facial nerve": VERMILION, "chorda tympani": PURPLE, "cochlea": GREEN}
OTHER_COLOURS = BLUE, "#8C564B", "#7F7F00"
"""Colours of structures by name; others take theirs in turn."""
LEAST_SHARE = 0.5


def draw_cut(ct: CtVolume, labels: CtVolume | None, pose: BorePose, told: bool) -> Drawn:
    """Draw the CT cut along the bore in two planes at right angles, with the plan, the bore and the structures."""
    z = np.arange(-BEFORE_MM, pose.plan.length_mm + AFTER_MM, STEP_MM)
    aside = np.arange(-ASIDE_MM, ASIDE_MM + STEP_MM / 2, STEP_MM)
    extent = (z[0] - STEP_MM / 2, z[-1] + STEP_MM / 2, aside[-1] + STEP_MM / 2, aside[0] - STEP_MM / 2)
    width_in = PAGE_WIDTH_IN - 0.6
    height_in = width_in * np.ptp(aside) / np.ptp(z)
    low, high = WINDOW_HU if float(ct.voxels.min()) < -500 else (0.0, 1.0)
    names: dict[str, str] = {}
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 2 * height_in + 1.0)
        for k, (axis, title) in enumerate(zip((0, 1), ("θ = 0° up", "θ = 90° up"), strict=True)):
            axes = place(figure, 0.4, k * (height_in + 0.35), width_in, height_in)
            shown = _cut(ct, pose, z, aside, axis)
            axes.imshow(shown, cmap="gray", vmin=low, vmax=high, extent=extent, aspect="equal")
            if labels is not None:
                names |= _outline_structures(axes, labels, pose, z, aside, axis)
            _draw_bore(axes, pose, axis, told)
            for stretch in drawn_on(pose):
                axes.axvspan(stretch.from_mm, stretch.to_mm, color=SKY, alpha=0.25, linewidth=0)
            axes.set_title(f"({'ab'[k]}) {title}", pad=3)
            axes.set_ylabel("from the axis (mm)")
            axes.set_xlim(z[0], z[-1])
            axes.set_ylim(-ASIDE_MM, ASIDE_MM)
        axes.set_xlabel("along the bore from the planned entry (mm)")
        handles = [
            Line2D([], [], color=ORANGE, linestyle="-" if told else ":", label="bore" if told else "best, not told"),
            Line2D([], [], color=SKY, linestyle="--", label="plan"),
            *(Line2D([], [], color=colour, label=name) for name, colour in names.items()),
        ]
        axes.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=3.6, ncols=5, frameon=False,
            handlelength=1.6,
        )  # fmt: skip
        rendered = render(figure, "cut")
    caption = (
        "Two planes through the found axis, at right angles, drawn to scale; the CT is from before drilling. "
        "Solid: the bore's envelope and axis, between thin lines that hold the wall in 95 % of cases. Dashed: the "
        "plan, projected onto the plane. Tinted: nothing shows how the bore runs, and the axis is drawn on from the "
        f"rest; no side recorded it there, or over {LONG_BARE_MM:g} mm or more none saw an edge of a cell."
    )
    return Drawn(rendered, "cut", "The CT along the bore", caption)


def draw_wall(side: Side, prediction: Panorama) -> Drawn:
    """Draw what a side shows of the wall beside what the CT predicts of it at the pose."""
    own, of_ct = Sampling(side.grid, IN_PLACE), Sampling(prediction.grid, IN_PLACE)
    grid = common_grid(own, of_ct, dz_mm=ROWS_MM, n_theta=COLUMNS)
    evidence, by_depth = side.evidence, side.relief is not None
    shown = evidence.values if by_depth else side.panorama.intensity
    valid = evidence.valid if by_depth else side.panorama.valid
    measured, observed = own.onto(grid).image(shown, valid)
    bone, there = of_ct.onto(grid).image(prediction.intensity, prediction.valid)
    images = np.where(observed, measured, np.nan), np.where(there, bone, np.nan)
    coarse, thin, thin_bone, known = thinned(grid, *images, observed)
    with journal_style():
        figure, axes = panel_figure(grid, 3)
        colours = DEPTH_COLOURS if by_depth else INTENSITY_COLOURS
        limits = (0.0, DEEPEST_MM) if by_depth else robust_limits(thin, known)
        unit = "behind the wall (mm)" if by_depth else "intensity (a.u.)"
        for k, (title, outlined) in enumerate(((f"(a) {side.name}", False), (f"(b) {side.name}, CT outlined", True))):
            wall_panel(axes[k], grid, title, first=k == 0)
            image = show_surface(axes[k], coarse, thin, known & np.isfinite(thin), colours, *limits)
            colour_bar(axes[k], image, unit)
            if outlined:
                draw_outline(axes[k], coarse, np.nan_to_num(thin_bone, nan=1.0), BLUE if by_depth else ORANGE)
        wall_panel(axes[2], grid, "(c) predicted by the CT", first=False)
        image = show_surface(axes[2], coarse, thin_bone, np.isfinite(thin_bone), INTENSITY_COLOURS, 0.0, 1.0)
        colour_bar(axes[2], image, "share of bone")
        rendered = render(figure, f"wall-{side.name}")
    caption = (
        f"In the frame of {side.name}, {scale_text(grid)}. (b) with outlines of what the CT has as air, half or more. "
        "Hatched: not observed. Where the pose is right, dark places of (a) and (c) are the same."
    )
    return Drawn(rendered, f"wall-{side.name}", f"The wall by {side.name}, and by the CT at the pose", caption)


def draw_wall_of_plan(wall: Image, radius_mm: float) -> Drawn:
    """Draw the wall of a bore along the plan as the CT has it: ``wall``, the share of air (n_z, n_theta)."""
    grid = SurfaceGrid.full_circle(wall.shape[0], search.COLUMNS, z0_mm=0.0, dz_mm=search.ROWS_MM, radius_mm=radius_mm)
    with journal_style():
        figure, (axes,) = panel_figure(grid, 1)
        wall_panel(axes, grid, "predicted by the CT")
        image = show_surface(axes, grid, 1 - wall, np.ones(wall.shape, np.bool_), INTENSITY_COLOURS, 0.0, 1.0)
        colour_bar(axes, image, "share of bone")
        rendered = render(figure, "wall")
    caption = f"Along the plan, {scale_text(grid)}. θ and z are those of the plan's frame; dark: air."
    return Drawn(rendered, "wall", "The wall of a bore along the plan, by the CT", caption)


def _cut(volume: CtVolume, pose: BorePose, z: Coordinates, aside: Coordinates, axis: int) -> Image:
    """Return a volume in a plane of the bore frame, (aside, z), NaN outside of it."""
    part, index = _around(volume, pose, z, aside, axis)
    cut = ndimage.map_coordinates(part.astype(np.float32), index, order=1, cval=np.nan)
    return np.asarray(cut, dtype=np.float32)


def _around(
    volume: CtVolume, pose: BorePose, z: Coordinates, aside: Coordinates, axis: int
) -> tuple[NDArray[np.generic], Coordinates]:
    """Return the part of a volume around a plane of the bore frame, and the plane's indices in it, (3, aside, z)."""
    local = np.zeros((aside.size, z.size, 3))
    local[..., axis], local[..., 2] = aside[:, None], z
    to_lps = pose.bore_to_lps
    places = local @ to_lps[:3, :3].T + to_lps[:3, 3]
    part = part_around(volume, places.reshape(-1, 3), float(np.linalg.norm(volume.steps_mm, axis=1).max()))
    return part.voxels, np.moveaxis((places - part.origin_mm) @ np.linalg.inv(part.steps_mm), -1, 0)


def _draw_bore(axes: Axes, pose: BorePose, axis: int, told: bool) -> None:
    radius, length, style = radius_of(pose), pose.plan.length_mm, "-" if told else ":"
    z = np.linspace(0, length, 33)
    reach = [1.96 * float(np.sqrt(pose.axis_covariance(float(depth))[axis, axis])) for depth in z]
    for sign in (-1, 1):
        axes.plot([0, length], [sign * radius, sign * radius], color=ORANGE, linewidth=1.2, linestyle=style)
        for by in (-1, 1):
            axes.plot(z, sign * radius + by * np.array(reach), color=ORANGE, linewidth=0.4, linestyle=style)
    for end in (0, length):
        axes.plot([end, end], [-radius, radius], color=ORANGE, linewidth=1.2, linestyle=style)
    axes.plot([0, length], [0, 0], color=ORANGE, linewidth=0.6, linestyle=style)
    ends = np.array([pose.plan.entry_mm, pose.plan.target_mm])
    to_lps = pose.bore_to_lps
    local = (ends - to_lps[:3, 3]) @ to_lps[:3, :3]
    axes.plot(local[:, 2], local[:, axis], color=SKY, linewidth=1.2, linestyle="--")


def _outline_structures(
    axes: Axes, labels: CtVolume, pose: BorePose, z: Coordinates, aside: Coordinates, axis: int
) -> dict[str, str]:
    """Outline the structures in a plane; return their colours by name."""
    part, index = _around(labels, pose, z, aside, axis)
    found = {}
    for segment in segments_in(replace(labels, voxels=part)) if part.size else ():
        mask = mask_of(part, segment)
        if not mask.any():
            continue
        inside = ndimage.map_coordinates(mask.astype(np.float32), index, order=1, cval=0.0)
        if not inside.max() > LEAST_SHARE:
            continue
        name = name_of(segment)
        colour = STRUCTURE_COLOURS.get(name, OTHER_COLOURS[segment.label % len(OTHER_COLOURS)])
        axes.contour(z, aside, inside, levels=[LEAST_SHARE], colors=[colour], linewidths=1.0)
        found[name] = colour
    return found
