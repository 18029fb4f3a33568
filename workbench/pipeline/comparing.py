"""Two sides to one comparison, and to its folder."""

import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from endoct.fusion.comparison import compare_sides
from endoct.fusion.evidence.drawn_mask import DrawnMask
from endoct.fusion.files.cell_table import write_cells
from endoct.fusion.files.drawings import OUTLINE_SUFFIXES, read_drawing
from endoct.fusion.files.masks import mask_on, read_mask
from endoct.fusion.files.session import check_sides, identity_of, read_session
from endoct.fusion.files.store import save_comparison
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.sides import Comparison
from endoct.stitching.digests import digests, path_text
from endoct.stitching.files import check_unchanged, state_of
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.pipeline.hand_masks import score_drawings, write_drawings, write_mask
from endoct.workbench.pipeline.inputs import doubt_of_inputs, json_text, versions
from endoct.workbench.pipeline.sample_frames import copy_sample_frames, save_sample_frames
from endoct.workbench.pipeline.sources import Source, inputs_of, open_both, read_sides, unroll_sources
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose
from endoct.workbench.pipeline.unrolling import Opened, Unrolled
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.second_process import second_process


def compare_sources(
    sources: tuple[Source, Source],
    folder: Path | None,
    *,
    parameters: CompareParameters,
    truth: tuple[Path, ...],
    stages: Stages,
    session: Path | None = None,
) -> Comparison:
    """Compare the two sides, and write everything `endoct compare` promises into ``folder`` where one is given.

    Raises :class:`EndoctError` where a side cannot be used, or is changed while it is read, and where the ``session``
    was made on other sides.
    """
    start = time.perf_counter()
    given = () if session is None else (session,)
    files = {path: state_of(path) for path in (*paths_of(sources), *truth, *given)}
    # whatever cannot be used is refused before the work of unrolling is done
    opened = open_both(sources)
    for path in truth:
        _check_truth(path)
    placed = None if session is None else read_session(session)
    with second_process() if all(isinstance(one, Opened) for one in opened) else nullcontext() as process:
        made = unroll_sources(opened, stages, process)
        if process is not None and folder is not None:
            process.preload("endoct.workbench.page.report")
        sides = read_sides(made)
        if placed is not None:
            check_sides(placed, [identity_of(side.name, side.panorama) for side in sides], str(session))
        with stages.stage("align, segment, score"):
            comparison = compare_sides(*sides, parameters, () if placed is None else placed.pairs)
            drawn = {path_text(path): _truth(path, sides[0].panorama) for path in truth}
            against = score_drawings(comparison, drawn, parameters.tolerance_mm)
        if folder is not None:
            with stages.stage("write"):
                folder.mkdir()
                save_comparison(comparison, folder / "comparison.zarr")
                write_cells(comparison.cells, folder / "cells.csv")
                if against.consensus is not None:
                    write_mask(against.consensus, comparison.grid, folder / "consensus.png")
                write_drawings(against, comparison.grid, folder)
                for source, side, one in zip(sources, sides, made, strict=True):
                    save_panorama(side.panorama, folder / "panoramas" / f"{side.name}.zarr")
                    if isinstance(one, Unrolled):
                        save_sample_frames(one, folder, side.name)
                    elif isinstance(one, Panorama) and source.path is not None:
                        copy_sample_frames(source.path, folder, side.name)
        of_sides = tuple(inputs_of(source, side) for source, side in zip(sources, sides, strict=True))
        doubted = comparison.result
        if comparison.alignment is not None and (doubt := doubt_of_inputs(*of_sides)):
            doubted = doubted.model_copy(update={"doubts": (doubt, *doubted.doubts)})
        result = doubted.completed(
            truth=against.truth,
            raters=against.raters,
            notes={side.name: side.panorama.notes for side in sides},
            versions=versions(),
            inputs={
                name: digest for each in (*of_sides, *map(digests, (*truth, *given))) for name, digest in each.items()
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
        for path, state in files.items():
            check_unchanged(path, state)
        if folder is not None:
            (folder / "result.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
            with stages.stage("report"):
                from endoct.workbench.page.report import write_report  # only who draws loads matplotlib

                write_report(folder, process)
    return replace(comparison, result=result)


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
