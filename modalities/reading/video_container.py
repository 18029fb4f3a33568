"""Video containers: recognised by their first bytes, opened with bounds, and whether they were cut off.

A video may also lie in pieces inside another file, as it does in DICOM: it is read in place, never copied.
"""

import io
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn, cast

from endoct.base.errors import EndoctError, cause_of
from endoct.base.files.files import check_array_size, largest_array_bytes, open_regular
from endoct.modalities.reading.other_formats import STILL_BRANDS

if TYPE_CHECKING:
    import av

VIDEO_SUFFIXES = (".mkv", ".mp4", ".avi", ".mov", ".webm", ".m4v", ".3gp")
PIXEL_BYTES = 8
"""A decoded pixel takes no more bytes than this, in any format."""
READ_AHEAD_BYTES = 1 << 18
QUICKTIME_ATOMS = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
_SEGMENT = b"\x18\x53\x80\x67"
_MOST_ATOMS = 10_000
_MOST_MOOV_BYTES = 64_000_000


@dataclass(frozen=True)
class FilePart:
    """``pieces`` of the file at ``path``, start and length in bytes, that are one file together."""

    path: Path
    pieces: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        return str(self.path)


Source = Path | FilePart


@contextmanager
def opened_bytes(source: Source) -> Iterator[BinaryIO]:
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
        with opened_bytes(source) as file:
            return file.read(count) or b""  # None where a system's file has nothing to say just now
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


def container_of(path: Source) -> str:
    """Return what FFmpeg calls the container, by the file's first bytes; empty where it is none that is read."""
    start = start_of_source(path, 12)
    if start[:4] == b"\x1a\x45\xdf\xa3":
        return "matroska"
    if start[:4] == b"RIFF" and start[8:12] == b"AVI ":
        return "avi"
    is_still = start[4:8] == b"ftyp" and start[8:12] in STILL_BRANDS
    return "mov" if start[4:8] in QUICKTIME_ATOMS and not is_still else ""


def load_av() -> Any:
    """Return PyAV, which is loaded when a video is opened and not before."""
    import av

    return av


def _lenient_about_texts() -> dict[str, str]:
    """Return what has PyAV open a video whose texts are not UTF-8; from 19 on it does so by itself."""
    return {} if int(load_av().__version__.split(".")[0]) >= 19 else {"metadata_errors": "ignore"}


@contextmanager
def opened_video(path: Source, *, edited: bool = True) -> "Iterator[av.container.InputContainer]":
    """Open a video with what FFmpeg cannot take for an address, nor use to open anything else.

    ``edited``: as its edit list has it shown, not as it was recorded. Raises :class:`EndoctError` where it holds no
    pictures, or several tracks of them.
    """
    container = container_of(path)
    if not container:
        raise EndoctError(f"{path} is no readable video", expected="Matroska, WebM, MP4, AVI or QuickTime")
    unedited = {} if edited or container != "mov" else {"ignore_editlist": "1"}
    most_pixels = str(largest_array_bytes() // PIXEL_BYTES)
    with (
        opened_bytes(path) as file,
        load_av().open(
            file,
            "r",
            format=container,
            options={"protocol_whitelist": "none", "max_pixels": most_pixels, **unedited},
            **_lenient_about_texts(),
            buffer_size=READ_AHEAD_BYTES,
            io_open=_refuse_to_open,
        ) as opened,
    ):
        tracks = _tracks(opened)
        if len(tracks) != 1:
            raise EndoctError(
                f"{path} holds {'several recordings' if tracks else 'no pictures'}",
                found=f"{len(tracks)} tracks of pictures" if tracks else "a file with sound or data only",
                expected="a video with one track",
            )
        context = tracks[0].codec_context
        if context is None:
            raise EndoctError(f"{path} is coded in a way that is not read", remedy="export it as FFV1, H.264 or MJPEG")
        check_array_size((context.height, context.width), PIXEL_BYTES, f"a frame of {path}")
        context.options = {"max_pixels": most_pixels}
        yield opened


def pictures_of(opened: "av.container.InputContainer") -> "av.VideoStream":
    """Return the track of pictures of an opened video."""
    return _tracks(opened)[0]


def _tracks(opened: "av.container.InputContainer") -> "list[av.VideoStream]":
    covers = load_av().stream.Disposition.attached_pic
    return [stream for stream in opened.streams.video if not stream.disposition & covers]


def _refuse_to_open(url: str, flags: int, options: object) -> NoReturn:
    raise PermissionError(f"it refers to another file, {url[:80]}, {flags}, {options}")


def is_shortage(error: Exception) -> bool:
    """Say whether memory ran out; FFmpeg says so too where damaged bytes ask for an absurd amount of it."""
    return isinstance(error, MemoryError) and not isinstance(error, load_av().error.FFmpegError)


def cause_of_video(error: Exception) -> str:
    """Return what FFmpeg says, without the number of the error and the name of the file."""
    return (isinstance(error, load_av().error.FFmpegError) and error.strerror) or cause_of(error)


def is_cut_off(path: Source) -> bool | None:
    """Say whether a file ends before the end that its container states; None where that states none."""
    size = sum(length for _, length in path.pieces) if isinstance(path, FilePart) else path.stat().st_size
    with opened_bytes(path) as file:
        start = file.read(4)
        if start == b"RIFF":
            return _riff_end(file, size) > size
        end = _segment_end(file) if start == b"\x1a\x45\xdf\xa3" else None
    return None if end is None else end > size


def has_edits(path: Source) -> bool:
    """Say whether an MP4 or QuickTime file shows its frames otherwise than recorded: by two edits or more."""
    with opened_bytes(path) as file:
        moov = _atom(file, b"moov")
    at = moov.find(b"elst")
    while at >= 0:
        if int.from_bytes(moov[at + 8 : at + 12], "big") > 1:
            return True
        at = moov.find(b"elst", at + 4)
    return False


def _riff_end(file: BinaryIO, size: int) -> int:
    """Return where the last list of an AVI ends; long ones have several, one behind the other."""
    end = 0
    for _ in range(_MOST_ATOMS):
        file.seek(end)
        head = file.read(8)
        if head[:4] != b"RIFF":
            break
        end += 8 + int.from_bytes(head[4:8], "little")
        end += end % 2
        if end >= size:
            break
    return end - (end == size + 1)  # the byte that makes the length even may be missing


def _segment_end(file: BinaryIO) -> int | None:
    """Return where the segment of a Matroska file ends; None where it does not say."""
    file.seek(4)
    length = _element_size(file)
    if length is None:
        return None
    file.seek(length, 1)
    if file.read(4) != _SEGMENT:
        return None
    length = _element_size(file)
    return None if length is None else file.tell() + length


def _element_size(file: BinaryIO) -> int | None:
    """Return a size as EBML writes it; None for one that is not known."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    n = 9 - first[0].bit_length()
    value = int.from_bytes(first + file.read(n - 1), "big") & ((1 << 7 * n) - 1)
    return None if value == (1 << 7 * n) - 1 or value > 1 << 50 else value


def _atom(file: BinaryIO, name: bytes) -> bytes:
    """Return the content of an atom of the first level, empty where there is none, or it is huge."""
    at = 0
    for _ in range(_MOST_ATOMS):
        file.seek(at)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        if head[4:8] == name:
            file.seek(at + 8)
            return file.read(min(length, _MOST_MOOV_BYTES))
        if length < 8 or len(head) < 8 or length > 1 << 50:
            break
        at += length
    return b""
