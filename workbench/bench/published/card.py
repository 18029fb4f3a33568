"""What a data card shows of a set: true masks as pictures, a sheet of examples, and what walls are like by kind."""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from imagecodecs import png_encode
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.regions import label
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.published.specimen_set import Entry, SpecimenSet
from endoct.workbench.pipeline.truth import load_truth
from endoct.workbench.report.figures.drawing import (
    DEPTH_COLOURS,
    INTENSITY_COLOURS,
    MASK_COLOURS,
    NOT_OBSERVED,
    PAGE_WIDTH_IN,
    journal_style,
)

DEEPEST_MM = 1.0
DARK, BRIGHT = 1.0, 99.0
"""Percentiles of brightness that are black and white."""
DPI = 120
LABEL_PT = 5.5
"""Of names, so that the longest is no longer than its row is high."""
DIGITS = (0, 1, 2)
"""Of the number of cells, their share of the wall, and their depth."""


def pictures(folder: Path, listed: SpecimenSet) -> Iterator[tuple[str, bytes]]:
    """Yield files that show the specimens of a set: ``masks/NAME.png``, 255 where the wall is cell, and a sheet."""
    for entry in listed.specimens:
        mask = np.where(_wall(folder, entry)[0], np.uint8(255), np.uint8(0))
        yield f"masks/{entry.name}.png", bytes(png_encode(mask))
    yield "examples.png", _sheet(folder, [entries[0] for entries in by_kind(listed).values()])


def by_kind(listed: SpecimenSet) -> Mapping[tuple[str, str, str], list[Entry]]:
    """Return the specimens of a set by generator, difficulty and tasks."""
    kinds: dict[tuple[str, str, str], list[Entry]] = {}
    for entry in listed.specimens:
        kinds.setdefault((entry.generator, entry.difficulty, " ".join(entry.tasks)), []).append(entry)
    return kinds


def walls_of_kinds(folder: Path, listed: SpecimenSet) -> str:
    """Return a line of a table for each kind of specimen.

    It says how many there are, and medians (lowest to highest) of the number of cells, of the percentage of the wall
    that they take, and of their median depth in mm, "–" where no wall has a cell.
    """
    return "\n".join(
        f"| {' | '.join(kind)} | {len(entries)} | {' | '.join(_spreads(folder, entries))} |"
        for kind, entries in by_kind(listed).items()
    )


def _spreads(folder: Path, entries: list[Entry]) -> Iterator[str]:
    walls = [_wall(folder, entry) for entry in entries]
    depths = [float(np.median(relief_mm[cell])) for cell, relief_mm in walls if cell.any()]
    counts = [float(label(cell)[1]) for cell, _ in walls]
    shares = [100 * float(cell.mean()) for cell, _ in walls]
    for values, n in zip((counts, shares, depths), DIGITS, strict=True):
        yield f"{np.median(values):.{n}f} ({min(values):.{n}f}–{max(values):.{n}f})" if values else "–"


def _wall(folder: Path, entry: Entry) -> tuple[Mask, Image]:
    wall = load_truth(folder / entry.name).wall
    return np.asarray(wall["cell"], np.bool_), np.asarray(wall["relief_mm"], np.float32)


def _sheet(folder: Path, entries: list[Entry]) -> bytes:
    """Return a PNG with a row a specimen: both panoramas and the true cells, θ upward and z to the right."""
    with journal_style():
        figure = Figure(figsize=(PAGE_WIDTH_IN, 1.2 * len(entries) + 0.2), dpi=DPI, layout="constrained")
        rows = figure.subplots(len(entries), 3, squeeze=False)
        for entry, (light, depth, cells) in zip(entries, rows, strict=True):
            light.set_ylabel(entry.name, fontsize=LABEL_PT)
            if "endoscope" in entry.unrolled:
                panorama = load_panorama(folder / entry.name / "endoscope.zarr")
                black, white = np.percentile(panorama.intensity[panorama.valid], (DARK, BRIGHT))
                shown = np.where(panorama.valid, panorama.intensity, np.nan)
                _draw(light, shown, INTENSITY_COLOURS, black, white)
            if "oct" in entry.unrolled:
                panorama = load_panorama(folder / entry.name / "oct.zarr")
                if panorama.depth_mm is not None:
                    shown = np.where(panorama.valid, panorama.depth_mm, np.nan)
                    _draw(depth, shown - np.nanmedian(shown), DEPTH_COLOURS, 0, DEEPEST_MM)
            _draw(cells, _wall(folder, entry)[0], MASK_COLOURS, 0, 1)
        for axes, title in zip(rows[0], ("endoscope", f"OCT, depth to {DEEPEST_MM:g} mm", "true cells"), strict=True):
            axes.set_title(title)
        for axes in rows.flat:
            axes.set(xticks=[], yticks=[], facecolor=NOT_OBSERVED)
        file = io.BytesIO()
        figure.savefig(file, format="png", metadata={"Software": None})
        return file.getvalue()


def _draw(axes: Axes, image: Image | Mask, colours: object, low: float, high: float) -> None:
    axes.imshow(image.T, cmap=colours, vmin=low, vmax=high, aspect="auto", origin="lower")  # type: ignore[arg-type]
