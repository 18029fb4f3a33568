"""Named arrays on disk: Zarr 3 stores for ``xarray.open_zarr``, written, checked and read without xarray.

A store says itself which codecs are to be run over its bytes and how much memory that takes. So Zarr is given an
array only after a check of what it declares, and of every chunk. Only what is on the lists
(:mod:`endoct.base.zarr.zarr_metadata`) goes on: a codec that is not there may run code. Links are not followed.
"""

import json
import math
import os
import struct
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import zarr
from numpy.typing import DTypeLike, NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, largest_array_bytes, plain_name, read_small
from endoct.base.files.json_values import an_object, read_object
from endoct.base.zarr.zarr_metadata import CHECKSUM, COMPRESSORS, OWN, Declared, declared, expanded_bytes

MOST_CHUNKS = 20_000
MOST_TEXT_BYTES = 1_000_000
_MOST_PADDED = 4
"""Chunks reach beyond the ends of an array; all of them together may have this many times the largest array."""
_SLACK_BYTES = 65_536
"""Data that cannot be compressed grow a little. A chunk may take this much more."""
MOST_METADATA_BYTES = 16_000_000
"""Metadata may have this many bytes. The root's hold those of all arrays, and the provenance."""
MOST_ARRAYS = 200
DAMAGED = "copy the store again, or make it again"


def check_array(array: Declared, *, whole: bool) -> None:
    """Check the sizes that ``array`` declares, then every chunk file against them.

    ``whole``: every chunk must be there; else a missing one is the fill value, as Zarr has it. Raises
    :class:`EndoctError` for sizes above the limits and too many chunks. Raises it also for a chunk that is missing, is
    no regular file, or expands to more than a chunk has.
    """
    check_sizes(array)
    found = _files(array.folder)
    for key in array.chunk_keys():
        if key in found:
            check_chunk(array, key)
        elif whole:
            raise EndoctError(
                f"{array.folder} is not whole", found=f"no chunk {key}", remedy="copy the store again, or make it again"
            )


def check_sizes(array: Declared) -> None:
    """Raise :class:`EndoctError` where ``array`` declares more samples, or more chunks, than the limits allow."""
    what = f"the array {array.folder}"
    for shape in (array.shape, array.chunk, array.inner):
        check_array_size(shape, array.itemsize, what)
    padded = math.prod(n * c for n, c in zip(array.n_chunks, array.chunk, strict=True)) * array.itemsize
    n_chunks = math.prod(array.n_chunks)
    if n_chunks > MOST_CHUNKS or math.prod(array.n_inner) > MOST_CHUNKS:
        raise EndoctError(f"{what} has too many chunks", found=f"{n_chunks}", expected=f"{MOST_CHUNKS} at most")
    if padded > _MOST_PADDED * largest_array_bytes():
        raise EndoctError(f"{what} has chunks that do not fit it", found=f"chunks of {array.chunk} for {array.shape}")


def _files(folder: Path) -> set[str]:
    """Return the regular files below ``folder``, relative. Raises :class:`EndoctError` for anything else there."""
    files: set[str] = set()
    below = [folder]
    while below:
        for entry in entries(below.pop()):
            if entry.is_dir(follow_symlinks=False):
                below.append(Path(entry.path))
            else:
                files.add(Path(entry.path).relative_to(folder).as_posix())
            if len(files) + len(below) > 4 * MOST_CHUNKS:
                raise EndoctError(f"{folder} has too many files", expected=f"{4 * MOST_CHUNKS} at most")
    return files


def entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Yield what lies in a folder of a store. Raises :class:`EndoctError` for links, pipes and the like."""
    try:
        with os.scandir(folder) as scan:
            every = sorted(scan, key=lambda entry: entry.name)
        for entry in every:
            if not (entry.is_dir(follow_symlinks=False) or entry.is_file(follow_symlinks=False)):
                found = "a link" if entry.is_symlink() else "something else"
                raise EndoctError(f"{entry.path} cannot be part of a store", found=found, expected="files and folders")
            yield entry
    except OSError as error:
        raise EndoctError(f"{folder} cannot be read", found=error.strerror or str(error)) from error


def check_chunk(array: Declared, key: str) -> None:
    """Raise :class:`EndoctError` where the chunk ``key``, relative to the folder, expands to more than a chunk has."""
    file = array.folder / key
    most = MOST_TEXT_BYTES if array.dtype is None else math.prod(array.chunk) * array.itemsize
    index_bytes = 16 * math.prod(array.n_inner) + 4 if array.is_sharded else 0
    data = read_small(file, most + most // 8 + index_bytes + _SLACK_BYTES)
    if not array.is_sharded:
        _check_encoded(array, data, most, file)
        return
    inner = math.prod(array.inner) * array.itemsize
    for start, length in _index(array, data, file):
        if length > inner + inner // 8 + _SLACK_BYTES:
            raise EndoctError(f"{file} is damaged", found=f"an inner chunk of {length} bytes", expected=f"{inner}")
        _check_encoded(array, data[start : start + length], inner, file)


def _index(array: Declared, data: bytes, file: Path) -> Iterator[tuple[int, int]]:
    """Yield where the inner chunks of a shard lie: (start, length) in bytes."""
    n_bytes = 16 * math.prod(array.n_inner)
    size = n_bytes + 4 * array.index_checksum
    if len(data) < size:
        raise EndoctError(f"{file} is cut off", found=f"{len(data)} bytes", expected=f"an index of {size}")
    index = data[:n_bytes] if array.index_first else data[len(data) - size :][:n_bytes]
    places = np.frombuffer(index, "<u8").reshape(-1, 2)
    for start, length in places[~(places == np.uint64(2**64 - 1)).all(axis=1)].tolist():
        if start + length > len(data):
            raise EndoctError(f"{file} is damaged", found="an inner chunk beyond its end")
        yield start, length


def _check_encoded(array: Declared, data: bytes, n_bytes: int, file: Path) -> None:
    """Check that ``data`` expand to no more than the ``n_bytes`` of a chunk."""
    codecs = list(array.compression)
    while codecs and codecs[-1] == CHECKSUM:
        data, _ = data[:-4], codecs.pop()  # the sum itself is Zarr's to check
    # a checksum taken before compression adds to what is compressed
    most = n_bytes + 4 * codecs.count(CHECKSUM)
    compressor = next((name for name in codecs if name in COMPRESSORS), None)
    expanded = len(data) if compressor is None else expanded_bytes(data, compressor, most, str(file))
    if expanded > most or (array.dtype is not None and expanded != most):
        raise EndoctError(
            f"{file} is no chunk of its array",
            found=f"{'more' if expanded > most else 'less'} than it can have",
            expected=f"{most} bytes",
            remedy="the file is damaged or not what it seems; copy the store again, or make it again",
        )
    if array.dtype is None:
        _check_texts(array, data, compressor, file)


def _check_texts(array: Declared, data: bytes, compressor: str | None, file: Path) -> None:
    """Check how many texts a chunk states, for which memory is taken at once."""
    expanded = bytes(numcodecs.get_codec({"id": compressor}).decode(data)) if compressor else data
    stated = struct.unpack_from("<I", expanded)[0] if len(expanded) >= 4 else -1
    if stated != math.prod(array.chunk):
        raise EndoctError(f"{file} is no chunk of its array", found=f"{stated} texts", expected=f"{array.chunk[0]}")


@dataclass(frozen=True)
class Named:
    """An array with its dims, attributes such as ``units``, and the shape of its chunks (None: as Zarr sees fit)."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, str] = field(default_factory=dict)
    chunks: tuple[int, ...] | None = None


def write_arrays(
    path: Path, arrays: Mapping[str, Named], attributes: Mapping[str, Any], *, coordinates: Iterable[str] = ()
) -> zarr.Group:
    """Write ``arrays`` as a Zarr group to ``path``, which must not exist, and return it.

    An array named like its only dim is a coordinate; ``coordinates`` names others. Texts are arrays of objects.
    Metadata are consolidated, so that a plain ``xarray.open_zarr(path)`` is fast and warns of nothing.
    """
    others = {"coordinates": " ".join(coordinates)} if coordinates else {}
    group = zarr.create_group(path, zarr_format=3, attributes={**attributes, **others})
    for name, array in arrays.items():
        sizes = dict(zip(array.dims, array.values.shape, strict=True))
        dtype = str if array.values.dtype.kind == "O" else array.values.dtype
        made = new_array(group, name, sizes, dtype, chunks=array.chunks, attributes=array.attributes)
        made[...] = array.values
    consolidate(path)
    return group


def new_array(
    group: zarr.Group,
    name: str,
    sizes: Mapping[str, int],
    dtype: DTypeLike,
    *,
    chunks: tuple[int, ...] | None = None,
    attributes: Mapping[str, str] | None = None,
    fill_value: float | None = None,
) -> Any:  # zarr.Array, whose type does not say what can be assigned
    """Return a new array of ``group``, with ``sizes`` by dim, of which every chunk must be filled.

    A missing chunk is damage to a reader, so that chunks of nothing but the fill value are written too. Every chunk has
    a checksum, which reveals a bit that flipped.
    """
    filled: dict[str, Any] = {} if fill_value is None else {"fill_value": fill_value}
    return group.create_array(
        name,
        shape=tuple(sizes.values()),
        dtype=dtype,
        chunks=chunks or "auto",
        compressors=(ZstdCodec(level=0), Crc32cCodec()),
        **filled,
        dimension_names=tuple(sizes),
        attributes=dict(attributes or {}),
        config={"write_empty_chunks": True},
    )


def consolidate(path: Path) -> None:
    """Gather the metadata of all arrays below ``path`` in one place, for readers to open at once."""
    # consolidated metadata are not in the Zarr 3 specification yet; readers that do not know them ignore them
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        zarr.consolidate_metadata(str(path))


def write_attributes(path: Path, attributes: Mapping[str, Any]) -> None:
    """Write ``attributes`` of the Zarr group at ``path`` in place of those of their names."""
    metadata = read_object(path / "zarr.json", MOST_METADATA_BYTES)
    metadata["attributes"] |= attributes  # by hand: what else lies in the store need be none of its arrays
    (path / "zarr.json").write_text(json.dumps(metadata, indent=2), encoding="utf-8")


def read_attributes(path: Path) -> dict[str, Any]:
    """Return the attributes of a store. Raises :class:`EndoctError` where ``path`` is no Zarr 3 group."""
    metadata = read_object(path / "zarr.json", MOST_METADATA_BYTES)
    if metadata.get("node_type") != "group" or metadata.get("zarr_format") != 3:
        raise EndoctError(f"{path} is no store of arrays", expected="a Zarr 3 group")
    return an_object(metadata.get("attributes", {}), f"the attributes of {path}")


def read_array_attributes(path: Path, name: str) -> dict[str, Any]:
    """Return the attributes of an array of a store. Raises :class:`EndoctError` where its metadata cannot be read."""
    metadata = read_object(path / plain_name(name, f"an array of {path}") / "zarr.json", MOST_METADATA_BYTES)
    return an_object(metadata.get("attributes", {}), f"the attributes of {path / name}")


def read_arrays(path: Path, names: Iterable[str] | None = None, *, together: int = 4) -> dict[str, NDArray[Any]]:
    """Return the arrays of a store that endoct wrote, all or those of ``names`` that are there.

    They are looked for in the folder itself: consolidated metadata may contradict the arrays'. What is no array, such
    as the list of what endoct wrote, is passed over. Before memory is taken, raises :class:`EndoctError` for an array
    that is not as endoct writes it, is larger than the limit, or lacks a chunk. All together may have ``together``
    times that limit.
    """
    folders = {entry.name: Path(entry.path) for entry in entries(path) if entry.is_dir(follow_symlinks=False)}
    wanted = folders.keys() if names is None else [name for name in names if name in folders]
    arrays = [declared(folders[name], OWN) for name in wanted if _is_array(folders[name])]
    _check_all(path, arrays, together)
    return {array.folder.name: _read(array) for array in arrays}


def read_array(array: Declared) -> NDArray[Any]:
    """Return an array that :func:`~endoct.base.zarr.zarr_store.check_array` has found sound.

    Raises :class:`EndoctError` for what it could not see, as a sum that is not right.
    """
    with refusing(f"{array.folder} cannot be read", remedy=DAMAGED):
        stored: Any = zarr.open_array(array.folder, mode="r", zarr_format=3 if array.zarr_format == 3 else 2)
        return np.asarray(stored[...])


def _read(array: Declared) -> NDArray[Any]:
    plain_name(array.folder.name, f"an array of {array.folder.parent}")
    check_array(array, whole=True)
    return read_array(array)


def _is_array(folder: Path) -> bool:
    if not (folder / "zarr.json").exists():
        return False
    return read_object(folder / "zarr.json", MOST_METADATA_BYTES).get("node_type") != "group"


def _check_all(path: Path, arrays: list[Declared], together: int) -> None:
    """Raise :class:`EndoctError` where the arrays of one store are too many, or too much together."""
    n_bytes, limit = sum(array.n_bytes for array in arrays), together * largest_array_bytes()
    if len(arrays) > MOST_ARRAYS or n_bytes > limit:
        raise EndoctError(
            f"{path} asks for too much memory",
            found=f"{len(arrays)} arrays of {n_bytes / 1e9:.3g} GB",
            expected=f"{MOST_ARRAYS} and {limit / 1e9:g} GB at most",
            remedy="check the store; if it is right, set ENDOCT_LARGEST_ARRAY_GB to more",
        )
