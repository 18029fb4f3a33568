"""The specimens of a published set as examples to learn from: arrays by task, for torch's DataLoader and others."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import open_stack
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.published.definition import Split
from endoct.workbench.bench.published.specimen_set import Entry, read_finished_set
from endoct.workbench.bench.task import AnyCase, load_task

Example = dict[str, Any]
Arrays = Mapping[str, NDArray[Any]]
WHOLE_TURNS = ("start_angle_rad", "turn_length", "rotation_error_cos_rad", "rotation_error_sin_rad", "z_mm")


class Examples:
    """The examples of one task, or of one split of it; a map-style data set for torch's ``DataLoader``.

    ``examples[i]`` is a dictionary of arrays, with ``name`` and ``specimen`` as texts. Sizes differ from specimen to
    specimen, so give a ``DataLoader`` ``batch_size=None``, or cut pieces of one size.

    - segmentation: ``intensity``, ``depth_mm`` f32 (0 of a side without depth), ``has_depth``, ``valid``, and the truth
      ``cell`` bool, all (z, θ);
    - stitching: ``strips`` f32 and ``valid`` (strip, row, column), ``pitch_mm``, and the true ``z_mm``, ``roll_rad``;
    - oct: ``recording`` (slice, depth, A-scan) as recorded, and the true ``start_angle_rad``, ``turn_length``,
      ``rotation_error_cos_rad``, ``rotation_error_sin_rad``, ``z_mm`` of each slice, and the wall, ``relief_mm`` and
      ``cell``, by ``wall_z_mm`` and ``wall_theta_rad``;
    - alignment: ``a_…`` and ``b_…`` as for segmentation, and where B truly lies: ``z_in_a_mm`` for each row of B, NaN
      where A does not reach, and ``theta_in_a_rad`` for each column;
    - depth: ``intensity`` and ``valid`` (z, θ), and the true ``relief_mm`` and ``cell``;
    - pose: ``SIDE_…`` as for segmentation, ``ct`` (k, j, i), ``ct_to_lps`` (4, 4) of its index, ``plan_mm`` (2, 3), and
      the true ``bore_to_lps`` (4, 4) and ``length_mm``.

    Raises :class:`EndoctError` where ``root`` is no set, or has no such example.
    """

    def __init__(self, root: Path | str, task: str, split: Split | None = None) -> None:
        self.root, self.task = Path(root), load_task(task)
        if task not in _ARRAYS:
            raise EndoctError(f"the task '{task}' has no examples", expected=" or ".join(_ARRAYS))
        entries = [
            one for one in read_finished_set(self.root).specimens if task in one.tasks and split in (None, one.split)
        ]
        if not entries:
            raise EndoctError(f"{root} has no example for '{task}'", found=f"split {split}")
        self.places = [(entry, number) for entry in entries for number in range(_cases_of(entry, task))]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Example:
        entry, number = self.places[index]
        if self.task.own is None:
            raise EndoctError(f"the task '{self.task.name}' reads no folders")
        case = self.task.own(self.root / entry.name)[number]
        arrays = {
            name: np.array(array) for name, array in _ARRAYS[self.task.name](case).items()
        }  # torch writes to them
        return {"name": case.name, "specimen": entry.name, **arrays}


def _cases_of(entry: Entry, task: str) -> int:
    """Return how many cases a specimen is: of poses by both sides and by each, of masks by each."""
    sides = len(entry.unrolled)
    return {"segmentation": sides, "pose": sides + 1 if sides > 1 else 1}.get(task, 1)


def _side(panorama: Panorama, prefix: str = "") -> Arrays:
    depth = panorama.depth_mm
    return {
        f"{prefix}intensity": panorama.intensity,
        f"{prefix}depth_mm": np.zeros_like(panorama.intensity) if depth is None else depth,
        f"{prefix}has_depth": np.array(depth is not None),
        f"{prefix}valid": panorama.valid,
    }


def _segmentation(case: AnyCase) -> Arrays:
    return {**_side(case.given), "cell": np.asarray(case.truth)}


def _stitching(case: AnyCase) -> Arrays:
    strips, pitch_mm = case.given
    return {
        "strips": np.stack([strip.intensity for strip in strips]),
        "valid": np.stack([strip.valid for strip in strips]),
        "pitch_mm": np.array(pitch_mm),
        "z_mm": case.truth.z_mm,
        "roll_rad": case.truth.roll_rad,
    }


def _oct(case: AnyCase) -> Arrays:
    frames, truth = open_stack(case.given), case.truth
    return {
        "recording": np.stack([frames[k] for k in range(len(frames))]),
        **{name: np.asarray(truth.recording["oct"][name], np.float64) for name in WHOLE_TURNS},
        **{name: np.asarray(truth.wall[name]) for name in ("relief_mm", "cell")},
        **{f"wall_{name}": np.asarray(truth.wall[of]) for name, of in (("z_mm", "z"), ("theta_rad", "theta"))},
    }


def _alignment(case: AnyCase) -> Arrays:
    a, b = case.given
    return {
        **_side(a, "a_"),
        **_side(b, "b_"),
        "z_in_a_mm": case.truth.z_to_a(b.z_mm),
        "theta_in_a_rad": np.mod(case.truth.theta_to_a(b.grid.theta_rad), 2 * np.pi),
    }


def _depth(case: AnyCase) -> Arrays:
    panorama = case.given.panorama
    return {
        "intensity": panorama.intensity,
        "valid": panorama.valid,
        "relief_mm": case.truth.relief_mm,
        "cell": case.truth.cell,
    }


def _pose(case: AnyCase) -> Arrays:
    panoramas, ct, plan = case.given
    arrays: dict[str, NDArray[Any]] = {}
    for panorama in panoramas:
        arrays |= _side(panorama, f"{panorama.modality}_")
    return {
        **arrays,
        "ct": ct.voxels,
        "ct_to_lps": ct.to_lps,
        "plan_mm": np.array([plan.entry_mm, plan.target_mm]),
        "bore_to_lps": case.truth.to_lps,
        "length_mm": np.array(case.truth.length_mm),
    }


_ARRAYS: Mapping[str, Callable[[AnyCase], Arrays]] = {
    "segmentation": _segmentation,
    "stitching": _stitching,
    "oct": _oct,
    "alignment": _alignment,
    "depth": _depth,
    "pose": _pose,
}
