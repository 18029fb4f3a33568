"""The frames of one side: single ones with what was found in them, where on the wall they lie, and numbers of each.

The numbers are drawn along the bore: the few that say how good the frames are, and all others.
"""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.base.numeric.ranks import robust_limits
from endoct.modalities.contract import Picture
from endoct.workbench.report.figures.drawing import (
    BLUE,
    DEPTH_COLOURS,
    GREEN,
    INK,
    PAGE_WIDTH_IN,
    PLACES,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
    hatch_not_observed,
    journal_style,
    new_figure,
    place,
    render,
    unit_of,
    wrapped,
)
from endoct.workbench.report.figures.rendered import Drawn, Rendered
from endoct.workbench.report.figures.wall_panels import (
    LEFT_IN,
    MAX_PANEL_HEIGHT_IN,
    colour_bar,
    show_surface,
    thinned,
    wall_panel,
    z_stretch,
)
from endoct.workbench.report.per_frame import Number, main_and_others
from endoct.workbench.report.side_findings import SideFindings, flagged_frames

Style = tuple[str, str, Any]
"""Style of a curve: its name in captions, its colour, and its dashes."""
STYLES: tuple[Style, ...] = (
    ("orange", VERMILION, "-"),
    ("blue, dashed", SKY, (0, (4, 4))),
    ("green", GREEN, "-"),
    ("yellow, dashed", YELLOW, (0, (4, 4))),
    ("pink", PURPLE, "-"),
)
"""Styles of curves, as on the page. Every other one is dashed, so that two that coincide both show."""
TITLE_LINE_IN = 0.15
TICK_STEPS = (1, 2, 2.5, 5, 10)
USUAL = "#dcefe4"
"""Shading of the range that sound recordings have."""


def draw_frames(side: SideFindings) -> Drawn | None:
    """Draw every picture of a side: a row for each frame, as recorded and then as processed."""
    if not side.pictures:
        return None
    frames, styles = list(side.pictures.items()), curve_styles(side)
    most = max(len(pictures) for _, pictures in frames)
    # B-scans are wide: a row for each frame. Images of a camera are not: a column for each.
    down = not _is_image(frames[0][1][0])
    rows, columns = (len(frames), most) if down else (most, len(frames))
    pitch_in = PAGE_WIDTH_IN / columns
    width_in = pitch_in - 0.58
    panels = {
        (k, n) if down else (n, k): (place_of, picture)
        for k, (place_of, pictures) in enumerate(frames)
        for n, picture in enumerate(pictures)
    }
    last = frames[-1][0]
    titles = {at: wrapped(_title(side, *what), width_in) for at, what in panels.items()}
    heights_in, tops_in, below_in = [], [], 0.0
    for row in range(rows):
        of_row = {at: what for at, what in panels.items() if at[0] == row}
        lines = max(titles[at].count("\n") + 1 for at in of_row)
        entries = max((len(picture.curves) for place_of, picture in of_row.values() if place_of == last), default=0)
        tops_in.append(below_in + TITLE_LINE_IN * lines)
        heights_in.append(max(_height_in(picture, width_in) for _, picture in of_row.values()))
        below_in = tops_in[row] + heights_in[row] + 0.45 + TITLE_LINE_IN * math.ceil(entries / 2)
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, below_in)
        for (row, column), (place_of, picture) in panels.items():
            axes = place(figure, column * pitch_in + 0.5, tops_in[row], width_in, heights_in[row])
            show_picture(axes, picture, styles, legend=place_of == last, y_label=down or column == 0)
            axes.set_title(titles[row, column], pad=3)
        rendered = render(figure, f"frames-{side.name}")
    drawn = ", ".join(f"{label} ({name})" for label, (name, *_) in styles.items())
    drawn = f" Drawn in: {drawn}." if drawn else ""
    about = "".join(f" {text}" for text in dict.fromkeys(p.about for ps in side.pictures.values() for p in ps) if text)
    gaps = any(np.isnan(p.image).any() for ps in side.pictures.values() for p in ps if p.image.dtype.kind == "f")
    hatched = " Hatched: not valid." if gaps else ""
    return Drawn(
        rendered,
        "frames",
        f"Single frames, {side.name}",
        f"Frames at {len(frames)} place{'s' if len(frames) > 1 else ''} along the recording, before and after."
        f"{drawn}{about}{hatched}",
    )


def draw_depth(side: SideFindings) -> Drawn | None:
    """Draw the colour-coded depth of a side on its own rows, next to its pictured frames (Laves 2019, Fig. 4)."""
    panorama = side.panorama
    if panorama.depth_mm is None or not (panorama.valid & np.isfinite(panorama.depth_mm)).any():
        return None
    grid = panorama.grid
    length_mm, around_mm = grid.n_z * grid.dz_mm * z_stretch(grid), 2 * np.pi * grid.radius_mm
    wall_in = float(np.clip(MAX_PANEL_HEIGHT_IN * around_mm / length_mm, 1.2, 3.4))
    wall_height_in = wall_in * length_mm / around_mm
    right_in, styles = LEFT_IN + wall_in + 0.65, curve_styles(side)
    pitch_in = max(wall_height_in / max(1, len(side.pictures)), 1.2)
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, max(wall_height_in, pitch_in * len(side.pictures)))
        axes = place(figure, LEFT_IN, 0.0, wall_in, wall_height_in)
        wall_panel(axes, grid, f"(a) {side.name}, depth")
        coarse, depth_mm, valid = thinned(grid, panorama.depth_mm, panorama.valid)
        low, high = robust_limits(depth_mm, valid)
        image = show_surface(axes, coarse, depth_mm, valid & np.isfinite(depth_mm), DEPTH_COLOURS, low, high)
        colour_bar(axes, image, "wall radius − bore radius (mm)")
        for k, (place_of, pictures) in enumerate(side.pictures.items()):
            colour = PLACES[k % len(PLACES)]
            if place_of < side.frame_z_mm.size:
                _mark_place(axes, float(side.frame_z_mm[place_of]), colour)
            part = place(figure, right_in, k * pitch_in, PAGE_WIDTH_IN - right_in - 0.1, min(pitch_in - 0.3, 2.2))
            last = k == len(side.pictures) - 1
            show_picture(part, pictures[-1], styles, legend=last, x_label=last, y_label=k == len(side.pictures) // 2)
            part.set_title(f"({chr(ord('b') + k)}) {place_label(side, place_of)}", pad=3)
            for spine in part.spines.values():
                spine.set(color=colour, linewidth=1.6)
        rendered = render(figure, f"depth-{side.name}")
    return Drawn(
        rendered,
        "depth",
        f"Colour-coded depth, {side.name}",
        "(a) Depth of the wall on the side's own rows and in its own frame, before any alignment: no interpolation. "
        "Hatched: not observed." + (" Right: the frames at the lines of their colour." if side.pictures else ""),
    )


def curve_styles(side: SideFindings) -> dict[str, Style]:
    """Return how every curve is drawn, by its label, alike in all pictures of a side."""
    labels = dict.fromkeys(label for pictures in side.pictures.values() for one in pictures for label in one.curves)
    return {label: STYLES[k % len(STYLES)] for k, label in enumerate(labels)}


def show_picture(
    axes: Axes,
    picture: Picture,
    styles: Mapping[str, Style],
    *,
    legend: bool = True,
    x_label: bool = True,
    y_label: bool = True,
) -> None:
    """Draw one picture with its curves; with equal scales where both axes have one unit of length or pixels."""
    image: NDArray[Any] = picture.image
    x_scale, x_name = _degrees_for_radians(picture.x_label)
    left, right = (x_scale * x for x in picture.x_extent)
    top, bottom = picture.y_extent
    half_x = (right - left) / max(1, image.shape[1] - 1) / 2
    half_y = (bottom - top) / max(1, image.shape[0] - 1) / 2
    options: dict[str, Any] = {
        "extent": (left - half_x, right + half_x, bottom + half_y, top - half_y),
        "aspect": "equal" if _is_image(picture) else "auto",
        "interpolation": "auto",
    }
    if image.ndim == 2:
        low, high = robust_limits(image, np.isfinite(image), 1, 99.7)
        hatch_not_observed(axes)  # NaN is left out
        axes.imshow(image, cmap="gray", vmin=low, vmax=high, **options)
    else:
        axes.imshow(image, **options)
    for label, curve in picture.curves.items():
        _, colour, dashes = styles[label]
        axes.plot(x_scale * curve[:, 0], curve[:, 1], color=colour, linewidth=0.9, linestyle=dashes, label=label)
    axes.set_xlim(left - half_x, right + half_x)
    axes.set_ylim(bottom + half_y, top - half_y)
    if y_label:
        axes.set_ylabel(picture.y_label)
    if x_label:
        axes.set_xlabel(x_name)
    else:
        axes.tick_params(labelbottom=False)
    if unit_of(x_name) in ("°", "deg") and right - left > 180:
        axes.set_xticks([0, 90, 180, 270, 360])
    if legend and picture.curves:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=4.2, frameon=False, ncols=2, handlelength=1.4
        )


def place_label(side: SideFindings, place_of: int) -> str:
    """Return "slice 12, z = 2.40 mm": where a pictured frame lies, in the order of ascending z from 0."""
    label = f"{side.panorama.frame_dim} {place_of}"
    return label + (f", z = {side.frame_z_mm[place_of]:.2f} mm" if place_of < side.frame_z_mm.size else "")


def _title(side: SideFindings, place_of: int, picture: Picture) -> str:
    """Return the title over a picture, with the frame where the plug-in does not name it."""
    return picture.title if re.search(r"\d", picture.title) else f"{place_label(side, place_of)}: {picture.title}"


def _degrees_for_radians(label: str) -> tuple[float, str]:
    if unit_of(label) == "rad":
        return math.degrees(1), label[: label.rindex("(")] + "(°)"
    return 1.0, label


def _is_image(picture: Picture) -> bool:
    unit = unit_of(picture.x_label)
    return unit in ("px", "mm") and unit == unit_of(picture.y_label)


def _height_in(picture: Picture, width_in: float) -> float:
    if _is_image(picture):
        (left, right), (top, bottom) = picture.x_extent, picture.y_extent
        return float(np.clip(width_in * abs((bottom - top) / (right - left)), 0.5, 2.6))
    return 0.47 * width_in


def _mark_place(axes: Axes, z_mm: float, colour: str) -> None:
    axes.axhline(z_mm, color="white", linewidth=2.0)
    axes.axhline(z_mm, color=colour, linewidth=1.1)


def draw_quality(side: SideFindings) -> Drawn | None:
    """Draw the few numbers that say how good the frames are, with their usual ranges; flagged frames are marked."""
    main, _ = main_and_others(side)
    if not main or side.frame_z_mm.size < 2:
        return None
    usual = "Green: usual in sound recordings. " if any(one.usual for one in main) else ""
    dim = side.panorama.frame_dim
    return Drawn(
        _plots(side, main, f"quality-{side.name}"),
        f"quality-{side.name}",
        f"How good the {dim}s of {side.name} are",
        f"A dot a {dim}, against its z in the side's own frame. {usual}{_flags_text(side)}",
    )


def draw_other_numbers(side: SideFindings) -> Drawn | None:
    """Draw every other number that differs from frame to frame."""
    _, others = main_and_others(side)
    if not others or side.frame_z_mm.size < 2:
        return None
    dim = side.panorama.frame_dim
    return Drawn(
        _plots(side, others, f"numbers-{side.name}"),
        f"numbers-{side.name}",
        f"What was measured of each {dim} of {side.name}",
        f"A dot a {dim}, against its z in the side's own frame. {_flags_text(side)}",
    )


def _flags_text(side: SideFindings) -> str:
    flags = [what for what, frames in flagged_frames(side) if frames.any()]
    return f"Red crosses: {' or '.join(flags)}." if flags else ""


def _plots(side: SideFindings, numbers: list[Number], name: str) -> Rendered:
    z_mm = side.frame_z_mm
    flagged = np.zeros(z_mm.size, dtype=np.bool_)
    for _, frames in flagged_frames(side):
        flagged |= frames
    columns = 2 if len(numbers) > 1 else 1
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 1.05 * math.ceil(len(numbers) / columns))
        pitch_in = PAGE_WIDTH_IN / columns
        for k, one in enumerate(numbers):
            row, column = divmod(k, columns)
            axes = place(figure, column * pitch_in + 0.5, row * 1.05, pitch_in - 0.6, 0.8)
            _plot(axes, one, z_mm, flagged)
            if k + columns >= len(numbers):
                axes.set_xlabel("z, inward (mm)")
            else:
                axes.tick_params(labelbottom=False)
        return render(figure, name)


def _plot(axes: Axes, one: Number, z_mm: NDArray[Any], flagged: Mask) -> None:
    values = one.values
    # an angle that runs right round gets no lines over its jumps
    wraps = one.unit == "°" and np.nanmax(values) - np.nanmin(values) > 300
    axes.plot(z_mm, values, ".", color=BLUE, markersize=2.5)
    if not wraps:
        axes.plot(z_mm, values, "-", color=BLUE, linewidth=0.5, alpha=0.5)
    if flagged.any():
        axes.plot(z_mm[flagged], values[flagged], "x", color=VERMILION, markersize=4.5, markeredgewidth=1.0)
    if one.usual is not None:
        _show_usual(axes, one.values, one.usual)
    axes.set_title(one.axis_title, pad=2, fontsize=7.5)
    axes.grid(color="#e6e6e6", linewidth=0.4)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    axes.spines["left"].set_color(INK)
    axes.margins(y=0.12)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=TICK_STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=TICK_STEPS))
    axes.ticklabel_format(axis="y", useOffset=False)


def _show_usual(axes: Axes, values: NDArray[np.float64], usual: tuple[float, float]) -> None:
    """Shade the usual range, and have its finite limits in view."""
    finite = values[np.isfinite(values)]
    limits = [limit for limit in usual if math.isfinite(limit)]
    low, high = min(*limits, finite.min(), float("inf")), max(*limits, finite.max(), -float("inf"))
    margin = 0.12 * (high - low or 1.0)
    axes.set_ylim(low - margin, high + margin)
    axes.axhspan(max(usual[0], low - margin), min(usual[1], high + margin), color=USUAL, linewidth=0, zorder=0)
