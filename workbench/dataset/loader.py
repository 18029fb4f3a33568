"""Reads the specimens of a data set as arrays, for torch's DataLoader and whatever else."""

import csv
import math
import tarfile
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, inside, largest_array_bytes, open_regular, plain_name
from endoct.base.files.json_values import read_object
from endoct.base.files.npy import read_npy
from endoct.base.zarr.zarr_store import read_arrays
from endoct.modalities.reading.recording import open_stack
from endoct.synthetic.sample.presets import PRESETS
from endoct.workbench.dataset.plan import SPLITS, Split

TRUTH = ("relief_mm", "cell", "cell_id")
AGAIN = "copy the data set again, or make it again"
WHOLE = 16
"""A whole recording, or all labels of one, may have this many times the largest array."""
MOST_ARRAYS = 200
LONGEST_MM = 1e4

Arrays = dict[str, NDArray[Any]]


class Specimens:
    """The specimens of a data set, or of one split of it; a map-style data set for torch's ``DataLoader``.

    ``specimens[i]`` is a dictionary of arrays:

    - ``oct`` u8 (slice, depth, A-scan), in the order recorded;
    - ``endoscope`` u8 (frame, row, column, 3), RGB also where the recording is grey;
    - ``relief_mm`` f32, ``cell`` bool and ``cell_id`` i32, all (z, θ): the truth in the bore frame, row k at
      z = k·dz mm from the mouth, column j at θ = 2πj/n. It is cut where the set's shortest bore ends, beyond all
      recordings. So truth of many specimens can be stacked;
    - ``labels.STORE.NAME`` where the set was made with labels, as :mod:`endoct.synthetic.labels` describes;
    - ``index``, of the specimen in the set.

    ``rows`` holds the lines of ``manifest.csv``, column → text. Both formats can be read; for shards the
    ``webdataset`` library streams better. Raises :class:`EndoctError` where ``root`` holds no finished data set.
    """

    def __init__(self, root: Path | str, split: Split | None = None) -> None:
        self.root = Path(root)
        if split is not None and split not in SPLITS:
            raise EndoctError(f"there is no split '{split}'", expected=f"one of {', '.join(SPLITS)}")
        try:
            every = _manifest(self.root / "manifest.csv")
            with refusing(f"{self.root / 'dataset.json'} cannot be used"):
                preset = read_object(self.root / "dataset.json")["arguments"]["preset"]
                wall_dz_mm = PRESETS[preset].wall_dz_mm
        except EndoctError as error:
            raise EndoctError(
                f"{self.root} holds no finished data set",
                found=f"{error.what}: {error.found}",
                expected="dataset.json and manifest.csv",
                remedy="start its `endoct dataset` again, which makes what is missing",
            ) from error
        self._n_z = int(min(float(row["bore.length_mm"]) for row in every) / wall_dz_mm)
        self.rows = [row for row in every if split in (None, row["split"])]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> dict[str, Any]:
        row = self.rows[index]
        path = inside(self.root, row["path"], f"a specimen of {self.root}")
        if any(place.is_symlink() for place in (path, *path.parents) if self.root in place.parents):
            raise EndoctError(f"{path} cannot be part of a data set", found="a link", expected="files and folders")
        arrays = read_specimen(path) if path.is_dir() else read_from_shard(path, row["name"])
        if missing := sorted({*TRUTH, "oct", "endoscope"} - arrays.keys()):
            raise EndoctError(f"{path} is no whole specimen", found=f"no {missing[0]} of {row['name']}", remedy=AGAIN)
        if any(arrays[name].ndim != 2 for name in TRUTH):
            raise EndoctError(f"{path} is no whole specimen", found="a truth that is no map of the wall", remedy=AGAIN)
        truth = {name: arrays[name][: self._n_z] for name in TRUTH}
        return {"index": int(row["index"])} | arrays | truth


def read_specimen(folder: Path) -> Arrays:
    """Return the arrays of the specimen in ``folder``, as :class:`Specimens` describes them, truth uncut.

    Raises :class:`EndoctError` where one is missing, damaged or too large.
    """
    with refusing(f"the specimen {folder} cannot be read", remedy=AGAIN):
        wall = read_arrays(folder / "truth" / "wall.zarr", TRUTH)
        if missing := [name for name in TRUTH if name not in wall]:
            raise EndoctError(f"{folder} has no whole truth", found=f"no {missing[0]}", remedy=AGAIN)
        return {
            "oct": _stack(open_stack(folder / "oct"), folder),
            "endoscope": _frames(folder / "endoscope"),
            **{name: wall[name] for name in TRUTH},
            **_labels(folder / "truth" / "labels"),
        }


def read_from_shard(shard: Path, name: str) -> Arrays:
    """Return the arrays of the specimen ``name`` in a shard, as :func:`read_specimen` does.

    Only what is a file is read, by no other name than plain ones. Raises :class:`EndoctError` as that does.
    """
    arrays: Arrays = {}
    with refusing(f"the shard {shard} cannot be read", remedy=AGAIN), open_regular(shard) as file:
        for array, inner in _members(file, name, shard):
            arrays[array] = read_npy(inner, f"{array} of {name} in {shard}", parts=WHOLE)
            if len(arrays) > MOST_ARRAYS:
                raise EndoctError(f"{shard} has too many arrays", expected=f"{MOST_ARRAYS} at most")
    return arrays


def _members(file: IO[bytes], name: str, shard: Path) -> Iterator[tuple[str, IO[bytes]]]:
    """Yield the arrays of one specimen in a tar file, (name, file to read)."""
    # "r:", not "r": a shard that endoct wrote is not compressed, and one that is may expand to anything
    with tarfile.open(fileobj=file, mode="r:") as tar:
        for member in tar:
            key, _, kind = member.name.partition(".")
            if key == name and kind.endswith(".npy") and member.isreg() and (inner := tar.extractfile(member)):
                yield plain_name(kind.removesuffix(".npy"), f"an array in {shard}"), inner


def _manifest(path: Path) -> list[dict[str, str]]:
    """Return the rows of the manifest, each with all that is needed of it."""
    with refusing(f"{path} is damaged"):
        with open_regular(path) as file, TextIOWrapper(file, encoding="utf-8", newline="") as text:
            every = list(csv.DictReader(text))
        if not every:
            raise EndoctError(f"{path} is empty")
        for row in every:
            if None in row or None in row.values():  # a row that is longer or shorter than the header
                raise EndoctError(f"{path} is damaged", found="rows that are not as long as its header")
            if not 0 < (length_mm := float(row["bore.length_mm"])) < LONGEST_MM:
                raise EndoctError(f"{path} is damaged", found=f"a bore of {length_mm:g} mm")
            plain_name(row["name"], f"a specimen of {path}")
            if int(row["index"]) < 0 or row["split"] not in SPLITS or not row["path"]:
                raise EndoctError(f"{path} is damaged", found="a row without index, split or path")
    return every


def _stack(frames: Any, folder: Path) -> NDArray[Any]:
    if len(frames) * math.prod(frames.frame_shape) * frames.dtype.itemsize > WHOLE * largest_array_bytes():
        check_array_size((len(frames), *frames.frame_shape), frames.dtype.itemsize, f"the recording {folder}")
    return np.stack([frames[i] for i in range(len(frames))])


def _frames(folder: Path) -> NDArray[np.uint8]:
    frames = _stack(open_stack(folder), folder)
    return frames if frames.ndim == 4 else np.repeat(frames[..., None], 3, axis=3)


def _labels(folder: Path) -> Arrays:
    arrays: Arrays = {}
    for store in sorted(folder.glob("*.zarr")):
        if store.is_symlink():
            raise EndoctError(f"{store} cannot be part of a data set", found="a link", expected="files and folders")
        for name, values in sorted(read_arrays(store, together=WHOLE).items()):
            arrays[f"labels.{store.stem}.{name}"] = values
    return arrays
