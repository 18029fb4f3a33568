"""Reads the specimens of a data set as arrays, for torch's DataLoader and whatever else."""

import csv
import json
import tarfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.recording import open_stack
from endoct.stitching.errors import EndoctError
from endoct.synthetic.presets import PRESETS
from endoct.workbench.dataset.plan import SPLITS, Split

TRUTH = ("relief_mm", "cell", "cell_id")
VIDEO_SUFFIXES = (".mp4", ".mkv", ".avi", ".mov")

Arrays = dict[str, NDArray[Any]]


class Specimens:
    """The specimens of a data set, or of one split of it; a map-style data set for torch's ``DataLoader``.

    ``specimens[i]`` is a dictionary of arrays:

    - ``oct`` u8 (slice, depth, A-scan), in the order recorded;
    - ``endoscope`` u8 (frame, row, column, 3), RGB also where the recording is grey;
    - ``relief_mm`` f32, ``cell`` bool and ``cell_id`` i32, all (z, θ): the truth in the bore frame, row k at
      z = k·dz mm from the mouth, column j at θ = 2πj/n. It is cut where the set's shortest bore ends, beyond all
      recordings, so that truth of many specimens can be stacked;
    - ``labels.STORE.NAME`` where the set was made with labels, as :mod:`endoct.synthetic.labels` tells;
    - ``index``, of the specimen in the set.

    ``rows`` holds the lines of ``manifest.csv``, column → text. Both formats can be read; for shards the
    ``webdataset`` library streams better. Raises :class:`EndoctError` where ``root`` holds no finished data set.
    """

    def __init__(self, root: Path | str, split: Split | None = None) -> None:
        self.root = Path(root)
        if split is not None and split not in SPLITS:
            raise EndoctError(f"there is no split '{split}'", expected=f"one of {', '.join(SPLITS)}")
        try:
            with (self.root / "manifest.csv").open(encoding="utf-8", newline="") as file:
                every = list(csv.DictReader(file))
            preset = json.loads((self.root / "dataset.json").read_text(encoding="utf-8"))["arguments"]["preset"]
        except (OSError, ValueError, KeyError) as error:
            raise EndoctError(
                f"{self.root} holds no finished data set",
                found=str(error),
                expected="dataset.json and manifest.csv",
                remedy="start its `endoct dataset` again, which makes what is missing",
            ) from error
        self.rows = [row for row in every if split in (None, row["split"])]
        shortest_mm = min(float(row["bore.length_mm"]) for row in every)
        self._n_z = int(shortest_mm / PRESETS[preset].wall_dz_mm)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> dict[str, Any]:
        row = self.rows[index]
        path = self.root / row["path"]
        arrays = read_specimen(path) if path.is_dir() else read_from_shard(path, row["name"])
        truth = {name: arrays[name][: self._n_z] for name in TRUTH}
        return {"index": int(row["index"])} | arrays | truth


def read_specimen(folder: Path) -> Arrays:
    """Return the arrays of the specimen in ``folder``, as :class:`Specimens` describes them, truth uncut."""
    import zarr

    wall = zarr.open_group(folder / "truth" / "wall.zarr", mode="r")
    return {
        "oct": _stack(open_stack(folder / "oct")),
        "endoscope": _frames(folder / "endoscope"),
        **{name: np.asarray(wall[name]) for name in TRUTH},
        **_labels(folder / "truth" / "labels"),
    }


def read_from_shard(shard: Path, name: str) -> Arrays:
    """Return the arrays of the specimen ``name`` in a shard, as :func:`read_specimen` does."""
    arrays: Arrays = {}
    with tarfile.open(shard) as tar:
        for member in tar:
            key, _, kind = member.name.partition(".")
            if key == name and kind.endswith(".npy") and (file := tar.extractfile(member)) is not None:
                arrays[kind.removesuffix(".npy")] = np.load(BytesIO(file.read()))
    return arrays


def _stack(frames: Any) -> NDArray[Any]:
    return np.stack([frames[i] for i in range(len(frames))])


def _frames(folder: Path) -> NDArray[np.uint8]:
    videos = [path for path in folder.iterdir() if path.suffix in VIDEO_SUFFIXES]
    if videos:
        import av

        with av.open(str(videos[0])) as video:
            return np.stack([frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)])
    frames = _stack(open_stack(folder))
    return frames if frames.ndim == 4 else np.repeat(frames[..., None], 3, axis=3)


def _labels(folder: Path) -> Arrays:
    import zarr

    found: Arrays = {}
    for store in sorted(folder.glob("*.zarr")):
        for name, values in sorted(zarr.open_group(store, mode="r").arrays()):
            found[f"labels.{store.stem}.{name}"] = np.asarray(values)
    return found
