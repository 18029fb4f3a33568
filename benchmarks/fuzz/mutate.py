"""One damage after the other to a sound case, the same ones for the same random numbers."""

import contextlib
import gzip
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import PurePosixPath
from random import Random

from benchmarks.fuzz.archives import mutate_tar, mutate_zip
from benchmarks.fuzz.arrays import mutate_npy, mutate_roi
from benchmarks.fuzz.headers import mutate_dicom, mutate_lines
from benchmarks.fuzz.images import mutate_bmp, mutate_jpeg, mutate_png
from benchmarks.fuzz.raw import mutate_bytes, splice
from benchmarks.fuzz.store_values import change_values
from benchmarks.fuzz.stores import mutate_store_json
from benchmarks.fuzz.texts import mutate_csv, mutate_json, mutate_toml, mutate_xml
from benchmarks.fuzz.tiff import mutate_tiff
from benchmarks.fuzz.trees import Entry, Seed, Special
from benchmarks.fuzz.values import NAMES
from benchmarks.fuzz.videos import mutate_video

_CANNOT = (
    OSError,
    EOFError,
    zlib.error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    RecursionError,
    OverflowError,
    struct.error,
)

DOCUMENTS = ("json", "toml", "csv", "zarray", "zattrs", "zgroup")
"""Ends of the names of files that say what the others are; they are hit more often."""


def mutated(seed: Seed, others: Sequence[Seed], rng: Random) -> dict[str, Entry]:
    """Return the files of ``seed`` with one to five damages; parts may come from ``others``."""
    tree = dict(seed.files)
    stored = any(name.endswith("zarr.json") for name in tree)
    narrow = rng.random() < 0.5  # what lies in stores is left alone, so that what reads the rest is reached
    for _ in range(rng.choice((1, 1, 1, 1, 2, 2, 3, 5))):
        # what was damaged before may be too odd for a damage that keeps its form
        with contextlib.suppress(*_CANNOT):
            _damage(tree, others, rng, in_stores=stored and not narrow)
    return tree


def _damage(tree: dict[str, Entry], others: Sequence[Seed], rng: Random, *, in_stores: bool) -> None:
    files = [name for name, entry in tree.items() if isinstance(entry, bytes)]
    if in_stores and rng.random() < 0.45:
        change_values(tree, rng)
    elif not files or rng.random() < (0.12 if len(tree) > 1 else 0.02):
        _change_tree(tree, rng)
    else:
        files = [name for name in files if not in_stores and ".zarr/" not in name] or files
        documents = [name for name in files if name.endswith(DOCUMENTS)]
        name = rng.choice(documents if documents and rng.random() < 0.6 else files)
        tree[name] = _change_file(name, _bytes(tree[name]), others, rng)


def mutate_file(name: str, data: bytes, rng: Random) -> bytes:
    """Return one file changed as its form allows; the form is recognised by its bytes, or else by its name."""
    return _mutator(name, data)(data, rng)


def _change_file(name: str, data: bytes, others: Sequence[Seed], rng: Random) -> bytes:
    kind = rng.random()
    if kind < (0.88 if name.endswith(DOCUMENTS) else 0.68):  # texts with flipped bits are seldom more than no texts
        return mutate_file(name, data, rng)
    if kind < 0.95:
        return mutate_bytes(data, rng)
    suffix = PurePosixPath(name).suffix
    alike = [
        entry
        for other in others
        for path, entry in other.files.items()
        if isinstance(entry, bytes) and (path.endswith(suffix) or rng.random() < 0.05)
    ]
    return splice(data, rng.choice(alike), rng) if alike else mutate_bytes(data, rng)


def _mutator(name: str, data: bytes) -> Callable[[bytes, Random], bytes]:
    starts: tuple[tuple[bytes, Callable[[bytes, Random], bytes]], ...] = (
        (b"\x93NUMPY", mutate_npy), (b"\x89PNG", mutate_png), (b"\xff\xd8", mutate_jpeg), (b"BM", mutate_bmp),
        (b"II*\0", mutate_tiff), (b"MM\0*", mutate_tiff), (b"II+\0", mutate_tiff), (b"MM\0+", mutate_tiff),
        (b"Iout", mutate_roi), (b"RIFF", mutate_video), (b"\x1a\x45\xdf\xa3", mutate_video),
        (b"PK", lambda data, rng: mutate_zip(data, rng, _inner)), (b"NRRD", mutate_lines),
        (b"ObjectType", mutate_lines), (b"\x1f\x8b", _mutate_gzip),
    )  # fmt: skip
    if data[128:132] == b"DICM":
        return mutate_dicom
    ends: dict[str, Callable[[bytes, Random], bytes]] = {
        ".toml": mutate_toml, ".csv": mutate_csv, ".txt": mutate_csv, ".mp4": mutate_video, ".mov": mutate_video,
        ".tar": lambda data, rng: mutate_tar(data, rng, _inner), ".json": mutate_json,
        ".fcsv": mutate_csv, ".ctbl": mutate_csv, ".xml": mutate_xml, ".safetensors": _mutate_weights,
    }  # fmt: skip
    path = PurePosixPath(name)
    if path.name in ("zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata"):
        return mutate_store_json
    by_start = next((mutate for start, mutate in starts if data.startswith(start)), None)
    return by_start or ends.get(path.suffix.lower(), mutate_bytes)


def _inner(name: str, data: bytes, rng: Random) -> bytes:
    if data[:6] == b"\x93NUMPY" and b"{" in data[128:] and rng.random() < 0.6:
        return _npy_of_text(data, rng)
    return mutate_file(name, data, rng) if rng.random() < 0.7 else mutate_bytes(data, rng)


def _mutate_gzip(data: bytes, rng: Random) -> bytes:
    """Return a gzip whose content was changed, or itself."""
    if rng.random() < 0.3:
        return mutate_bytes(data, rng)
    return gzip.compress(mutate_bytes(gzip.decompress(data), rng), mtime=0)


def _mutate_weights(data: bytes, rng: Random) -> bytes:
    """Return safetensors whose table of arrays was changed, which has its length before it, or their values."""
    begin = 8 + int.from_bytes(data[:8], "little")
    if rng.random() < 0.5:
        return data[:begin] + mutate_bytes(data[begin:], rng)
    table = mutate_json(data[8:begin], rng)
    return len(table).to_bytes(8, "little") + table + data[begin:]


def _npy_of_text(data: bytes, rng: Random) -> bytes:
    """Return an array that holds one text, as pictures hold their metadata, with the JSON in it changed."""
    text = data[data.find(b"\n", 10) + 1 :].decode("utf-32-le", "replace")
    changed = mutate_json(text.encode(), rng).decode("utf-8", "replace")[:20_000]
    header = f"{{'descr': '<U{max(1, len(changed))}', 'fortran_order': False, 'shape': (), }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + changed.encode("utf-32-le", "replace")


def _bytes(entry: Entry) -> bytes:
    return entry if isinstance(entry, bytes) else b""


def _change_tree(tree: dict[str, Entry], rng: Random) -> None:
    """Remove, rename, double or replace a file, or all that is in a folder."""
    name = rng.choice(list(tree))
    parent = PurePosixPath(name).parent
    kind = rng.random()
    if kind < 0.3:
        del tree[name]
    elif kind < 0.4:
        folder = rng.choice(list(PurePosixPath(name).parents) or [parent])
        for other in [one for one in tree if folder in PurePosixPath(one).parents and folder != PurePosixPath(".")]:
            del tree[other]
    elif kind < 0.6:
        tree[str(parent / rng.choice(NAMES))] = tree[name] if rng.random() < 0.5 else tree.pop(name)
    elif kind < 0.75:
        tree[name] = tree[rng.choice(list(tree))]
    elif kind < 0.85:
        tree[name] = rng.choice((b"", b"\0", b"\0" * 10_000, b"{}", b"[]"))
    elif kind < 0.95:
        targets = (".", "..", PurePosixPath(name).name, "nowhere", "/dev/zero", "/dev/null", "/")
        link = Special("link", rng.choice(targets))
        tree[name] = rng.choice((Special("folder"), Special("folder"), link, link, Special("pipe")))
    else:
        suffix = rng.choice((".tif", ".png", ".npy", ".mkv", ".zarr", ".csv", ".roi", ".zip", ".jpg", ".toml", ""))
        tree[str(PurePosixPath(name).with_suffix(suffix)) if suffix else name.partition(".")[0] or "x"] = tree.pop(name)
