"""Two sides to one comparison folder."""

import time
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.files.cell_table import write_cells
from endoct.fusion.files.drawings import OUTLINE_SUFFIXES, is_label_store, read_drawing
from endoct.fusion.files.masks import mask_on, read_mask
from endoct.fusion.files.store import save_comparison
from endoct.fusion.geometry.placement import check_same_bore
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import sidecar_path
from endoct.modalities.recording import IMAGE_SUFFIXES, open_stack
from endoct.stitching.errors import EndoctError
from endoct.stitching.files import check_unchanged, state_of
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama, save_panorama
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.pipeline.hand_masks import score_drawings, write_mask
from endoct.workbench.pipeline.inputs import digests, json_text, path_text, versions
from endoct.workbench.pipeline.side_by_side import unroll_both
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose
from endoct.workbench.pipeline.unrolling import Opened, Unrolled, open_side, unroll_recording
from endoct.workbench.report.pictures import save_pictures
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.second_process import second_process

PICTURED_PLACES = (1 / 6, 1 / 2, 5 / 6)
"""Where along the recording frames are shown in the report."""


@dataclass(frozen=True)
class Side:
    """One side of a comparison, as named on the command line."""

    path: Path
    modality: str | None
    settings: Mapping[str, Any]


def write_comparison(
    sides: tuple[Side, Side], folder: Path, *, parameters: CompareParameters, truth: tuple[Path, ...], stages: Stages
) -> Comparison:
    """Compare the two sides and write everything `endoct compare` promises into ``folder``.

    Raises :class:`EndoctError` where a side cannot be used, or is changed while it is read.
    """
    start = time.perf_counter()
    files = {path: state_of(path) for path in (*(side.path for side in sides), *truth)}
    # whatever cannot be used is told before the work of unrolling is done
    opened = {k: one for k, one in enumerate(map(_open, sides)) if one is not None}
    if len(opened) == 2:
        check_same_bore(*(_radius_mm(opened[k]) for k in range(2)))
    for path in truth:
        _check_truth(path)
    recordings = {k: one for k, one in opened.items() if isinstance(one, Opened)}
    with second_process() if len(recordings) == 2 else nullcontext() as process:
        made = _unrolled(recordings, stages, process)
        if process is not None:
            process.preload("endoct.workbench.report.page")
        panoramas = {k: made[k].panorama if isinstance(one, Opened) else one for k, one in opened.items()}
        a, b = (
            panoramas[k] if k in panoramas else read_mask(side.path, like=panoramas.get(1 - k))
            for k, side in enumerate(sides)
        )
        with stages.stage("align, segment, score"):
            comparison = compare_panoramas(a, b, parameters)
            drawn = {path_text(path): _truth(path, a) for path in truth}
            against = score_drawings(comparison, drawn, parameters.tolerance_mm)
        folder.mkdir()
        with stages.stage("write"):
            save_comparison(comparison, folder / "comparison.zarr")
            write_cells(comparison.cells, folder / "cells.csv")
            if against.consensus is not None:
                write_mask(against.consensus, comparison.grid, folder / "consensus.png")
            for name, panorama in zip(comparison.sides, (a, b), strict=True):
                save_panorama(panorama, folder / "panoramas" / f"{name}.zarr")
            for k, one in made.items():
                _picture(folder, comparison.sides[k], one)
        by_name = dict(zip(comparison.sides, (a, b), strict=True))
        result = comparison.result.completed(
            truth=against.truth,
            raters=against.raters,
            notes={name: p.notes for name, p in by_name.items()},
            versions=versions(),
            inputs=_inputs(sides, (a, b), truth),
            parameters={
                "compare": parameters.model_dump(mode="json"),
                **{name: p.provenance.get("parameters", {}) for name, p in by_name.items()},
            },
            seconds={
                **{title: round(seconds, 3) for title, seconds in stages.seconds.items()},
                "in all, before the report": round(time.perf_counter() - start, 3),
            },
        )
        for path, state in files.items():
            check_unchanged(path, state)
        (folder / "result.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
        with stages.stage("report"):
            from endoct.workbench.report.page import write_report  # only who draws loads matplotlib

            write_report(folder, process)
    return replace(comparison, result=result)


def is_mask_image(path: Path) -> bool:
    """Say whether ``path`` is a mask drawn by hand, not a recording.

    Outlines; one image of at most two values, or of whole numbers of 32 bits and more, which are labels; a Zarr store
    of labels.
    """
    if path.is_dir():
        return is_label_store(path) and not is_panorama(path) and not sidecar_path(path).is_file()
    if path.is_file() and path.suffix.lower() in OUTLINE_SUFFIXES:
        return True
    if not path.is_file() or path.suffix.lower() not in IMAGE_SUFFIXES or sidecar_path(path).is_file():
        return False
    stack = open_stack(path)
    if len(stack) != 1:
        return False
    return (stack.dtype.kind in "ui" and stack.dtype.itemsize >= 4) or np.unique(stack[0]).size <= 2


def _truth(path: Path, a: Panorama) -> Panorama:
    """Return a mask drawn on ``a``, or what a simulated specimen's truth folder says ``a`` should show."""
    if not (path / "recording.json").is_file():
        return read_mask(path, like=a)
    truth = load_truth(path.parent)
    return mask_on(true_cells(truth, true_pose(a, truth), a), a, path)


def _check_truth(path: Path) -> None:
    """Raise :class:`EndoctError` for a truth that cannot be read; what outlines enclose only a panorama can tell."""
    simulated = (path / "recording.json").is_file()
    if not simulated and not (path.is_file() and path.suffix.lower() in OUTLINE_SUFFIXES):
        read_drawing(path, None)


def _open(side: Side) -> Panorama | Opened | None:
    """Open a recording, or load a panorama; None for a mask, which may need what it was drawn on to be read."""
    unrolled, mask = is_panorama(side.path), is_mask_image(side.path)
    said = [f"modality {side.modality}"] * (side.modality is not None) + list(side.settings)
    if (unrolled or mask) and said:
        raise EndoctError(
            f"{side.path} is {'a panorama' if unrolled else 'a mask'}, which is compared as it is",
            found=f"set for that side: {', '.join(said)}",
            expected="settings for recordings only",
            remedy="leave them out, or compare the recording itself",
        )
    if unrolled:
        return load_panorama(side.path)
    return None if mask else open_side(side.path, modality=side.modality, settings=side.settings)


def _radius_mm(one: Panorama | Opened) -> float:
    return one.grid.radius_mm if isinstance(one, Panorama) else one.stream.acquisition.bore_diameter_mm / 2


def _unrolled(recordings: Mapping[int, Opened], stages: Stages, process: WorkerProcess | None) -> dict[int, Unrolled]:
    if len(recordings) == 2:
        return dict(enumerate(unroll_both(recordings[0], recordings[1], stages, process)))
    return {k: unroll_recording(one, stages, "AB"[k]) for k, one in recordings.items()}


def _picture(folder: Path, name: str, made: Unrolled) -> None:
    order = np.argsort(made.calibration.per_frame["z_mm"], kind="stable")
    places = sorted({round(share * (len(order) - 1)) for share in PICTURED_PLACES})
    for place in places:
        index = int(order[place])
        pictures = made.manifest.load().illustrate(made.stream[index], made.calibration)
        save_pictures(folder / "pictures", name, f"{place:04d}", pictures)


def _inputs(sides: tuple[Side, Side], panoramas: tuple[Panorama, Panorama], truth: tuple[Path, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for side, panorama in zip(sides, panoramas, strict=True):
        found |= panorama.provenance.get("inputs") or digests(side.path)
    for path in truth:
        found |= digests(path)
    return found
