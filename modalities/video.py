"""Frames of a video file by their index: Matroska, MP4, AVI or QuickTime, decoded exactly, one at a time."""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError, cause_of
from endoct.stitching.files import open_regular, read_start
from endoct.stitching.limits import check_array_size, largest_array_bytes

if TYPE_CHECKING:
    import av

VIDEO_SUFFIXES = (".mkv", ".mp4", ".avi", ".mov")
RECENT_FRAMES = 8
"""Decoded frames kept, because threads ask for neighbours in any order; fewer where frames are very large."""
MOST_FRAMES = 1_000_000
PIXEL_BYTES = 8
"""A decoded pixel takes at most, in any format."""
READ_AHEAD_BYTES = 1 << 18
QUICKTIME_ATOMS = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")


def is_video(path: Path) -> bool:
    """Say whether the file starts as a Matroska, MP4, QuickTime or AVI file does."""
    return bool(_container(path))


def _container(path: Path) -> str:
    """Return what FFmpeg calls the container, by the file's first bytes; empty where it is none that is read."""
    start = read_start(path, 12)
    if start[:4] == b"\x1a\x45\xdf\xa3":
        return "matroska"
    if start[:4] == b"RIFF" and start[8:12] == b"AVI ":
        return "avi"
    return "mov" if start[4:8] in QUICKTIME_ATOMS else ""


class ReadVideo:
    """Reads one frame of a video; picklable, and safe to share among threads; a process forked after its first
    frame must not use it, but unpickle its own.

    Calling it with an index, counted in the order shown, gives (row, column) or (row, column, RGB), u8, or u16 where
    the video has more than 8 bits. ``n_frames`` are counted by going once through the file's packets, without
    decoding them. Frames are found by their time stamps from the key frame before them, so that a frame is the same
    however it was come by. Raises :class:`EndoctError` for a file without pictures, a truncated or a damaged one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._times, self._keys, self._kept = _index(path)
        self.n_frames = len(self._times)
        self._close()

    def __getstate__(self) -> dict[str, Any]:
        names = ("path", "_times", "_keys", "_kept", "n_frames")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._close()

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame."""
        with self._lock:
            try:
                return _samples(self._frame(index))
            except EndoctError:
                self._forget()
                raise
            except Exception as error:  # a decoder may say anything of damaged bytes
                if _is_shortage(error):
                    self._forget()
                    raise
                raise self._unreadable(index, _cause(error)) from error

    def _close(self) -> None:
        self._lock = threading.Lock()
        self._forget()

    def _forget(self) -> None:
        self._recent: OrderedDict[int, av.VideoFrame] = OrderedDict()
        self._ahead: Iterator[av.VideoFrame] | None = None
        self._next = 0

    def _frame(self, index: int) -> "av.VideoFrame":
        if index in self._recent:
            return self._recent[index]
        key = max(int(np.searchsorted(self._keys, index, "right")) - 1, 0)
        first = int(self._keys[key])
        if self._ahead is None or not first <= self._next <= index:
            self._ahead, self._next = _decoded(self.path, int(self._times[first]) if first else None), first
        found = self._walk(index)
        if found is None and first:  # the file's own index led past it
            self._ahead, self._next = _decoded(self.path, None), 0
            found = self._walk(index)
        if found is None:
            raise self._unreadable(index, "no picture where its index has one")
        return found

    def _walk(self, index: int) -> "av.VideoFrame | None":
        """Decode up to frame ``index``; None where it is not met."""
        for frame in self._ahead or ():
            stamp = frame.pts if frame.pts is not None else frame.dts
            at = int(np.searchsorted(self._times, stamp)) if stamp is not None else self.n_frames
            if at == self.n_frames or self._times[at] != stamp or at < self._next:
                continue
            if frame.is_corrupt:
                raise self._unreadable(at, "it is damaged")
            self._next = at + 1
            self._recent[at] = frame
            if len(self._recent) > self._kept:
                self._recent.popitem(last=False)
            if at >= index:
                break
        else:
            self._ahead = None
        return self._recent.get(index)

    def _unreadable(self, index: int, found: str) -> EndoctError:
        self._forget()
        return EndoctError(
            f"frame {index} of {self.path} cannot be decoded", found=found, remedy="copy or export the video again"
        )


def _av() -> Any:
    """Return PyAV, which is loaded when a video is opened and not before."""
    import av

    return av


def _lenient_about_texts() -> dict[str, str]:
    """Return what has PyAV open a video whose texts are not UTF-8; from 19 on it does so by itself."""
    return {} if int(_av().__version__.split(".")[0]) >= 19 else {"metadata_errors": "ignore"}


@contextmanager
def _opened(path: Path) -> "Iterator[av.container.InputContainer]":
    """Open a video with what FFmpeg cannot take for an address, nor use to open anything else."""
    container = _container(path)
    if not container:
        raise EndoctError(f"{path} is no readable video", expected="Matroska, MP4, AVI or QuickTime")
    most_pixels = str(largest_array_bytes() // PIXEL_BYTES)
    with (
        open_regular(path) as file,
        _av().open(
            file,
            "r",
            format=container,
            options={"protocol_whitelist": "none", "max_pixels": most_pixels},
            **_lenient_about_texts(),
            buffer_size=READ_AHEAD_BYTES,
            io_open=_refuse_to_open,
        ) as opened,
    ):
        if not opened.streams.video:
            raise EndoctError(f"{path} holds no pictures", found="a file with sound or data only", expected="a video")
        context = opened.streams.video[0].codec_context
        if context is None:
            raise EndoctError(f"{path} is coded in a way that is not read", remedy="export it as FFV1, H.264 or MJPEG")
        check_array_size((context.height, context.width), PIXEL_BYTES, f"a frame of {path}")
        context.options = {"max_pixels": most_pixels}
        yield opened


def _refuse_to_open(url: str, flags: int, options: object) -> NoReturn:
    raise PermissionError(f"it refers to another file, {url[:80]}, {flags}, {options}")


def _is_shortage(error: Exception) -> bool:
    """Say whether memory ran out; FFmpeg says so too where damaged bytes ask for an absurd amount of it."""
    return isinstance(error, MemoryError) and not isinstance(error, _av().error.FFmpegError)


def _cause(error: Exception) -> str:
    # what FFmpeg says without the number of the error and the name of the file
    return (isinstance(error, _av().error.FFmpegError) and error.strerror) or cause_of(error)


def _index(path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return the time stamps of a video's frames, ascending, which are key frames, and how many to keep decoded."""
    try:
        stamps, last_end, declared, seconds, kept = _walked(path)
    except EndoctError:
        raise
    except Exception as error:  # a demuxer may say anything of damaged bytes
        if _is_shortage(error):
            raise
        raise EndoctError(
            f"{path} is no readable video", found=_cause(error), remedy="copy or export it again"
        ) from error
    if not stamps:
        raise EndoctError(f"{path} holds no frames", found="a video without pictures", remedy="copy or export it again")
    times = np.array(sorted(stamps), np.int64)
    step = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    short = declared > times.size if declared else seconds is not None and last_end + step / 2 < seconds[0]
    if short:
        raise EndoctError(
            f"{path} is truncated",
            found=f"{times.size} frames",
            expected=f"{declared}" if declared or seconds is None else f"{seconds[1]:.2f} s of them",
            remedy="copy or export it again",
        )
    return times, np.flatnonzero([stamps[time] for time in times.tolist()]).astype(np.int64), kept


def _walked(path: Path) -> tuple[dict[int, bool], int, int, tuple[float, float] | None, int]:
    """Go through a video's packets.

    Returns time stamp → key frame?, the end of the last, the frames its header declares (0: none), its duration in
    time stamps and in seconds where it is known, and how many decoded frames may be kept.
    """
    stamps: dict[int, bool] = {}
    last_end = 0
    with _opened(path) as container:
        stream = container.streams.video[0]
        for packet in container.demux(stream):
            stamp = packet.pts if packet.pts is not None else packet.dts
            if not packet.size or stamp is None or packet.is_discard:
                continue
            stamps[stamp] = packet.is_keyframe
            last_end = max(last_end, stamp + (packet.duration or 0))
            if len(stamps) > MOST_FRAMES:
                raise EndoctError(f"{path} has too many frames", expected=f"{MOST_FRAMES} at most")
        alone = len(container.streams) == 1
        seconds = container.duration / _av().time_base if container.duration and alone else None
        unit = float(stream.time_base or 1)
        size = PIXEL_BYTES * stream.codec_context.width * stream.codec_context.height
        kept = min(max(largest_array_bytes() // max(size, 1), 1), RECENT_FRAMES)
        return stamps, last_end, stream.frames, None if seconds is None else (seconds / unit, seconds), kept


def _decoded(path: Path, start: int | None) -> "Iterator[av.VideoFrame]":
    """Yield the frames from the key frame at time stamp ``start`` (None: from the beginning) in the order shown."""
    with _opened(path) as container:
        stream = container.streams.video[0]
        if start is not None:
            container.seek(start, stream=stream)
        yield from container.decode(stream)


def _samples(frame: "av.VideoFrame") -> NDArray[Any]:
    grey = frame.format.name.startswith(("gray", "mono"))
    deep = max(component.bits for component in frame.format.components) > 8
    layout = ("gray16le" if deep else "gray") if grey else ("rgb48le" if deep else "rgb24")
    return np.asarray(frame.to_ndarray(format=layout))
