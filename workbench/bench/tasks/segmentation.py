"""The task "segmentation": which samples of a panorama are cells.

Cases are toy walls (:mod:`endoct.workbench.bench.cases.toy_walls`), recordings simulated and unrolled by us, or the
user's own. The truth is on the panorama's own samples, so that no grid stands between a method and its judge.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.regions import label
from endoct.fusion.evidence.side import Side
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.cases import toy_walls
from endoct.workbench.bench.cases.specimens import PRESET_WORDS, load_side, recordings_in, simulated, truths_of
from endoct.workbench.bench.program import read_array, write_array, write_panorama
from endoct.workbench.bench.task import SUCCESS, Case, Declined, Exchange, Range, Task, draw

MADE = "made"
GOOD_ENOUGH = 0.7
"""Jaccard index from which a segmentation counts as a success."""

SegmentationCase = Case[Panorama, Mask]
_RECORDING_OF = {"depth": "oct", "intensity": "endoscope"}


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> SegmentationCase:
    """Return a case: a panorama, and its true cells."""
    drawn = draw(seed, index, ranges)
    name, recipe, modality = f"{seed}-{index}", str(drawn["recipe"]), str(drawn["modality"])
    if recipe == MADE:
        numbers = {key: float(value) for key, value in drawn.items() if key in toy_walls.RANGES}
        panorama, cell = toy_walls.toy_panorama(seed, index, modality, numbers)
        return Case(name, panorama, cell, {"recipe": recipe, "modality": modality, **numbers})
    with simulated(recipe, seed, index) as folder:
        specimen = Path(folder) / "specimen"
        panorama = load_side(specimen, _RECORDING_OF[modality])
        cell = truths_of(specimen, panorama)["wall"]
    return Case(name, panorama, cell, {"recipe": recipe, "modality": modality})


def own_cases(specimen: Path) -> list[SegmentationCase]:
    """Return a case for each recording and truth in a folder of the user's own; its panorama may be there as well."""
    cases_ = []
    for recording in recordings_in(specimen):
        panorama = load_side(specimen, recording.name)
        conditions = {"specimen": specimen.name, "modality": "intensity" if panorama.depth_mm is None else "depth"}
        for name, cell in truths_of(specimen, panorama).items():
            cases_.append(Case(f"{specimen.name}/{recording.name}/{name}", panorama, cell, conditions))
    return cases_


def judge(case: SegmentationCase, answer: object) -> dict[str, float]:
    """Score a mask over the valid samples. Raises :class:`EndoctError` for an answer that is no mask."""
    panorama = case.given
    mask, cell = np.asarray(answer), np.asarray(case.truth)
    if mask.shape != panorama.grid.shape or mask.dtype != np.bool_:
        raise EndoctError("that is no mask", found=f"{mask.dtype} {mask.shape}", expected=f"bool {panorama.grid.shape}")
    valid = panorama.valid
    both, marked, true = (int((one & valid).sum()) for one in (mask & cell, mask, cell))
    n_found, n_true = _cells_found(mask & valid, cell & valid)
    overlap = jaccard(mask, cell, valid)
    return {
        SUCCESS: float(overlap is None or overlap >= GOOD_ENOUGH),
        "jaccard": np.nan if overlap is None else overlap,
        "precision": both / marked if marked else np.nan,
        "recall": both / true if true else np.nan,
        "cells_found": n_found / n_true if n_true else np.nan,
        "area_error": (marked - true) / int(valid.sum()),
    }


def _cells_found(mask: Mask, cell: Mask) -> tuple[int, int]:
    """Return how many true cells are marked over at least half of their valid samples, and how many there are."""
    labels, n = label(cell)
    size = np.bincount(labels.ravel(), minlength=n + 1)[1:]
    hit = np.bincount(labels[mask], minlength=n + 1)[1:]
    return int((2 * hit >= size).sum()), n


def ours(panorama: Panorama) -> Mask:
    """Segment as `endoct compare` does where cells are known to be dark.

    Raises :class:`Declined` where that would be called untrusted.
    """
    side = Side(panorama.modality, panorama)
    cells = segment_side(side, SegmentParameters(), "dark")
    if cells.doubts:
        raise Declined(cells.doubts[0].what)
    return cells.mask


def _read_mask(panorama: Panorama, folder: Path) -> Mask:
    mask = read_array(folder, "mask")
    if mask.shape != panorama.grid.shape or mask.dtype.kind not in "bu":
        raise EndoctError("mask.npy is no mask", found=f"{mask.dtype} {mask.shape}", expected=f"{panorama.grid.shape}")
    return np.asarray(mask, np.bool_)


TASK = Task(
    name="segmentation",
    title="which samples of a panorama are cells",
    signature=(
        "method(panorama: endoct.stitching.panorama.Panorama) -> bool array (n_z, n_theta) on the panorama's own "
        "samples, True where there is a cell; what it says where panorama.valid is False does not count. With "
        "depth_mm, cells lie behind the wall; without, cells are dark."
    ),
    cases=cases,
    judge=judge,
    ranges={"recipe": (MADE,), "modality": ("depth", "intensity"), **toy_walls.RANGES},
    optional={"recipe": (MADE, *PRESET_WORDS)},
    scores={
        "jaccard": "Jaccard index over valid samples",
        "precision": "precision, share of what is marked",
        "recall": "recall, share of true cell area",
        "cells_found": "share of true cells half marked at least",
        "area_error": "cell area marked minus true, share of the wall",
    },
    own=own_cases,
    exchange=Exchange(
        write=write_panorama,
        read=_read_mask,
        answer=partial(write_array, "mask"),
    ),
    success=f"a Jaccard index of at least {GOOD_ENOUGH:g}, or no sample marked where there is no cell",
)
