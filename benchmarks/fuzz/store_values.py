"""Zarr arrays that are written as they should be, but of other values, another length or another type."""

import json
import math
from pathlib import PurePosixPath
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz.trees import Entry

_TYPES = {
    "bool": "?", "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2", "int32": "<i4", "uint32": "<u4",
    "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
_FLOATS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, -1e30, 3.4e38, 0.5, 1e6)


def change_values(tree: dict[str, Entry], rng: Random) -> None:
    """Write one array of a store of the third format anew."""
    nodes = [name for name in tree if name.endswith("zarr.json") and _array(tree[name]) is not None]
    if not nodes:
        return
    name = rng.choice(nodes)
    node = _array(tree[name])
    assert node is not None
    shape = [int(length) for length in node["shape"]]
    if rng.random() < 0.25 and shape:
        axis = rng.randrange(len(shape))
        shape[axis] = rng.choice((0, 1, 2, shape[axis] + 1, shape[axis] * 3))
    elif rng.random() < 0.1:
        shape = rng.choice(([], [*shape, 1], shape[1:]))
    if rng.random() < 0.2:
        node["data_type"] = rng.choice(list(_TYPES))
        node["fill_value"] = False if node["data_type"] == "bool" else 0
    values = _values(shape, _TYPES[node["data_type"]], rng)
    endian = {"name": "bytes", "configuration": {"endian": "little"}}
    node |= {
        "shape": shape,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [max(1, length) for length in shape]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes"} if values.itemsize == 1 else endian],
    }
    if len(node.get("dimension_names") or shape) != len(shape):
        node["dimension_names"] = [f"d{axis}" for axis in range(len(shape))]
    folder = PurePosixPath(name).parent
    for other in [
        one for one in tree if folder / "c" in PurePosixPath(one).parents or PurePosixPath(one) == folder / "c"
    ]:
        del tree[other]
    if values.size:
        tree[str(folder.joinpath("c", *("0" for _ in shape)))] = values.tobytes()
    tree[name] = json.dumps(node).encode()
    _change_group(tree, folder, node)


def _array(entry: Entry) -> dict[str, Any] | None:
    """Return the metadata of an array of numbers, None of anything else."""
    try:
        node: Any = json.loads(entry if isinstance(entry, bytes) else b"")
        shape = node["shape"]
        few = len(shape) < 6 and all(length >= 0 for length in shape) and math.prod(shape) < 100_000
        return node if few and node["data_type"] in _TYPES else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _values(shape: list[int], dtype: str, rng: Random) -> NDArray[Any]:
    numbers = np.random.default_rng(rng.randrange(1 << 30))
    kind = np.dtype(dtype)
    if kind.kind == "f":
        values = np.full(shape, rng.choice(_FLOATS), kind)
        if rng.random() < 0.6:
            values = numbers.choice(np.array(rng.sample(_FLOATS, 3)), shape).astype(kind)
        return values if rng.random() < 0.8 else np.sort(numbers.random(shape).astype(kind), axis=None).reshape(shape)
    least, most = (0, 1) if kind.kind == "b" else (np.iinfo(kind).min, np.iinfo(kind).max)
    likely = [least, most, 0, 1, most // 2]
    return np.asarray(numbers.choice(np.array(rng.sample(likely, rng.choice((1, 2))), object), shape)).astype(kind)


def _change_group(tree: dict[str, Entry], folder: PurePosixPath, node: dict[str, Any]) -> None:
    """Change what the group above has gathered of the array."""
    place = str(folder.parent / "zarr.json")
    entry = tree.get(place)
    if not isinstance(entry, bytes):
        return
    try:
        group: Any = json.loads(entry)
        gathered: Any = group["consolidated_metadata"]["metadata"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return
    if isinstance(gathered, dict) and folder.name in gathered:
        gathered[folder.name] = node
        tree[place] = json.dumps(group).encode()
