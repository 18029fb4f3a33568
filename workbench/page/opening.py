"""Folders of endoct, opened for the page. Of the images only what a first view needs is read.

The cells of a comparison become rows of a table: what each measures, and what the other side has there. Where there is
a truth, the rows also say whether it has a cell there.
"""

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.numeric.regions import label_in_order
from endoct.base.zarr.window import ChunkCache
from endoct.base.zarr.zarr_store import read_arrays
from endoct.fusion.files.masks import DRAWN_STORE, MAJORITY, read_drawn
from endoct.fusion.files.store import COMPARISON_STORE, ComparisonOutline
from endoct.fusion.files.store import read_outline as read_comparison
from endoct.fusion.result import Contradiction
from endoct.fusion.scoring.cells import OBSERVED, Cell
from endoct.stitching.store import PanoramaOutline
from endoct.stitching.store import read_outline as read_panorama
from endoct.workbench.kinds import reader, row_at
from endoct.workbench.page.description import CellPart, CellState, Description, OutlinePart, WallPart
from endoct.workbench.page.drawn_masks import DrawnMasks
from endoct.workbench.page.heading import Fact, Heading, comparison_heading, panorama_heading
from endoct.workbench.page.layers import (
    CELLS,
    CONTRADICTIONS,
    DIFFERENCE,
    DRAWN,
    RING_COLOUR,
    WALL,
    Classes,
    Described,
    comparison_layers,
    hex_of,
    panorama_layers,
    rings,
    wall_of,
)
from endoct.workbench.page.presence import Origin
from endoct.workbench.page.recorded import Reader, recording_of
from endoct.workbench.page.saved_masks import saved_layers
from endoct.workbench.page.sessions import session_of
from endoct.workbench.page.shown import Shown, ShownSide, frames_part
from endoct.workbench.page.volume import has_volume
from endoct.workbench.page.wall import TileWall
from endoct.workbench.report.pictures import PICTURES
from endoct.workbench.report.sections import comparison_sections, panorama_sections

MOST_PANES = 3
"""Panes that are open at first."""
CACHE_BYTES = 16_000_000
"""Memory for chunks that are kept for the next tile."""
REAL = 0.5
"""A cell is real where the truth covers at least this share of it, the share that must overlap to match."""


def can_be_shown(path: Path) -> bool:
    """Say whether ``path`` is, or should be, a comparison or a panorama."""
    return (row := row_at(path)) is not None and bool(row.shown)


def open_shown(path: Path) -> Shown:
    """Open what `endoct compare` or `endoct unroll` wrote to ``path``.

    Raises :class:`EndoctError` where it is neither, damaged, or replaced meanwhile.
    """
    origin, row = Origin(path), row_at(path)
    if row is not None and row.shown:
        shown: Shown = reader(row.shown)(origin)
        origin.check_present()
        return shown
    raise EndoctError(
        f"{path} cannot be shown",
        found="neither comparison.zarr nor a panorama" if path.is_dir() else "no such folder",
        expected="a folder written by `endoct compare`, or a panorama written by `endoct unroll`",
    )


def opened_comparison(origin: Origin) -> Shown:
    """Open a comparison. Raises :class:`EndoctError` where it is damaged."""
    folder = origin.folder
    outline = read_comparison(folder / COMPARISON_STORE)
    wall, names, aligned = wall_of(outline.grid), outline.names, outline.alignment is not None
    outlines = [read_panorama(folder / "panoramas" / f"{name}.zarr") for name in names]
    described = list(comparison_layers(folder, outline, outlines, wall, ChunkCache(CACHE_BYTES)))
    own = dict(zip(names, outlines, strict=True))
    described += saved_layers(folder, own, outline, wall)
    sides = {name: _side(of_side, folder) for name, of_side in own.items()}
    frames = [
        frames_part(name, side.outline, outline.alignment if k else None, side.pictures, side.reader)
        for k, (name, side) in enumerate(sides.items())
    ]
    contradictions = outline.result.wall.contradictions if outline.result.wall is not None and aligned else ()
    real = cells_by_truth(folder, names) if outline.cells else {}
    stated = {name: side.provenance for name, side in own.items()}
    heading = comparison_heading(_name(folder), _facts(folder / "result.json", wall), outline, stated)
    outlined = list(_outlines(described, names[0]))
    if contradictions:
        title = f"{len(contradictions)} contradiction{'s' if len(contradictions) != 1 else ''}"
        outlined.append(OutlinePart(CONTRADICTIONS, names[0], title, hex_of(RING_COLOUR), is_drawn=True))
    description = _description(
        heading,
        wall,
        described,
        sides=names,
        outlines=tuple(outlined),
        cells=tuple(cell_parts(outline.cells, names, real, contradictions, aligned=aligned)),
        frames=tuple(frames),
        panes=_first_panes(described, outline),
        has_common_places=aligned,
        has_volume=False,
    )
    layers = {one.part.key: one.layer for one in described}
    sections, session = comparison_sections(outline.result), session_of(origin, outline, (outlines[0], outlines[1]))
    masks = DrawnMasks(origin, outline, own, session.refused)
    rings_by_key = {CONTRADICTIONS: rings(contradictions, wall.radius_mm)} if contradictions else {}
    return Shown(heading, sections, description, wall, layers, origin, sides, session, masks, rings=rings_by_key)


def opened_panorama(origin: Origin) -> Shown:
    """Open a panorama. Raises :class:`EndoctError` where it is damaged."""
    store = origin.folder
    outline = read_panorama(store)
    wall = wall_of(outline.grid)
    described = list(panorama_layers(store, outline, wall, ChunkCache(CACHE_BYTES)))
    side = _side(outline, store)
    heading = panorama_heading(_name(store), _facts(store / "zarr.json", wall), outline)
    description = _description(
        heading,
        wall,
        described,
        sides=(outline.modality,),
        outlines=(),
        cells=(),
        frames=(frames_part(outline.modality, outline, None, side.pictures, side.reader),),
        panes=tuple(one.part.key for one in described)[:MOST_PANES],
        has_common_places=True,
        has_volume=has_volume(store),
    )
    layers = {one.part.key: one.layer for one in described}
    sections, sides = panorama_sections(outline), {outline.modality: side}
    return Shown(heading, sections, description, wall, layers, origin, sides, panorama=store)


def _description(heading: Heading, wall: TileWall, described: Iterable[Described], **rest: Any) -> Description:
    return Description(
        title=heading.title,
        verdict="" if heading.verdict.level == "trusted" else heading.verdict.headline,
        endoct=heading.endoct,
        wall=WallPart(wall.radius_mm, wall.top_mm, wall.bottom_mm),
        layers=tuple(one.part for one in described),
        **rest,
    )


def _side(outline: PanoramaOutline, folder: Path) -> ShownSide:
    recording = recording_of(outline, folder)
    return ShownSide(outline, folder / PICTURES, None if recording is None else Reader(recording))


def _facts(file: Path, wall: TileWall) -> tuple[Fact, ...]:
    z = f"{wall.top_mm:.2f} to {wall.bottom_mm:.2f} mm".replace("-", "−")
    return ("written", written_at(file)), ("bore", f"⌀ {2 * wall.radius_mm:.3g} mm"), ("z", z)


def written_at(file: Path) -> str:
    """Return when a file was written, to the minute."""
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))


def _outlines(described: Iterable[Described], frame_of: str) -> Iterator[OutlinePart]:
    for one in described:
        if one.part.key == f"{WALL}-{CELLS}":
            yield OutlinePart(one.part.key, frame_of, WALL, one.part.classes[-1].colour, is_drawn=True)
        elif one.part.key != DIFFERENCE and isinstance(one.layer, Classes) and one.part.side is not None:
            side, colour, is_drawn = one.part.side, one.part.classes[-1].colour, one.part.key.startswith(DRAWN)
            title = one.part.title if is_drawn else side
            yield OutlinePart(one.part.key, side, title, colour, is_drawn)


def _first_panes(described: Iterable[Described], outline: ComparisonOutline) -> tuple[str, ...]:
    """Return for each side the layer that shows its cells best, then the difference or, without one, the cells."""
    parts = [one.part for one in described]
    best = []
    for side in outline.names:
        keys = [part.key for part in parts if part.side == side]
        best.append(next((key for key in keys if key.endswith("relief")), keys[0]))
    last = [DIFFERENCE] if outline.alignment is not None else [f"{outline.names[1]}-{CELLS}"]
    return (*best, *last)[:MOST_PANES]


def _name(path: Path) -> str:
    return path.resolve().name.removesuffix(".zarr")


def cell_parts(
    cells: Sequence[Cell],
    names: tuple[str, str],
    real: Mapping[tuple[str, int], bool],
    contradictions: Sequence[Contradiction] = (),
    *,
    aligned: bool,
) -> Iterator[CellPart]:
    """Yield every cell as the page shows it; ``real`` by side and number as :func:`cells_by_truth` has it.

    A cell that is one of the ``contradictions`` says so.
    """
    for cell in cells:
        other = names[1] if cell.side == names[0] else names[0]
        is_real = real.get((cell.side, cell.id))
        state, why = _seen(cell, other, aligned=aligned)
        near = [one for one in contradictions if abs(cell.z_mm - one.z_mm) < cell.diameter_mm / 2]
        turned_rad = [cell.theta_rad - one.theta_rad for one in near if one.shown_by == cell.side]
        if any(abs(math.remainder(turn_rad, 2 * math.pi)) < math.radians(10) for turn_rad in turned_rad):
            why += ", surely: the two contradict each other"
        truth = "" if is_real is None else f"; the truth has {'a cell' if is_real else 'no cell'} there"
        yield CellPart(**vars(cell), diameter_mm=cell.diameter_mm, state=state, why=why + truth, is_real=is_real)


def _seen(cell: Cell, other: str, *, aligned: bool) -> tuple[CellState, str]:
    """Return what the other side has where a cell lies."""
    if not aligned:
        return "not aligned", "not aligned: nobody knows where it lies on the other side"
    partner = f"{other} {cell.partner}"
    if not cell.counts:
        shown = f", where it is {partner}" if cell.is_matched else ""
        return "not observed", f"not counted: {other} observed {cell.observed_by_other:.0%} of it{shown}"
    if cell.is_matched and cell.partner:
        return "matched", f"is {partner}: overlap {cell.overlap:.2f}"
    if cell.partner:
        return "overlapping", f"overlaps {partner} by {cell.overlap:.2f}, less than half"
    return "alone", f"only {cell.side}: {other} observed {cell.observed_by_other:.0%} of it and has wall there"


def cells_by_truth(folder: Path, names: tuple[str, str]) -> dict[tuple[str, int], bool]:
    """Return by side and number whether the truth has a cell where each cell of a comparison in ``folder`` lies.

    The truth is the one mask that was given, or what most raters drew. Cells of which it was given for less than half
    are left out; all are where there is no truth. Raises :class:`EndoctError` where a store is damaged.
    """
    drawn = read_drawn(folder)
    raters = [] if drawn is None else [rater for rater, _ in drawn.drawn_by]
    if len(raters) != 1 and MAJORITY not in raters:
        return {}
    k = 0 if len(raters) == 1 else raters.index(MAJORITY)
    with refusing(f"{folder} cannot be read"):
        truth = read_arrays(folder / DRAWN_STORE, ("mask", "valid"))
        masks = read_arrays(folder / COMPARISON_STORE, ("mask",))["mask"]
    return {
        (side, number): is_real
        for side, mask in zip(names, masks, strict=True)
        for number, is_real in _real(mask, truth["mask"][k], truth["valid"][k])
    }


def _real(mask: Mask, truth: Mask, valid: Mask) -> Iterator[tuple[int, bool]]:
    labels = label_in_order(mask)
    n = int(labels.max(initial=0)) + 1
    area, known, covered = (
        np.bincount(labels[where], minlength=n) for where in (np.ones_like(mask), valid, truth & valid)
    )
    for number in range(1, n):
        if known[number] >= OBSERVED * area[number]:
            yield number, bool(covered[number] >= REAL * known[number])
