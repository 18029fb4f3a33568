"""Two sides to one comparison, and to its folder.

The folder holds, of each side alone, its panorama, pictures of its frames, and their figures.
"""

import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.compute.worker_process import WorkerProcess
from endoct.base.files.files import check_unchanged, digests, path_text, state_of
from endoct.fusion.comparison import compare_sides
from endoct.fusion.evidence.drawn_mask import DrawnMask
from endoct.fusion.evidence.side import Side
from endoct.fusion.files.cell_table import write_cells
from endoct.fusion.files.drawings import OUTLINE_SUFFIXES, read_drawing
from endoct.fusion.files.masks import mask_on, read_mask
from endoct.fusion.files.session import check_sides, identity_of, read_session
from endoct.fusion.files.store import save_comparison
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.sides import Comparison, Placed
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama, save_panorama
from endoct.workbench.pipeline.hand_masks import score_drawings, write_drawings, write_mask
from endoct.workbench.pipeline.inputs import doubt_of_inputs, json_text, versions
from endoct.workbench.pipeline.sample_frames import copy_sample_frames, save_sample_frames
from endoct.workbench.pipeline.sources import Made, Source, inputs_of, open_both, read_sides, unroll_sources
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose
from endoct.workbench.pipeline.unrolling import Unrolled
from endoct.workbench.report.pictures import PICTURES, load_pictures
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.second_process import beside

if TYPE_CHECKING:
    from endoct.workbench.report.figures.rendered import Drawn
    from endoct.workbench.report.figures.requested import Requested


@dataclass(frozen=True)
class SidePart:
    """A side by ``name``: its panorama, and what pictures of its frames come from.

    That is the recording as it was unrolled, or the store of a panorama; None where there are none.
    """

    name: str
    panorama: Panorama
    pictured: Unrolled | Path | None


def write_sides(folder: Path, sides: Sequence[SidePart]) -> None:
    """Write ``panoramas`` and ``pictures`` of ``sides`` into ``folder``.

    Nothing here depends on how the sides lie on each other: it can be done while that is found out.
    """
    for side in sides:
        save_panorama(side.panorama, folder / "panoramas" / f"{side.name}.zarr")
        if isinstance(side.pictured, Unrolled):
            save_sample_frames(side.pictured, folder, side.name)
        elif side.pictured is not None:
            copy_sample_frames(side.pictured, folder, side.name)


def draw_sides(folder: Path, names: Sequence[str]) -> "list[Drawn]":
    """Return the figures that show one side alone, of what :func:`write_sides` wrote into ``folder``."""
    from endoct.workbench.report.figures.of_one import drawings_of_side, drawn  # only who draws loads matplotlib
    from endoct.workbench.report.side_findings import alone

    pictures = load_pictures(folder / PICTURES)
    panoramas = {name: load_panorama(folder / "panoramas" / f"{name}.zarr") for name in names}
    found = [replace(alone(panoramas[name], pictures.get(name, {})), name=name) for name in names]
    return drawn(one for side in found for one in drawings_of_side(side))


def compare_sources(
    sources: tuple[Source, Source],
    folder: Path | None,
    *,
    parameters: CompareParameters,
    truth: tuple[Path, ...],
    stages: Stages,
    session: Path | None = None,
    process: WorkerProcess | None = None,
) -> Comparison:
    """Compare the two sides, and write everything `endoct compare` promises into ``folder`` where one is given.

    What can be done at the same time is, in ``process`` where there is one. Raises :class:`EndoctError` where a side
    cannot be used, or is changed while it is read, and where the ``session`` was made on other sides.
    """
    start = time.perf_counter()
    given = () if session is None else (session,)
    files = {path: state_of(path) for path in (*paths_of(sources), *truth, *given)}
    # whatever cannot be used is refused before the work of unrolling is done
    opened = open_both(sources)
    for path in truth:
        _check_truth(path)
    placed = None if session is None else read_session(session)
    made = unroll_sources(opened, stages, process, _load_report if folder is not None else lambda: None)
    sides = read_sides(made)
    if placed is not None:
        check_sides(placed, [identity_of(side.name, side.panorama) for side in sides], str(session))
    written: Future[None] | None = None
    of_sides: Future[list[Drawn]] | None = None
    of_both: list[Requested] = []
    if folder is not None:
        folder.mkdir()
        parts = [_part(*of) for of in zip(sides, sources, made, strict=True)]
        written = beside(process, write_sides, folder, parts)
        of_sides = beside(process, draw_sides, folder, [side.name for side in sides])

    def draw_both(both: Placed) -> None:
        if folder is not None:
            of_both.extend(_begin_drawing(both, sides, process))

    with stages.stage("align, segment, score"):
        pairs = () if placed is None else placed.pairs
        comparison = compare_sides(*sides, parameters, pairs, when_placed=draw_both)
        drawn = {path_text(path): _truth(path, sides[0].panorama) for path in truth}
        against = score_drawings(comparison, drawn, parameters.tolerance_mm)
    if folder is not None:
        with stages.stage("write"):
            save_comparison(comparison, folder / "comparison.zarr")
            write_cells(comparison.cells, folder / "cells.csv")
            if against.consensus is not None:
                write_mask(against.consensus, comparison.grid, folder / "consensus.png")
            write_drawings(against, comparison.grid, folder)
            if written is not None:
                written.result()
    of_inputs = tuple(inputs_of(source, side) for source, side in zip(sources, sides, strict=True))
    doubted = comparison.result
    if comparison.alignment is not None and (doubt := doubt_of_inputs(*of_inputs)):
        doubted = doubted.model_copy(update={"doubts": (doubt, *doubted.doubts)})
    result = doubted.completed(
        truth=against.truth,
        raters=against.raters,
        notes={side.name: side.panorama.notes for side in sides},
        versions=versions(),
        inputs={
            name: digest for each in (*of_inputs, *map(digests, (*truth, *given))) for name, digest in each.items()
        },
        parameters={
            "compare": parameters.model_dump(mode="json"),
            **{side.name: side.panorama.provenance.get("parameters", {}) for side in sides},
        },
        seconds={
            **{title: round(seconds, 3) for title, seconds in stages.seconds.items()},
            "in all, before the report": round(time.perf_counter() - start, 3),
        },
    )
    if folder is not None:
        (folder / "result.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
        with stages.stage("report"):
            from endoct.workbench.page.report import write_comparison_report
            from endoct.workbench.report.findings import findings_of

            findings = findings_of(replace(comparison, result=result), [side.panorama for side in sides], {})
            write_comparison_report(folder, findings, of_both, of_sides)
    for path, state in files.items():
        check_unchanged(path, state)
    return replace(comparison, result=result)


def _begin_drawing(placed: Placed, sides: tuple[Side, Side], process: WorkerProcess | None) -> "list[Requested]":
    """Have figures of both sides drawn while these are scored."""
    from endoct.workbench.report.figures.requested import begin_drawing_both
    from endoct.workbench.report.findings import both_sides

    panoramas = [side.panorama for side in sides]
    both = both_sides(placed.grid, placed.sides, panoramas, {}, aligned=placed.aligned)
    return begin_drawing_both(both, process, with_sides=False)


def _load_report() -> None:
    """Load what a report needs: only who draws loads matplotlib, and rather while there is nothing else to do."""
    import_module("endoct.workbench.page.report")
    import_module("endoct.workbench.report.figures.of_both")


def _part(side: Side, source: Source, made: Made) -> SidePart:
    if isinstance(made, Unrolled):
        return SidePart(side.name, side.panorama, made)
    return SidePart(side.name, side.panorama, source.path if isinstance(made, Panorama) else None)


def paths_of(sources: tuple[Source, Source]) -> list[Path]:
    """Return where the sources lie; panoramas at hand lie nowhere."""
    return [source.path for source in sources if source.path is not None]


def _truth(path: Path, a: Panorama) -> DrawnMask:
    """Return a mask drawn on ``a``, or what a simulated specimen's truth folder says ``a`` should show."""
    if not (path / "recording.json").is_file():
        return read_mask(path, like=a)
    truth = load_truth(path.parent)
    return mask_on(true_cells(truth, true_pose(a, truth), a), a, path)


def _check_truth(path: Path) -> None:
    """Raise :class:`EndoctError` for a truth that cannot be read; only a panorama shows what outlines enclose."""
    simulated = (path / "recording.json").is_file()
    if not simulated and not (path.is_file() and path.suffix.lower() in OUTLINE_SUFFIXES):
        read_drawing(path, None)
