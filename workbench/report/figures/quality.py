"""Per-frame quality and geometry along the bore, whatever a modality reports."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from endoct.stitching.arrays import Mask
from endoct.stitching.circle import wrap_rad
from endoct.workbench.report.figures.drawing import (
    BLUE,
    INK,
    PAGE_WIDTH_IN,
    VERMILION,
    Drawn,
    journal_style,
    new_figure,
    place,
    save,
)
from endoct.workbench.report.findings import SideFindings
from endoct.workbench.report.flags import flagged_frames

MAX_COMPONENTS = 4
TICK_STEPS = (1, 2, 2.5, 5, 10)


def draw_quality(side: SideFindings, folder: Path) -> Drawn | None:
    """Draw every varying number per frame against z, frames that were not trusted marked."""
    z_mm, numbers = side.frame_z_mm, _numbers(side)
    varying = {name: one for name, one in numbers.items() if _varies(one.values)}
    if not varying or z_mm.size < 2:
        return None
    doubted = [(doubt, frames) for doubt, frames in flagged_frames(side) if frames.any()]
    flagged = np.zeros(z_mm.size, dtype=np.bool_)
    for _, frames in doubted:
        flagged |= frames
    columns = 2 if len(varying) > 1 else 1
    rows = math.ceil(len(varying) / columns)
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 1.05 * rows)
        pitch_in = PAGE_WIDTH_IN / columns
        for k, one in enumerate(varying.values()):
            row, column = divmod(k, columns)
            axes = place(figure, column * pitch_in + 0.5, row * 1.05, pitch_in - 0.6, 0.8)
            _plot(axes, one, z_mm, flagged)
            if k + columns >= len(varying):
                axes.set_xlabel("z, inward (mm)")
            else:
                axes.tick_params(labelbottom=False)
        saved = save(figure, folder / f"quality-{side.name}.png")
    finite = {name: v.values[np.isfinite(v.values)] for name, v in numbers.items() if np.isfinite(v.values).any()}
    constant = [f"{name} = {v[0]:.4g}" for name, v in finite.items() if name not in varying]
    caption = (
        f"Against each {side.panorama.frame_dim}'s z in the side's own frame. "
        + (f"Red crosses: {' or '.join(doubt for doubt, _ in doubted)}. " if flagged.any() else "")
        + (f"The same throughout: {', '.join(constant)}." if constant else "")
    )
    return Drawn(saved, "quality", f"Quality per {side.panorama.frame_dim}, {side.name}", caption)


@dataclass(frozen=True, eq=False)
class _Number:
    """One number per frame, float64 (n_frames,), with what its plot is called and its unit."""

    values: NDArray[np.float64]
    title: str
    unit: str


def _numbers(side: SideFindings) -> dict[str, _Number]:
    """Return every number per frame by name; a short vector becomes its components."""
    numbers: dict[str, _Number] = {}
    dim = side.panorama.frame_dim
    for name, one in sorted(side.panorama.per_frame.items()):  # a Zarr group keeps no order
        values = one.values
        if (
            name in (f"{dim}_z_mm", f"{dim}_index")
            or values.dtype == np.bool_
            or not np.issubdtype(values.dtype, np.number)
        ):
            continue
        if values.ndim == 1:
            numbers[name] = _Number(values.astype(np.float64), one.title, one.unit)
        elif values.ndim == 2 and values.shape[1] <= MAX_COMPONENTS:
            numbers |= {
                f"{name}[{k}]": _Number(values[:, k].astype(np.float64), f"{one.title} [{k}]", one.unit)
                for k in range(values.shape[1])
            }
    return {name: one for name, one in numbers.items() if one.values.size == side.frame_z_mm.size}


def _plot(axes: Axes, one: _Number, z_mm: NDArray[Any], flagged: Mask) -> None:
    is_angle = one.unit == "rad"
    unit = "°" if is_angle else one.unit
    plotted = np.degrees(_around_mean(one.values)) if is_angle else one.values
    # an angle that runs right round gets no lines over its jumps
    wraps = is_angle and np.nanmax(plotted) - np.nanmin(plotted) > 300
    axes.plot(z_mm, plotted, ".", color=BLUE, markersize=2.5)
    if not wraps:
        axes.plot(z_mm, plotted, "-", color=BLUE, linewidth=0.5, alpha=0.5)
    if flagged.any():
        axes.plot(z_mm[flagged], plotted[flagged], "x", color=VERMILION, markersize=4.5, markeredgewidth=1.0)
    axes.set_title(f"{one.title} ({unit})" if unit else one.title, pad=2, fontsize=7.5)
    axes.grid(color="#e6e6e6", linewidth=0.4)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    axes.spines["left"].set_color(INK)
    axes.margins(y=0.12)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=TICK_STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=TICK_STEPS))
    axes.ticklabel_format(axis="y", useOffset=False)


def _around_mean(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles within half a turn of their mean on the circle, so that none jumps at 0/2π without need."""
    finite = angle_rad[np.isfinite(angle_rad)]
    mean = float(np.angle(np.exp(1j * finite).mean()))
    mean = mean if mean > -np.pi / 2 else mean + 2 * np.pi
    return np.asarray(mean + wrap_rad(angle_rad - mean))


def _varies(values: NDArray[np.float64]) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size > 0 and bool(np.ptp(finite) > 1e-9 * max(1.0, float(np.abs(finite).max())))
