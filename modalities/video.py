"""Frames of a video file by their index: Matroska, MP4, AVI or QuickTime, decoded exactly, one at a time."""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError

if TYPE_CHECKING:
    import av

VIDEO_SUFFIXES = (".mkv", ".mp4", ".avi", ".mov")
RECENT_FRAMES = 8
"""Decoded frames kept, because threads ask for neighbours in any order."""
QUICKTIME_ATOMS = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")


def is_video(path: Path) -> bool:
    """Say whether the file starts as a Matroska, MP4, QuickTime or AVI file does."""
    try:
        with path.open("rb") as file:
            start = file.read(12)
    except OSError:
        return False
    riff = start[:4] == b"RIFF" and start[8:12] == b"AVI "
    return start[:4] == b"\x1a\x45\xdf\xa3" or riff or start[4:8] in QUICKTIME_ATOMS


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
        self._times, self._keys = _index(path)
        self.n_frames = len(self._times)
        self._close()

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "_times": self._times, "_keys": self._keys, "n_frames": self.n_frames}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._close()

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame."""
        with self._lock:
            try:
                return _samples(self._frame(index))
            except _av().error.FFmpegError as error:
                raise self._unreadable(index, error.strerror or str(error)) from error

    def _close(self) -> None:
        self._lock = threading.Lock()
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
            if len(self._recent) > RECENT_FRAMES:
                self._recent.popitem(last=False)
            if at >= index:
                break
        else:
            self._ahead = None
        return self._recent.get(index)

    def _unreadable(self, index: int, found: str) -> EndoctError:
        self._close()
        return EndoctError(
            f"frame {index} of {self.path} cannot be decoded", found=found, remedy="copy or export the video again"
        )


def _av() -> Any:
    """Return PyAV, which is loaded when a video is opened and not before."""
    import av

    return av


def _opened(path: Path) -> "av.container.InputContainer":
    container: av.container.InputContainer = _av().open(str(path), metadata_errors="ignore")
    if not container.streams.video:
        container.close()
        raise EndoctError(f"{path} holds no pictures", found="a file with sound or data only", expected="a video")
    return container


def _index(path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the time stamps of a video's frames, ascending, and which of them are key frames."""
    if not is_video(path):
        raise EndoctError(f"{path} is no readable video", expected="Matroska, MP4, AVI or QuickTime")
    av = _av()
    stamps: dict[int, bool] = {}
    ends = [0]
    try:
        with _opened(path) as container:
            stream = container.streams.video[0]
            for packet in container.demux(stream):
                stamp = packet.pts if packet.pts is not None else packet.dts
                if not packet.size or stamp is None or packet.is_discard:
                    continue
                stamps[stamp] = packet.is_keyframe
                ends.append(stamp + (packet.duration or 0))
            declared = stream.frames
            alone = len(container.streams) == 1
            seconds = container.duration / av.time_base if container.duration and alone else None
            unit = float(stream.time_base or 1)
    except av.error.FFmpegError as error:
        raise EndoctError(
            f"{path} is no readable video", found=error.strerror or str(error), remedy="copy or export it again"
        ) from error
    if not stamps:
        raise EndoctError(f"{path} holds no frames", found="a video without pictures", remedy="copy or export it again")
    times = np.array(sorted(stamps), np.int64)
    step = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    short = declared > times.size if declared else seconds is not None and max(ends) + step / 2 < seconds / unit
    if short:
        raise EndoctError(
            f"{path} is truncated",
            found=f"{times.size} frames",
            expected=f"{declared}" if declared else f"{seconds:.2f} s of them",
            remedy="copy or export it again",
        )
    return times, np.flatnonzero([stamps[time] for time in times.tolist()]).astype(np.int64)


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
