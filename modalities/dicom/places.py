"""Where in a DICOM file the bytes of each frame lie: one behind the other, or in the fragments of compressed ones."""

import os
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from endoct.base.errors import EndoctError

if TYPE_CHECKING:
    from pydicom import Dataset

SAMPLES, ITEM, END = 0x7FE0_0010, b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
UNDEFINED = 0xFFFF_FFFF
LONG = (b"OB", b"OW", b"UN", b"OF", b"OD", b"OL", b"OV")
"""Kinds of values whose length has four bytes."""
MOST_FRAGMENTS = 1_000_000
MOST_TABLE_BYTES = 8_000_000
BIG_ENDIAN, IMPLICIT = "1.2.840.10008.1.2.2", ("", "1.2.840.10008.1.2")
COPY = "copy it again"
Fragment = tuple[int, int]
"""Start and length, in bytes of the file."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where frames lie: ``starts`` and ``lengths`` of fragments; those from ``first[i]`` on are frame i's.

    Without ``first`` all fragments are one stream.
    """

    starts: Sequence[int]
    lengths: Sequence[int]
    first: Sequence[int] = ()

    @property
    def n_frames(self) -> int:
        """How many frames there are; -1 of a stream."""
        return len(self.first) - 1

    def of(self, index: int) -> list[Fragment]:
        """Return the fragments of a frame."""
        begin, end = self.first[index], self.first[index + 1]
        return list(zip(self.starts[begin:end], self.lengths[begin:end], strict=True))

    @property
    def every(self) -> list[Fragment]:
        """All fragments."""
        return list(zip(self.starts, self.lengths, strict=True))


def samples_at(file: BufferedReader, path: Path, encoding: tuple[bool | None, bool | None]) -> tuple[int, int]:
    """Return where the samples begin, whose element the file is at, and how many bytes they have, or ``UNDEFINED``.

    ``encoding``: whether kinds of values are implicit, and whether numbers are little endian. Raises
    :class:`EndoctError` where the file ends before them.
    """
    implicit, order = encoding[0], "little" if encoding[1] else "big"
    head = file.read(8)
    tag = int.from_bytes(head[:2], order) << 16 | int.from_bytes(head[2:4], order)  # type: ignore[arg-type]
    if len(head) < 8 or tag != SAMPLES:
        raise EndoctError(f"{path} holds no samples", found="a file that ends before them, or no image", remedy=COPY)
    long = not implicit and head[4:6] in LONG
    length = file.read(4) if long else head[4:8] if implicit else head[6:8]
    return file.tell(), int.from_bytes(length, order)  # type: ignore[arg-type]


def size_of(file: BufferedReader) -> int:
    """Return how many bytes an opened file has."""
    return os.fstat(file.fileno()).st_size


def places_of_plain(file: BufferedReader, path: Path, start: int, n_frames: int, frame_bytes: int) -> Places:
    """Return where uncompressed frames lie. Raises :class:`EndoctError` where the file ends before they do."""
    needed = start + n_frames * frame_bytes
    if size_of(file) < needed:
        raise EndoctError(f"{path} is cut off", found=f"{size_of(file)} bytes", expected=f"{needed}", remedy=COPY)
    starts = range(start, needed, frame_bytes)
    return Places(starts, [frame_bytes] * n_frames, range(n_frames + 1))


def places_of_fragments(file: BufferedReader, path: Path, start: int, header: "Dataset", n_frames: int) -> Places:
    """Return where the fragments of compressed frames lie. Raises :class:`EndoctError` where they are not all there."""
    starts, lengths = _fragments(file, path, start)
    n = len(starts) - 1
    if n < 1:
        raise EndoctError(f"{path} is cut off", found="no compressed frame", expected=f"{n_frames}", remedy=COPY)
    table = _table(file, header, starts[0], lengths[0])
    starts, lengths = starts[1:], lengths[1:]
    if n == n_frames:
        return Places(starts, lengths, range(n + 1))
    if n_frames == 1:
        return Places(starts, lengths, (0, n))
    if len(table) != n_frames:
        found = f"{n} fragments" + ("" if n < n_frames else ", which nothing assigns to frames")
        raise EndoctError(f"{path} is not whole", found=found, expected=f"{n_frames} frames", remedy=COPY)
    number = {place - starts[0]: k for k, place in enumerate(starts)}
    first = [number.get(offset, -1) for offset in table]
    if -1 in first or first[0] != 0 or sorted(set(first)) != first:
        raise EndoctError(f"{path} is damaged", found="a table of frames that leads nowhere", remedy=COPY)
    return Places(starts, lengths, (*first, n))


def places_of_stream(file: BufferedReader, path: Path, start: int) -> Places:
    """Return where the fragments of a video lie."""
    starts, lengths = _fragments(file, path, start)
    return Places(starts[1:], lengths[1:])


def _fragments(file: BufferedReader, path: Path, start: int) -> "tuple[array[int], array[int]]":
    """Return starts and lengths of all items, the table of offsets among them."""
    starts, lengths = array("q"), array("q")
    size, at = size_of(file), start
    while at + 8 <= size and len(starts) < MOST_FRAGMENTS:
        file.seek(at)
        head = file.read(8)
        if head[:4] == END:
            return starts, lengths
        length = int.from_bytes(head[4:], "little")
        if head[:4] != ITEM or at + 8 + length > size:
            break
        starts.append(at + 8)
        lengths.append(length)
        at += 8 + length
    if at != size:
        raise EndoctError(f"{path} is cut off or damaged", found=f"{len(starts)} whole fragments", remedy=COPY)
    return starts, lengths


def _table(file: BufferedReader, header: "Dataset", start: int, length: int) -> list[int]:
    """Return where frames begin, from the first fragment on, as a table says; none where there is none."""
    extended = header.get("ExtendedOffsetTable")
    if isinstance(extended, bytes) and len(extended) % 8 == 0 and len(extended) <= MOST_TABLE_BYTES:
        return [int(offset) for offset in np.frombuffer(extended, "<u8")]
    if length % 4 or length > MOST_TABLE_BYTES:
        return []
    file.seek(start)
    return [int(offset) for offset in np.frombuffer(file.read(length), "<u4")]
