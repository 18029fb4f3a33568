"""Per-frame quality and geometry along the bore, whatever a modality reports."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from endoct.stitching.arrays import Mask
from endoct.workbench.figures.drawing import BLUE, INK, PAGE_WIDTH_IN, VERMILION, Drawn, journal_style, new_figure, save
from endoct.workbench.findings import SideFindings

TRUSTED_WHEN_SET = ("trusted", "reliable", "observed", "fitted", "valid")
"""Flags named so (or ending so) speak for a frame; every other flag, "bridged" say, speaks against it."""

UNITS = {"mm": "mm", "rad": "°", "px": "px", "hz": "Hz", "deg": "°", "s": "s"}
MAX_COMPONENTS = 4


def draw_quality(side: SideFindings, folder: Path) -> Drawn | None:
    """Draw every varying number per frame against z, frames that were not trusted marked."""
    z_mm, numbers = side.frame_z_mm, _numbers(side)
    varying = {name: v for name, v in numbers.items() if np.isfinite(v).any() and not _is_constant(v)}
    if not varying or z_mm.size < 2:
        return None
    suspect = not_trusted(side)
    flagged = np.zeros(z_mm.size, dtype=np.bool_)
    for flags in suspect.values():
        flagged |= flags
    columns = 2 if len(varying) > 1 else 1
    rows = math.ceil(len(varying) / columns)
    with journal_style():
        figure = new_figure(PAGE_WIDTH_IN, 1.05 * rows + 0.5)
        first: Axes | None = None
        for k, (name, values) in enumerate(varying.items()):
            axes = figure.add_subplot(rows, columns, k + 1, sharex=first)
            first = first or axes
            _plot(axes, name, values, z_mm, flagged)
            axes.tick_params(labelbottom=k + columns >= len(varying))
        figure.supxlabel("z (mm)", fontsize=7.5)
        path = folder / f"quality-{side.name}.png"
        width_in = save(figure, path)
    finite = {name: v[np.isfinite(v)] for name, v in numbers.items() if np.isfinite(v).any()}
    constant = [f"{name} = {v[0]:.4g}" for name, v in finite.items() if name not in varying]
    caption = (
        f"Against each {side.panorama.frame_dim}'s z in the side's own frame. "
        + (f"Red crosses: {' or '.join(_flag_label(name) for name in suspect)}. " if flagged.any() else "")
        + (f"The same throughout: {', '.join(constant)}." if constant else "")
    )
    return Drawn(path, "quality", f"Quality per {side.panorama.frame_dim}, {side.name}", caption, width_in)


def not_trusted(side: SideFindings) -> Mapping[str, Mask]:
    """Return per flag that a modality reports the frames, bool (n_frames,), for which it speaks against them."""
    found = {}
    for name, values in side.panorama.per_frame.items():
        if values.dtype == np.bool_ and values.ndim == 1:
            found[name] = ~values if _speaks_for(name) else values
    return found


def flag_sentences(side: SideFindings) -> list[str]:
    """Say per flag which frames it concerns: "4 of 40 slices are bridged: 3, 17–19 (z = 0.60, 3.40–3.80 mm)."."""
    sentences = []
    for name, flags in not_trusted(side).items():
        if flags.any():
            runs = _runs(np.flatnonzero(flags))
            where = ", ".join(_span(*run) for run in runs)
            place = ""
            if side.frame_z_mm.size == flags.size:
                at = [f"{side.frame_z_mm[a]:.2f}" + (f"–{side.frame_z_mm[b]:.2f}" if b > a else "") for a, b in runs]
                place = f" (z = {', '.join(at)} mm)"
            frame = side.panorama.frame_dim
            verb = "is" if flags.sum() == 1 else "are"
            sentences.append(f"{flags.sum()} of {flags.size} {frame}s {verb} {_flag_label(name)}: {where}{place}.")
    return sentences


def _numbers(side: SideFindings) -> dict[str, NDArray[np.float64]]:
    """Return every number per frame by name, each float64 (n_frames,); a short vector becomes its components."""
    numbers: dict[str, NDArray[np.float64]] = {}
    place = f"{side.panorama.frame_dim}_z_mm"
    for name, values in side.panorama.per_frame.items():
        if name in (place, "index") or values.dtype == np.bool_ or not np.issubdtype(values.dtype, np.number):
            continue
        if values.ndim == 1:
            numbers[name] = values.astype(np.float64)
        elif values.ndim == 2 and values.shape[1] <= MAX_COMPONENTS:
            numbers |= {f"{name}[{k}]": values[:, k].astype(np.float64) for k in range(values.shape[1])}
    return {name: values for name, values in numbers.items() if values.size == side.frame_z_mm.size}


def _plot(axes: Axes, name: str, values: NDArray[np.float64], z_mm: NDArray[Any], flagged: Mask) -> None:
    label, unit = _label_and_unit(name)
    shown = np.degrees(values) if unit == "°" and "rad" in name else values
    wraps = unit == "°" and np.nanmax(shown) - np.nanmin(shown) > 180
    axes.plot(z_mm, shown, ".", color=BLUE, markersize=2.5)
    if not wraps:
        axes.plot(z_mm, shown, "-", color=BLUE, linewidth=0.5, alpha=0.5)
    if flagged.any():
        axes.plot(z_mm[flagged], shown[flagged], "x", color=VERMILION, markersize=4.5, markeredgewidth=1.0)
    axes.set_title(f"{label} ({unit})" if unit else label, pad=2, fontsize=7.5)
    axes.grid(color="#e6e6e6", linewidth=0.4)
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)
    axes.spines["left"].set_color(INK)
    axes.margins(y=0.12)
    axes.ticklabel_format(axis="y", useOffset=False)


def _label_and_unit(name: str) -> tuple[str, str]:
    base, bracket, component = name.partition("[")
    words = base.split("_")
    unit = UNITS.get(words[-1], "") if len(words) > 1 else ""
    label = " ".join(words[:-1] if unit else words)
    return f"{label} {bracket}{component}".strip(), unit


def _is_constant(values: NDArray[np.float64]) -> bool:
    finite = values[np.isfinite(values)]
    return bool(np.ptp(finite) <= 1e-9 * max(1.0, float(np.abs(finite).max())))


def _speaks_for(name: str) -> bool:
    return name.split("_")[-1] in TRUSTED_WHEN_SET


def _flag_label(name: str) -> str:
    return ("not " if _speaks_for(name) else "") + name.replace("_", " ")


def _runs(indices: NDArray[np.intp]) -> list[tuple[int, int]]:
    breaks = np.flatnonzero(np.diff(indices) > 1)
    starts = indices[np.r_[0, breaks + 1]]
    ends = indices[np.r_[breaks, indices.size - 1]]
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def _span(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}–{last}"
