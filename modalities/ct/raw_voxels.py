"""Voxels after a header, or in a file that it names: plain or compressed, never more than were declared."""

import bz2
import os
import zlib
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import inside

BLOCK_BYTES = 1 << 20


def named_file(header: Path, name: object) -> Path:
    """Return the file of voxels that a header names, in its own folder.

    Raises :class:`EndoctError` for any other place, and for a list or a pattern of files.
    """
    if not isinstance(name, str) or not name or name.split()[0].upper() == "LIST" or "%" in name:
        raise EndoctError(
            f"{header} has its voxels in several files",
            found=f"{name!r}"[:60],
            expected="one file",
            remedy="save it as one file, .nrrd or .mha",
        )
    if "/" in name or "\\" in name:
        raise EndoctError(
            f"{header} names a file that does not lie next to it",
            found=f"{name!r}"[:80],
            expected="the name of a file in its folder",
            remedy="save it as one file, .nrrd or .mha",
        )
    return inside(header.parent, name, str(header))


def read_voxels(
    file: BufferedReader, path: Path, count: int, dtype: np.dtype[Any], packing: str, skip: int = 0
) -> NDArray[Any]:
    """Return ``count`` numbers from where ``file`` stands, in the machine's order of bytes.

    ``packing``: raw, zlib (gzip's framing or zlib's), bzip2. ``skip``: bytes to leave out before them, after unpacking;
    −1: as many as there are too many in all. Raises :class:`EndoctError` where there are fewer, or more: then the
    header does not fit them.
    """
    wanted = count * dtype.itemsize
    if packing == "raw":
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - wanted) if skip == -1 else file.tell() + skip)
        data = memoryview(file.read(wanted + 1))
    else:
        unpacked = bytearray()
        for piece in _unpacked(file, packing, wanted + max(skip, 0)):  # all, so that a checksum at its end is compared
            unpacked += piece
        data = memoryview(unpacked)[-wanted:] if skip == -1 else memoryview(unpacked)[skip:]
    if len(data) != wanted:
        found = f"{len(data)} bytes of voxels" if len(data) < wanted else f"more than {wanted} bytes of voxels"
        what = "is cut off" if len(data) < wanted else "has other voxels than its header says"
        raise EndoctError(f"{path} {what}", found=found, expected=f"{wanted}", remedy="copy it again, or save it anew")
    return np.frombuffer(data, dtype).astype(dtype.newbyteorder("="), copy=False)


def _unpacked(file: BufferedReader, packing: str, most: int) -> Iterator[bytes]:
    """Yield what a compressed stream holds, up to one byte more than ``most``; it has to be whole."""
    stream: Any = zlib.decompressobj(32 + zlib.MAX_WBITS) if packing == "zlib" else bz2.BZ2Decompressor()
    left, rest = most + 1, b""
    while not stream.eof and left > 0:
        piece = rest or file.read(BLOCK_BYTES)
        if not piece and getattr(stream, "needs_input", True):
            raise ValueError("compressed voxels that are cut off")
        data = stream.decompress(piece, min(left, BLOCK_BYTES))
        rest = getattr(stream, "unconsumed_tail", b"")
        left -= len(data)
        yield data
