"""The specimens of a published set as examples to learn from, for torch's DataLoader and other libraries.

:class:`Examples` gives arrays by task. :func:`write_layout` writes them as other libraries load them. Hugging Face: a
folder a split with 8-bit PNG of panoramas and masks, and ``metadata.jsonl``, as its ``imagefolder`` reads it.
WebDataset: a tar file a split with the arrays of a task as ``.npy``, nothing lost. The set itself is Zarr, which xarray
opens.
"""

import json
import tarfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from imagecodecs import png_encode
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.modalities.reading.recording import open_stack
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.published.definition import Split
from endoct.workbench.bench.published.specimen_set import read_finished_set
from endoct.workbench.bench.task import AnyCase, load_task
from endoct.workbench.dataset.set_files import add_array, add_member
from endoct.workbench.running.outputs import EXPORT
from endoct.workbench.running.progress import Advance, Stages

Example = dict[str, Any]
Arrays = Mapping[str, NDArray[Any]]
WHOLE_TURNS = ("start_angle_rad", "turn_length", "rotation_error_cos_rad", "rotation_error_sin_rad", "z_mm")
DARK, BRIGHT = 1.0, 99.0
"""Percentiles of the valid samples that become 0 and 255 of a picture."""
DEPTH_A_COUNT_MM = 0.01
"""A count in pictures of depth is this deep; 0 is the nominal wall, and what lies before it."""
PICTURED = "segmentation"
"""The task of which there are pictures."""
Layout = Literal["huggingface", "webdataset"]


class Examples:
    """The examples of one task, or of one split of it; a map-style data set for torch's ``DataLoader``.

    ``examples[i]`` is a dictionary of arrays, with ``name`` and ``specimen`` as texts. Sizes differ from specimen to
    specimen, so give a ``DataLoader`` ``batch_size=None``, or cut pieces of one size.

    - segmentation: ``intensity``, ``depth_mm`` f32 (0 of a side without depth), ``has_depth``, ``valid``, and the truth
      ``cell`` bool, all (z, θ), with rows at ``z_mm`` and columns from θ = 0 on;
    - stitching: ``strips`` f32 and ``valid`` (strip, row, column), ``pitch_mm``, and the true ``z_mm``, ``roll_rad``;
    - oct: ``recording`` (slice, depth, A-scan) as recorded; of each slice the true ``start_angle_rad``,
      ``turn_length``, ``rotation_error_cos_rad``, ``rotation_error_sin_rad`` and ``z_mm``; and of the true wall
      ``relief_mm`` and ``cell``, by ``wall_z_mm`` and ``wall_theta_rad``;
    - alignment: ``a_…`` and ``b_…`` as for segmentation, and where B truly lies: ``z_in_a_mm`` for each row of B, NaN
      where A does not reach, and ``theta_in_a_rad`` for each column;
    - depth: ``intensity`` and ``valid`` (z, θ); ``strips`` (frame, z, θ) f32 with their ``frame_z_mm``, and the rays'
      ``slant`` at ``from_middle_mm``, as a program gets them; and the true ``relief_mm`` and ``cell``;
    - wall: what both sides show on one grid, as a program gets it, and there ``true_relief_mm`` and ``true_cell``;
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
        self.places = [(entry, number) for entry in entries for number in range(entry.cases(task))]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Example:
        entry, number = self.places[index]
        if self.task.own is None:
            raise EndoctError(f"the task '{self.task.name}' reads no folders")
        case = self.task.own(self.root / entry.name)[number]
        arrays = _ARRAYS[self.task.name](case).items()
        # copies: torch writes to them
        return {"name": case.name, "specimen": entry.name, **{name: np.array(array) for name, array in arrays}}


def _side(panorama: Panorama, prefix: str = "") -> Arrays:
    depth = panorama.depth_mm
    return {
        f"{prefix}intensity": panorama.intensity,
        f"{prefix}depth_mm": np.zeros_like(panorama.intensity) if depth is None else depth,
        f"{prefix}has_depth": np.array(depth is not None),
        f"{prefix}valid": panorama.valid,
        f"{prefix}z_mm": panorama.z_mm,
    }


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
    views, truth = case.given, case.truth
    return {
        "intensity": views.panorama.intensity,
        "valid": views.panorama.valid,
        "strips": views.strips_on_rows(),
        **{name: getattr(views, name) for name in ("frame_z_mm", "from_middle_mm", "slant")},
        "relief_mm": truth.relief_mm,
        "cell": truth.cell,
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
    "segmentation": lambda case: {**_side(case.given), "cell": np.asarray(case.truth)},
    "stitching": _stitching,
    "oct": _oct,
    "alignment": _alignment,
    "depth": _depth,
    "wall": lambda case: {**case.given.arrays(), **{f"true_{name}": of for name, of in vars(case.truth).items()}},
    "pose": _pose,
}


def write_layout(
    folder: Path, output: Path, layout: Layout, task: str = PICTURED, *, overwrite: bool = False, stages: Stages
) -> int:
    """Write the examples of a task in ``folder``, a set, in a layout; return how many there are.

    Raises :class:`EndoctError` where ``folder`` is no set or has none of the task, the layout is not known or has no
    other task than "segmentation", or ``output`` exists.
    """
    if layout not in get_args(Layout):
        raise EndoctError(f"there is no layout '{layout}'", expected=" or ".join(get_args(Layout)))
    if layout == "huggingface" and task != PICTURED:
        raise EndoctError(f"there are no pictures of the task '{task}'", expected=PICTURED, remedy="--to webdataset")
    entries = [entry for entry in read_finished_set(folder).specimens if task in entry.tasks]
    if not entries:
        raise EndoctError(f"{folder} has no example for '{task}'")
    splits = list(dict.fromkeys(entry.split for entry in entries))
    facts = {entry.name: {"generator": str(entry.generator), "difficulty": str(entry.difficulty)} for entry in entries}
    write = _WRITERS[layout]
    n_written = 0
    with (
        new_output(output, EXPORT, overwrite=overwrite, inputs=[folder]) as scratch,
        stages.stage(layout) as advance,
    ):
        scratch.mkdir()
        for number, split in enumerate(splits):
            examples = Examples(folder, task, split)
            write(scratch, split, _with_progress(examples, facts, advance, number, len(splits)))
            n_written += len(examples)
    return n_written


def _with_progress(
    examples: Examples, facts: Mapping[str, dict[str, str]], advance: Advance, number: int, n_splits: int
) -> Iterator[tuple[str, Example, dict[str, str]]]:
    """Yield the plain name, the arrays and the facts of every example."""
    for k in range(len(examples)):
        example = examples[k]
        specimen, *case = str(example["name"]).split("/")
        sides = {"side": case[0]} if examples.task.name == PICTURED else {}
        yield "-".join([specimen, *case[:1]]), example, {"specimen": specimen, **sides, **facts[specimen]}
        advance((number + (k + 1) / len(examples)) / n_splits)


def _write_pictures(root: Path, split: Split, examples: Iterator[tuple[str, Example, dict[str, str]]]) -> None:
    folder = root / split
    folder.mkdir()
    lines = []
    for name, example, facts in examples:
        pictures = {
            "file_name": (f"{name}.png", _grey(example["intensity"], example["valid"])),
            "mask_file_name": (f"{name}-mask.png", _counts(255 * example["cell"])),
            "valid_file_name": (f"{name}-valid.png", _counts(255 * example["valid"])),
        }
        if example["has_depth"]:
            pictures["depth_file_name"] = (f"{name}-depth.png", _counts(example["depth_mm"] / DEPTH_A_COUNT_MM))
        for file, picture in pictures.values():
            (folder / file).write_bytes(png_encode(picture))
        lines.append(json.dumps({key: file for key, (file, _) in pictures.items()} | facts))
    (folder / "metadata.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _grey(image: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    low, high = np.percentile(image[valid], [DARK, BRIGHT]) if valid.any() else (0.0, 1.0)
    return _counts(255 * (image - low) / max(high - low, 1e-6))


def _counts(image: NDArray[Any]) -> NDArray[np.uint8]:
    return np.asarray(np.clip(np.rint(image), 0, 255), np.uint8)


def _write_shard(root: Path, split: Split, examples: Iterator[tuple[str, Example, dict[str, str]]]) -> None:
    with tarfile.open(root / f"{split}-000000.tar", "w", format=tarfile.USTAR_FORMAT) as shard:
        for name, example, facts in examples:
            for array in sorted(example.keys() - {"name", "specimen"}):
                add_array(shard, f"{name}.{array}.npy", example[array])
            add_member(shard, f"{name}.json", json.dumps(facts).encode())


_WRITERS: Mapping[Layout, Callable[[Path, Split, Iterator[tuple[str, Example, dict[str, str]]]], None]] = {
    "huggingface": _write_pictures,
    "webdataset": _write_shard,
}
