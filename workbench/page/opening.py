"""Folders of endoct, opened for the page. Of the images only what a first view needs is read."""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.zarr.window import ChunkCache
from endoct.fusion.files.store import ComparisonOutline
from endoct.fusion.files.store import read_outline as read_comparison
from endoct.stitching.store import PanoramaOutline, is_panorama
from endoct.stitching.store import read_outline as read_panorama
from endoct.workbench.page.cell_rows import cell_parts, cells_by_truth
from endoct.workbench.page.description import Description, OutlinePart, WallPart
from endoct.workbench.page.drawn_masks import DrawnMasks
from endoct.workbench.page.heading import Fact, Heading, comparison_heading, panorama_heading
from endoct.workbench.page.layers import (
    CELLS,
    DIFFERENCE,
    Classes,
    Described,
    comparison_layers,
    is_drawn_key,
    panorama_layers,
    wall_of,
)
from endoct.workbench.page.presence import Origin
from endoct.workbench.page.recorded import Reader, recording_of
from endoct.workbench.page.sessions import session_of
from endoct.workbench.page.shown import Shown, ShownSide, frames_part
from endoct.workbench.page.volume import has_volume
from endoct.workbench.page.wall import Wall
from endoct.workbench.report.pictures import PICTURES
from endoct.workbench.report.sections import comparison_sections, panorama_sections

MOST_PANES = 3
"""At first; people open more."""
CACHE_BYTES = 16_000_000
"""Of chunks that are kept for the next tile."""


def can_be_shown(path: Path) -> bool:
    """Say whether ``path`` is, or should be, a comparison or a panorama."""
    return is_panorama(path) or (path / "comparison.zarr").is_dir()


def open_shown(path: Path) -> Shown:
    """Open what `endoct compare` or `endoct unroll` wrote to ``path``.

    Raises :class:`EndoctError` where it is neither, damaged, or replaced meanwhile.
    """
    origin = Origin(path)
    if can_be_shown(path):
        shown = _panorama(origin) if is_panorama(path) else _comparison(origin)
        origin.check_present()
        return shown
    raise EndoctError(
        f"{path} cannot be shown",
        found="neither comparison.zarr nor a panorama" if path.is_dir() else "no such folder",
        expected="a folder written by `endoct compare`, or a panorama written by `endoct unroll`",
    )


def _comparison(origin: Origin) -> Shown:
    folder = origin.folder
    outline = read_comparison(folder / "comparison.zarr")
    wall = wall_of(outline.grid)
    outlines = [read_panorama(folder / "panoramas" / f"{name}.zarr") for name in outline.names]
    described = list(comparison_layers(folder, outline, outlines, wall, ChunkCache(CACHE_BYTES)))
    aligned = outline.alignment is not None
    sides = {name: _side(of_side, folder) for name, of_side in zip(outline.names, outlines, strict=True)}
    frames = [
        frames_part(name, side.outline, outline.alignment if k else None, side.pictures, side.reader)
        for k, (name, side) in enumerate(sides.items())
    ]
    real = cells_by_truth(folder, outline.names) if outline.cells else {}
    heading = comparison_heading(_name(folder), _facts(folder / "result.json", wall), outline)
    description = Description(
        title=heading.title,
        verdict=_spoken_against(heading),
        endoct=heading.endoct,
        sides=outline.names,
        wall=WallPart(wall.radius_mm, wall.top_mm, wall.bottom_mm),
        layers=tuple(one.part for one in described),
        outlines=tuple(_outlines(described)),
        cells=tuple(cell_parts(outline.cells, outline.names, real, aligned=aligned)),
        frames=tuple(frames),
        panes=_first_panes(described, outline),
        has_common_places=aligned,
        has_volume=False,
    )
    layers = {one.part.key: one.layer for one in described}
    sections, session = comparison_sections(outline.result), session_of(origin, outline, (outlines[0], outlines[1]))
    masks = DrawnMasks(origin, outline, {name: side.outline for name, side in sides.items()}, session.refused)
    return Shown(heading, sections, description, wall, layers, origin, sides, session, masks)


def _panorama(origin: Origin) -> Shown:
    store = origin.folder
    outline = read_panorama(store)
    wall = wall_of(outline.grid)
    described = list(panorama_layers(store, outline, wall, ChunkCache(CACHE_BYTES)))
    side = _side(outline, store)
    heading = panorama_heading(_name(store), _facts(store / "zarr.json", wall), outline)
    description = Description(
        title=heading.title,
        verdict=_spoken_against(heading),
        endoct=heading.endoct,
        sides=(outline.modality,),
        wall=WallPart(wall.radius_mm, wall.top_mm, wall.bottom_mm),
        layers=tuple(one.part for one in described),
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


def _side(outline: PanoramaOutline, folder: Path) -> ShownSide:
    recording = recording_of(outline, folder)
    return ShownSide(outline, folder / PICTURES, None if recording is None else Reader(recording))


def _spoken_against(heading: Heading) -> str:
    return "" if heading.verdict.level == "trusted" else heading.verdict.headline


def _facts(file: Path, wall: Wall) -> tuple[Fact, ...]:
    written = time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))
    return (
        ("written", written),
        ("bore", f"⌀ {2 * wall.radius_mm:.3g} mm"),
        ("z", f"{wall.top_mm:.2f} to {wall.bottom_mm:.2f} mm".replace("-", "−")),
    )


def _outlines(described: Iterable[Described]) -> Iterator[OutlinePart]:
    for one in described:
        if one.part.key != DIFFERENCE and isinstance(one.layer, Classes) and one.part.side is not None:
            side, colour, is_drawn = one.part.side, one.part.classes[-1].colour, is_drawn_key(one.part.key)
            title = one.part.title if is_drawn else side
            yield OutlinePart(one.part.key, side, title, colour, is_drawn)


def _first_panes(described: Iterable[Described], outline: ComparisonOutline) -> tuple[str, ...]:
    """Return of either side what shows its cells best, then the difference; where there is none, the cells."""
    parts = [one.part for one in described]
    best = []
    for side in outline.names:
        keys = [part.key for part in parts if part.side == side]
        best.append(next((key for key in keys if key.endswith("relief")), keys[0]))
    last = [DIFFERENCE] if outline.alignment is not None else [f"{outline.names[1]}-{CELLS}"]
    return (*best, *last)[:MOST_PANES]


def _name(path: Path) -> str:
    return path.resolve().name.removesuffix(".zarr")
