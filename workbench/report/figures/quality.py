"""Numbers per frame along the bore: the few that say how good the frames are, and all others."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.workbench.report.figures.drawing import (
    BLUE,
    INK,
    PAGE_WIDTH_IN,
    VERMILION,
    journal_style,
    new_figure,
    place,
    render,
)
from endoct.workbench.report.figures.rendered import Drawn, Rendered
from endoct.workbench.report.per_frame import Number, main_and_others
from endoct.workbench.report.side_findings import SideFindings, flagged_frames

TICK_STEPS = (1, 2, 2.5, 5, 10)
USUAL = "#dcefe4"
"""Behind values as sound recordings have them."""


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
