"""Where compressed frames lie in a DICOM file: its fragments, which of them are one frame, and the tables that say so.

Why not pydicom's ``encaps``? It takes a file that is cut off for whole, takes any number of fragments, guesses where
frames end by two bytes that may stand anywhere, and goes through all fragments again for each frame.
"""

import os
from array import array
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.dicom.decoding import CODESTREAM

if TYPE_CHECKING:
    from pydicom import Dataset

ITEM, END = b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
MOST_TABLE_BYTES = 8_000_000
MOST_FRAMES = 1_000_000
COPY = "copy it again"
STARTS = (b"\xff\xd8\xff", CODESTREAM[:3])


@dataclass(frozen=True, eq=False)
class FragmentPlaces:
    """Where compressed frames lie: ``pieces`` (n, 2), start and length in bytes; frame i has ``first[i]`` and on."""

    pieces: NDArray[np.int64]
    first: NDArray[np.int64]

    def joined(self, file: BufferedReader, index: int, name: str) -> bytes:
        """Return the bytes of a frame. Raises ``ValueError`` where the file, called ``name``, ends before they do."""
        pieces = self.pieces[self.first[index] : self.first[index + 1]].tolist()
        total = sum(length for _, length in pieces)
        check_array_size((total,), 1, f"a frame of {name}")
        data = bytearray()
        for start, length in pieces:
            file.seek(start)
            data += file.read(length)
        if len(data) != total:
            raise ValueError("a file that is cut off")
        return bytes(data)


def places_of(file: BufferedReader, path: Path, start: int, header: "Dataset", n_frames: int) -> FragmentPlaces:
    """Return where compressed frames lie. Raises :class:`EndoctError` where they are not all there."""
    table, pieces = np.split(fragments_of(file, path, start), [1])
    n = len(pieces)
    offsets = _table(file, header, *table[0].tolist()) if n else np.empty(0, np.int64)
    if n == n_frames or (
        n_frames == 1 and n and len(offsets) < 2 and not any(_begins(file, at) for at in pieces[1:, 0].tolist())
    ):
        return FragmentPlaces(pieces, np.linspace(0, n, n_frames + 1, dtype=np.int64))
    if len(offsets) != n_frames:
        found = f"{n} fragments" + ("" if n < n_frames else ", which nothing assigns to frames")
        raise EndoctError(f"{path} is not whole", found=found, expected=f"{n_frames} frames", remedy=COPY)
    first = np.searchsorted(pieces[:, 0] - pieces[0, 0], offsets)
    if (
        first[0] != 0
        or first[-1] >= n
        or (np.diff(first) < 1).any()
        or (pieces[first, 0] - pieces[0, 0] != offsets).any()
    ):
        raise EndoctError(f"{path} is damaged", found="a table of frames that leads nowhere", remedy=COPY)
    return FragmentPlaces(pieces, np.append(first, n))


def _begins(file: BufferedReader, at: int) -> bool:
    """Say whether a JPEG, or JPEG 2000, begins at a place."""
    file.seek(at)
    return file.read(3) in STARTS


def fragments_of(file: BufferedReader, path: Path, start: int) -> NDArray[np.int64]:
    """Return all items (n, 2), start and length in bytes, the table of offsets first."""
    found = array("q")
    size, at = os.fstat(file.fileno()).st_size, start
    while at + 8 <= size and len(found) < 2 * MOST_FRAMES:
        file.seek(at)
        head = file.read(8)
        if head[:4] == END:
            at = size
            break
        length = int.from_bytes(head[4:], "little")
        if head[:4] != ITEM or at + 8 + length > size:
            break
        found.extend((at + 8, length))
        at += 8 + length
    if at != size:
        raise EndoctError(f"{path} is cut off or damaged", found=f"{len(found) // 2} whole fragments", remedy=COPY)
    return np.array(found, np.int64).reshape(-1, 2)


def _table(file: BufferedReader, header: "Dataset", start: int, length: int) -> NDArray[np.int64]:
    """Return where frames begin, from the first fragment on, as a table says; none where there is none."""
    extended = header.get("ExtendedOffsetTable")
    if isinstance(extended, bytes) and len(extended) % 8 == 0 and len(extended) <= MOST_TABLE_BYTES:
        return np.frombuffer(extended, "<i8").astype(np.int64)
    if length % 4 or length > MOST_TABLE_BYTES:
        return np.empty(0, np.int64)
    file.seek(start)
    return np.frombuffer(file.read(length), "<u4").astype(np.int64)
