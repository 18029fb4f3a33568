"""The task "depth": how far the wall that an endoscope shows lies behind the bore's radius, by its frames alone.

Places behind the wall move otherwise from frame to frame, and cells are darker than the wall. A method gets the
panorama, its strips in their places, and the slant of the view, so that depth alone is at stake. It is judged on every
valid sample of the wall and of true cells. What it does not know counts as the nominal wall.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.light_alone import depth_of_side
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip
from endoct.workbench.bench.cases.specimens import PRESET_WORDS, load_side, simulated
from endoct.workbench.bench.program import read_array, write_array, write_panorama
from endoct.workbench.bench.task import SUCCESS, Case, Declined, Exchange, Range, Task, draw
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose, true_relief
from endoct.workbench.sides.recordings import open_recording

DEEPEST_MM = 1.5
"""Cells are deeper here and there; deeper than this no method is asked for."""
WALL_UM, CELL_UM = 25.0, 120.0
"""An answer succeeds with median errors of at most these, on the wall and in cells (chosen)."""


@dataclass(frozen=True, eq=False)
class Views:
    """What a method gets.

    ``recording``: its folder. ``panorama`` without depth; ``strips`` as they lie on its rows and columns;
    ``frame_z_mm`` (n,), z of each strip's middle. ``from_middle_mm`` and ``slant`` (m,): at this z from the middle, a
    ray goes on by so much z for 1 mm behind the wall; ``slant_known``: whether that follows from optics that are
    stated, or from a usual mirror.
    """

    recording: Path
    panorama: Panorama
    strips: tuple[Strip, ...]
    frame_z_mm: Coordinates
    from_middle_mm: Coordinates
    slant: Coordinates
    slant_known: bool

    def strips_on_rows(self) -> Image:
        """Return all strips on the panorama's rows and columns, (frame, z, θ), NaN where a frame shows nothing."""
        rows = {float(z): k for k, z in enumerate(self.panorama.z_mm)}
        strips = np.full((len(self.strips), *self.panorama.grid.shape), np.nan, np.float32)
        for k, strip in enumerate(self.strips):
            for row, z_mm in enumerate(strip.z_mm):
                if float(z_mm) in rows:
                    strips[k, rows[float(z_mm)]] = np.where(strip.valid[row], strip.intensity[row], np.nan)
        return strips


@dataclass(frozen=True, eq=False)
class Depths:
    """What is true at the panorama's samples: ``relief_mm`` behind the nominal wall, and which are cells."""

    relief_mm: Image
    cell: Mask


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> Case[Views, Depths]:
    """Return a case: the views of a simulated recording, and the true depth."""
    drawn = draw(seed, index, ranges)
    scratch = simulated(str(drawn["recipe"]), seed, index)
    case = _of_recording(Path(scratch.name) / "specimen")
    return replace(case, name=f"{seed}-{index}", conditions=drawn, scratch=scratch)


def own_cases(specimen: Path) -> list[Case[Views, Depths]]:
    """Return the case of a folder laid out as a simulated specimen; its panorama may be there as well."""
    if not (specimen / "endoscope").is_dir():
        raise EndoctError(f"{specimen} holds no recording of an endoscope", expected="endoscope/ in it")
    return [_of_recording(specimen)]


def _of_recording(specimen: Path) -> Case[Views, Depths]:
    unrolled, truth = load_side(specimen, "endoscope"), load_truth(specimen)
    panorama = replace(unrolled, parallax_depth_mm=None, parallax_error_mm=None)
    pose = true_pose(panorama, truth)
    true = Depths(true_relief(truth, pose, panorama), true_cells(truth, pose, panorama))
    return Case(specimen.name, views_of(specimen / "endoscope", panorama), true, {"specimen": specimen.name})


def views_of(recording: Path, panorama: Panorama) -> Views:
    """Return the views of a recording whose ``panorama`` was unrolled."""
    side = open_recording(recording, modality="endoscope")
    modality: Any = side.manifest.load()
    calibration = modality.survey(side.stream, side.parameters)
    strips = tuple(modality.unroll(side.stream[k], calibration) for k in range(len(side.stream)))
    optics, along_mm = calibration.optics, np.asarray(calibration.strip_z_mm)
    slant, z_mm = np.asarray(optics.slant(optics.r_px(along_mm))), np.asarray(calibration.z_mm)
    return Views(recording, panorama, strips, z_mm, along_mm, slant, not optics.assumed)


def judge(case: Case[Views, Depths], answer: object) -> dict[str, float]:
    """Score depths on the panorama's samples. Raises :class:`EndoctError` for an answer of another shape."""
    valid, true = case.given.panorama.valid, case.truth
    depth = np.asarray(answer)
    if depth.shape != valid.shape or depth.dtype.kind != "f":
        raise EndoctError("that is no depth", found=f"{depth.dtype} {depth.shape}", expected=f"float {valid.shape}")
    known = np.isfinite(depth)
    answered_mm = np.clip(np.where(known, depth, 0.0), -DEEPEST_MM, DEEPEST_MM)
    error_um = 1e3 * (answered_mm - np.minimum(true.relief_mm, DEEPEST_MM))
    cell, wall = true.cell & valid, ~true.cell & valid
    if not cell.any():
        raise Declined("the recording shows no cell", {SUCCESS: 1.0})
    of_wall, of_cells = (float(np.median(np.abs(error_um[where]))) for where in (wall, cell))
    return {
        SUCCESS: float(of_wall <= WALL_UM and of_cells <= CELL_UM),
        "error_um": (of_wall + of_cells) / 2,
        "wall_um": of_wall,
        "cell_um": of_cells,
        "cell_bias_um": float(np.median(error_um[cell])),
        "within_100": float((np.abs(error_um[cell]) <= 100).mean()),
        "known": float(known[cell].mean()),
    }


def ours(views: Views) -> Image:
    """Return depth as endoct knows it by an endoscope alone: in its cells by all that light shows, else by parallax."""
    from endoct.workbench import api

    side = Side("endoscope", api.unroll(views.recording))
    return depth_of_side(side, segment_side(side, SegmentParameters(), "dark").mask)[0]


def _write_views(views: Views, folder: Path) -> None:
    write_panorama(views.panorama, folder)
    np.save(folder / "strips.npy", views.strips_on_rows())
    facts = {
        "frame_z_mm": views.frame_z_mm.tolist(),
        "from_middle_mm": views.from_middle_mm.tolist(),
        "slant": views.slant.tolist(),
        "slant_known": views.slant_known,
    }
    (folder / "views.json").write_text(json.dumps(facts), encoding="utf-8")


TASK = Task(
    name="depth",
    title="how far the wall that an endoscope shows lies behind the bore's radius",
    signature=(
        "method(views: endoct.workbench.bench.tasks.depth.Views) -> float array (n_z, n_theta) on the samples of "
        "views.panorama: mm behind the nominal wall, NaN where not known, which counts as 0."
    ),
    cases=cases,
    judge=judge,
    ranges={"recipe": ("quick",)},
    optional={"recipe": PRESET_WORDS},
    scores={
        "error_um": "mean of the next two, µm",
        "wall_um": "median error on the wall, µm",
        "cell_um": "median error in true cells, to 1.5 mm, µm",
        "cell_bias_um": "median of answered minus true depth in cells, µm",
        "within_100": "share of cells' samples within 100 µm",
        "known": "share of cells' samples that have a depth",
    },
    own=own_cases,
    against="endoct",
    exchange=Exchange(
        write=_write_views,
        read=lambda _views, folder: read_array(folder, "depth_mm").astype(np.float32),
        answer=partial(write_array, "depth_mm"),
    ),
    success=(
        f"a median error of at most {WALL_UM:g} µm on the wall and of at most {CELL_UM:g} µm in true cells, or any "
        "answer where there is no cell"
    ),
)
