"""Folders of endoct, opened for the page. Of the images only what a first view needs is read."""

import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypedDict

from endoct.fusion.files.store import ComparisonOutline
from endoct.fusion.files.store import read_outline as read_comparison
from endoct.fusion.result import Result
from endoct.stitching.doubt import Doubt
from endoct.stitching.errors import EndoctError
from endoct.stitching.store import PanoramaOutline, is_panorama
from endoct.stitching.store import read_outline as read_panorama
from endoct.stitching.window import ChunkCache
from endoct.workbench.page.cells import cell_parts
from endoct.workbench.page.description import (
    Description,
    DetailPart,
    DoubtPart,
    FigurePart,
    Level,
    OutlinePart,
    WallPart,
)
from endoct.workbench.page.frames import frames_part
from endoct.workbench.page.layer import Classes
from endoct.workbench.page.layers import (
    CELLS,
    DIFFERENCE,
    Described,
    comparison_layers,
    panorama_layers,
    wall_of,
)
from endoct.workbench.page.recorded import Reader, recording_of
from endoct.workbench.page.shown import Shown, ShownSide
from endoct.workbench.page.wall import Wall
from endoct.workbench.report.doubts import count_doubts
from endoct.workbench.report.findings import overlaps_of
from endoct.workbench.report.scores import score_tables
from endoct.workbench.report.tables import provenance, result_tables
from endoct.workbench.report.verdict import Verdict, verdict_of
from endoct.workbench.report.wording import interval_text, share_text


class _VerdictFields(TypedDict):
    level: Level
    headline: str
    sentences: tuple[str, ...]


MOST_PANES = 3
"""At first; people open more."""


def open_shown(path: Path) -> Shown:
    """Open what `endoct compare` or `endoct unroll` wrote to ``path``.

    Raises :class:`EndoctError` where it is neither, or damaged.
    """
    if is_panorama(path):
        return _panorama(path)
    if (path / "comparison.zarr").is_dir():
        return _comparison(path)
    raise EndoctError(
        f"{path} cannot be shown",
        found="neither comparison.zarr nor a panorama" if path.is_dir() else "no such folder",
        expected="a folder written by `endoct compare`, or a panorama written by `endoct unroll`",
    )


def _comparison(folder: Path) -> Shown:
    outline = read_comparison(folder / "comparison.zarr")
    wall, result = wall_of(outline.grid), outline.result
    described = list(comparison_layers(folder, outline, wall, ChunkCache()))
    aligned = outline.alignment is not None
    sides = {name: _side(folder / "panoramas" / f"{name}.zarr", folder / "pictures") for name in outline.names}
    frames = [
        frames_part(name, side.outline, outline.alignment if k else None, side.pictures)
        for k, (name, side) in enumerate(sides.items())
    ]
    a, b = outline.names
    description = Description(
        endoct=result.versions.get("endoct", ""),
        kind="comparison",
        title=f"{_name(folder)}: {a} and {b}",
        sides=outline.names,
        facts=(*_facts(folder / "result.json", wall), ("frame", f"θ and z of {a}" if aligned else "each side its own")),
        **_verdict(verdict_of(result)),
        doubts=_doubts(result.doubts),
        notes=tuple(DoubtPart("", side, note) for side, said in result.notes.items() for note in said),
        figures=tuple(_figures(result)),
        wall=WallPart(wall.radius_mm, wall.top_mm, wall.bottom_mm),
        layers=tuple(one.part for one in described),
        outlines=tuple(_outlines(described)),
        cells=tuple(cell_parts(outline.cells, outline.names, aligned=aligned)),
        frames=tuple(frames),
        panes=_first_panes(described, outline),
        has_common_places=aligned,
        details=tuple(_details(result)),
    )
    return _shown(description, wall, described, sides)


def _panorama(store: Path) -> Shown:
    outline = read_panorama(store)
    wall = wall_of(outline.grid)
    described = list(panorama_layers(store, outline, wall, ChunkCache()))
    frames = outline.per_frame.get(f"{outline.frame_dim}_z_mm")
    count = 0 if frames is None else frames.values.size
    return _shown(
        Description(
            endoct=str(outline.provenance.get("versions", {}).get("endoct", "")),
            kind="panorama",
            title=f"{_name(store)}: {outline.modality}",
            sides=(outline.modality,),
            facts=(*_facts(store / "zarr.json", wall), (f"{outline.frame_dim}s", str(count))),
            **_verdict(_verdict_of_panorama(outline)),
            doubts=_doubts(outline.doubts),
            notes=tuple(DoubtPart("", None, note) for note in outline.notes),
            figures=(),
            wall=WallPart(wall.radius_mm, wall.top_mm, wall.bottom_mm),
            layers=tuple(one.part for one in described),
            outlines=(),
            cells=(),
            frames=(frames_part(outline.modality, outline, None, None),),
            panes=tuple(one.part.key for one in described)[:MOST_PANES],
            has_common_places=True,
            details=(),
        ),
        wall,
        described,
        {outline.modality: _side(store, None)},
    )


def _side(store: Path, pictures: Path | None) -> ShownSide:
    outline = read_panorama(store)
    recording = recording_of(outline)
    return ShownSide(outline, pictures, None if recording is None else Reader(recording))


def _shown(
    description: Description, wall: Wall, described: Iterable[Described], sides: Mapping[str, ShownSide]
) -> Shown:
    return Shown(description, wall, {one.part.key: one.layer for one in described}, sides)


def _verdict(verdict: Verdict) -> _VerdictFields:
    return {"level": verdict.level, "headline": verdict.headline, "sentences": verdict.sentences}


def _verdict_of_panorama(outline: PanoramaOutline) -> Verdict:
    if outline.doubts:
        return Verdict("doubted", f"Unrolled, with {count_doubts(outline.doubts)}.")
    return Verdict("trusted", "Unrolled; nothing speaks against it as a whole.")


def _facts(file: Path, wall: Wall) -> tuple[tuple[str, str], ...]:
    written = time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))
    return (
        ("written", written),
        ("bore", f"⌀ {2 * wall.radius_mm:.3g} mm"),
        ("z", f"{wall.top_mm:.2f} to {wall.bottom_mm:.2f} mm".replace("-", "−")),
    )


def _doubts(doubts: Iterable[Doubt]) -> tuple[DoubtPart, ...]:
    return tuple(DoubtPart(doubt.code, doubt.side, doubt.what) for doubt in doubts)


def _figures(result: Result) -> Iterator[FigurePart]:
    for named in overlaps_of(result):
        if not named.is_detail:
            of = f"cells of {named.of[0]} and {named.of[1]}, {named.where}"
            interval = interval_text(named.overlap.jaccard_interval)
            said = f"{of}; {interval}" if interval else of
            yield FigurePart("Jaccard index", share_text(named.overlap.jaccard), said)
    if result.aligned:
        yield FigurePart("Dice index", share_text(result.dice), "on the common grid")
        over = f" over the {result.overlap_mm:.1f} mm that they share" if result.overlap_mm is not None else ""
        yield FigurePart("Observed", f"{result.valid_fraction:.1%}", f"of the wall, by both sides{over}")


def _outlines(described: Iterable[Described]) -> Iterator[OutlinePart]:
    for one in described:
        if one.part.key != DIFFERENCE and isinstance(one.layer, Classes) and one.part.side is not None:
            yield OutlinePart(one.part.key, one.part.side, one.part.classes[-1].colour)


def _first_panes(described: Iterable[Described], outline: ComparisonOutline) -> tuple[str, ...]:
    """Return of either side what shows its cells best, then the difference; where there is none, the cells."""
    parts = [one.part for one in described]
    best = []
    for side in outline.names:
        keys = [part.key for part in parts if part.side == side]
        best.append(next((key for key in keys if key.endswith("relief")), keys[0]))
    last = [DIFFERENCE] if outline.alignment is not None else [f"{outline.names[1]}-{CELLS}"]
    return (*best, *last)[:MOST_PANES]


def _details(result: Result) -> Iterator[DetailPart]:
    yield DetailPart("Overlap and alignment", "".join(result_tables(result)))
    if scores := "".join(score_tables(result)):
        yield DetailPart("Outlines, cells, raters", scores)
    yield DetailPart("How it was made", "".join(provenance(result)))


def _name(path: Path) -> str:
    return path.resolve().name.removesuffix(".zarr")
