"""A file that lies in pieces inside another one, as a video does in DICOM: read in place, never copied."""

import io
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO, cast

from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular


@dataclass(frozen=True)
class FilePart:
    """``pieces`` of the file at ``path``, start and length in bytes, that are one file together."""

    path: Path
    pieces: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        return str(self.path)


Source = Path | FilePart


def size_of_source(source: Source) -> int:
    """Return how many bytes there are."""
    return sum(length for _, length in source.pieces) if isinstance(source, FilePart) else source.stat().st_size


@contextmanager
def open_source(source: Source) -> Iterator[BinaryIO]:
    """Open a file, or a part of one, to read. Raises what :func:`~endoct.base.files.files.open_regular` does."""
    if not isinstance(source, FilePart):
        with open_regular(source) as file:
            yield file
        return
    with open_regular(source.path) as file:
        yield cast(BinaryIO, io.BufferedReader(_Pieces(file, source.pieces)))


def start_of_source(source: Source, count: int) -> bytes:
    """Return the first ``count`` bytes, none where they cannot be read."""
    try:
        with open_source(source) as file:
            return file.read(count)
    except (EndoctError, OSError):
        return b""


class _Pieces(io.RawIOBase):
    """The pieces of an open file, one behind the other."""

    def __init__(self, file: BinaryIO, pieces: tuple[tuple[int, int], ...]) -> None:
        self._file, self._pieces = file, pieces
        self._ends = list(accumulate(length for _, length in pieces))
        self._at = 0

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go to a place, and return it."""
        base = (0, self._at, self._ends[-1] if self._ends else 0)[whence]
        self._at = max(0, base + offset)
        return self._at

    def readinto(self, buffer: memoryview, /) -> int:  # type: ignore[override]  # of whatever buffer
        """Read what follows of one piece."""
        k = bisect_right(self._ends, self._at)
        if k == len(self._ends):
            return 0
        start, length = self._pieces[k]
        within = self._at - (self._ends[k] - length)
        self._file.seek(start + within)
        data = self._file.read(min(len(buffer), length - within))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)
