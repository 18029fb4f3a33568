"""The panoramas and masks of a published set in layouts that other libraries load: Hugging Face and WebDataset.

Hugging Face: a folder a split with 8-bit PNG and ``metadata.jsonl``, as its ``imagefolder`` reads it. WebDataset: a tar
file a split with arrays as ``.npy``, nothing lost. The set itself is Zarr, which xarray opens.
"""

import io
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
from endoct.workbench.bench.published.definition import Split
from endoct.workbench.bench.published.examples import Example, Examples
from endoct.workbench.bench.published.specimen_set import read_finished_set
from endoct.workbench.running.kinds import EXPORT
from endoct.workbench.running.progress import Advance, Stages

Layout = Literal["huggingface", "webdataset"]
DARK, BRIGHT = 1.0, 99.0
"""Percentiles of the valid samples that become 0 and 255 of a picture."""
DEPTH_A_COUNT_MM = 0.01
"""Of pictures of depth; 0 is the nominal wall, and what lies before it."""
ARRAYS = ("intensity", "depth_mm", "valid", "cell")


def write_layout(folder: Path, output: Path, layout: Layout, *, overwrite: bool = False, stages: Stages) -> int:
    """Write the examples of the task "segmentation" in ``folder``, a set, in a layout; return how many there are.

    Raises :class:`EndoctError` where ``folder`` is no set, the layout is not known, or ``output`` exists.
    """
    if layout not in get_args(Layout):
        raise EndoctError(f"there is no layout '{layout}'", expected=" or ".join(get_args(Layout)))
    entries = read_finished_set(folder).specimens
    splits = list(dict.fromkeys(one.split for one in entries if "segmentation" in one.tasks))
    facts = {one.name: {"generator": str(one.generator), "difficulty": str(one.difficulty)} for one in entries}
    write = _WRITERS[layout]
    n_written = 0
    with (
        new_output(output, EXPORT, overwrite=overwrite, inputs=[folder]) as scratch,
        stages.stage(layout) as advance,
    ):
        scratch.mkdir()
        for number, split in enumerate(splits):
            examples = Examples(folder, "segmentation", split)
            write(scratch, split, _with_progress(examples, facts, advance, number, len(splits)))
            n_written += len(examples)
    return n_written


def _with_progress(
    examples: Examples, facts: Mapping[str, dict[str, str]], advance: Advance, number: int, n_splits: int
) -> Iterator[tuple[str, Example, dict[str, str]]]:
    """Yield the plain name, the arrays and the facts of every example."""
    for k in range(len(examples)):
        example = examples[k]
        specimen, side, *_ = str(example["name"]).split("/")
        yield f"{specimen}-{side}", example, {"specimen": specimen, "side": side, **facts[specimen]}
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
            for array in ARRAYS:
                content = io.BytesIO()
                np.save(content, example[array], allow_pickle=False)
                _add(shard, f"{name}.{array}.npy", content.getvalue())
            _add(shard, f"{name}.json", json.dumps(facts).encode())


def _add(shard: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)  # no time and no owner: the same bytes from any machine
    member.size = len(content)
    shard.addfile(member, io.BytesIO(content))


_WRITERS: Mapping[Layout, Callable[[Path, Split, Iterator[tuple[str, Example, dict[str, str]]]], None]] = {
    "huggingface": _write_pictures,
    "webdataset": _write_shard,
}
