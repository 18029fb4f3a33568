"""Zarr arrays from disk, checked before Zarr is given them: what they declare, and every chunk.

A store says itself which codecs are to be run over its bytes and how much memory that takes. So the metadata are read
here first, and only what is on the lists below goes on: a codec that is not there may run code. Links are not followed.
"""

import math
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from endoct.stitching.compressed import COMPRESSORS, expanded_bytes
from endoct.stitching.errors import EndoctError
from endoct.stitching.files import read_small
from endoct.stitching.limits import check_array_size, largest_array_bytes
from endoct.stitching.zarr_metadata import CHECKSUM, Declared

MOST_CHUNKS = 20_000
MOST_TEXT_BYTES = 1_000_000
_MOST_PADDED = 4
"""Chunks reach beyond the ends of an array; all of them together may have this many times the largest array."""
_SLACK_BYTES = 65_536
"""What does not shrink grows a little when it is compressed."""


def check_array(array: Declared, *, whole: bool) -> None:
    """Check the sizes that ``array`` declares, then every chunk file against them.

    ``whole``: every chunk must be there; else one that is missing is the fill value, as Zarr has it. Raises
    :class:`EndoctError` for an array or a chunk above the limits, too many chunks, a chunk that is missing, is no
    regular file, or expands to more than a chunk has.
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
    import numcodecs

    expanded = bytes(numcodecs.get_codec({"id": compressor}).decode(data)) if compressor else data
    stated = struct.unpack_from("<I", expanded)[0] if len(expanded) >= 4 else -1
    if stated != math.prod(array.chunk):
        raise EndoctError(f"{file} is no chunk of its array", found=f"{stated} texts", expected=f"{array.chunk[0]}")
