"""Frames of a video file by their index: Matroska, WebM, MP4, AVI or QuickTime, decoded exactly, one at a time."""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.numbering import Along, spacing_of
from endoct.modalities.reading.orientation import UPRIGHT, on_orientation, upright
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.reading.video_container import VIDEO_SUFFIXES, Source, cause_of_video, container_of, is_shortage
from endoct.modalities.reading.video_index import INTERLACED, check_order, decoded, index_of

if TYPE_CHECKING:
    import av

STAMP_JITTER = 0.1
"""Time stamps of a video jitter by this share of the usual step. Where they do by more, frames were taken at uneven
times."""
SHORTEST_STEP_S, LONGEST_STEP_S = 1e-5, 100.0
"""Frames of a camera lie between these apart; a file whose time stamps lie otherwise states no rate."""
_OF_A_PROCESS = ("_lock", "_recent", "_ahead", "_next")
_ORIENTATIONS = {
    (-1, 0, 0, 1): 2, (-1, 0, 0, -1): 3, (1, 0, 0, -1): 4, (0, 1, 1, 0): 5, (0, 1, -1, 0): 6, (0, -1, -1, 0): 7,
    (0, -1, 1, 0): 8,
}  # fmt: skip
"""The orientation follows from the signs of x' = a·x + c·y, y' = b·x + d·y, as (a, b, c, d); y runs down."""


class ReadVideo:
    """Reads one frame of a video; picklable, and safe to share among threads.

    Calling it with an index, counted in the order shown, gives (row, column) or (row, column, RGB). Samples are u8, or
    u16 where the video has more than 8 bits. Frames are upright, as the file has them displayed. Each is found by its
    time stamp from the key frame before it, so that it is the same whichever was read before.

    ``n_frames`` are counted by going once through the file's packets, without decoding them. ``times_s``: the time
    stamp of every frame, float64 (n_frames,), ascending. A process forked after the first frame must not use this
    object, but unpickle its own. Raises :class:`EndoctError` for a file without pictures, a truncated or a damaged one.
    """

    def __init__(self, path: Source) -> None:
        self.path, self._index = path, index_of(path)
        self.n_frames, self.times_s = len(self._index.times), self._index.times_s
        self.pixel_aspect = self._index.pixel_aspect
        self._orientation, self._interlaced = UPRIGHT, False
        self._close()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _OF_A_PROCESS}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._close()

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame."""
        with self._lock:
            try:
                frame = self._frame(index)
                self._orientation = _orientation(frame)
                self._interlaced |= frame.interlaced_frame
                return upright(_samples(frame), self._orientation)
            except EndoctError:
                self._forget()
                raise
            except Exception as error:  # a decoder may say anything of damaged bytes
                if is_shortage(error):
                    self._forget()
                    raise
                raise self._unreadable(index, cause_of_video(error)) from error

    @property
    def remarks(self) -> Remarks:
        """What is to be said of the file, and of the frames once one was read."""
        return self._index.remarks + on_orientation(self._orientation) + (INTERLACED if self._interlaced else NONE)

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
        key = max(int(np.searchsorted(self._index.keys, index, "right")) - 1, 0)
        first = (
            int(self._index.keys[key]) if self._index.keys.size and self._index.keys[0] <= index else 0
        )  # the key frame may be hidden
        if self._ahead is None or not first <= self._next <= index:
            self._ahead, self._next = decoded(self.path, int(self._index.times[first]) if first else None), first
        found = self._walk(index)
        if found is None and first:  # the file's own index led past it
            self._ahead, self._next = decoded(self.path, None), 0
            found = self._walk(index)
        if found is None:
            check_order(self.path)
            raise self._unreadable(index, "no picture where its index has one")
        return found

    def _walk(self, index: int) -> "av.VideoFrame | None":
        """Decode up to frame ``index``; None where it is not met."""
        for frame in self._ahead or ():
            stamp = frame.pts if frame.pts is not None else frame.dts
            at = int(np.searchsorted(self._index.times, stamp)) if stamp is not None else self.n_frames
            if at == self.n_frames or self._index.times[at] != stamp or at < self._next:
                continue
            if frame.is_corrupt:
                raise self._unreadable(at, "it is damaged")
            self._next = at + 1
            self._recent[at] = frame
            if len(self._recent) > self._index.kept:
                self._recent.popitem(last=False)
            if at >= index:
                break
        else:
            self._ahead = None
        return self._recent.get(index)

    def _unreadable(self, index: int, reason: str) -> EndoctError:
        self._forget()
        return EndoctError(
            f"frame {index} of {self.path} cannot be decoded", found=reason, remedy="copy or export the video again"
        )


def _orientation(frame: "av.VideoFrame") -> int:
    """Return how a frame is stored, as images count it, by the matrix that a file has it displayed with."""
    for data in cast(Any, frame.side_data):
        if data.type.name == "DISPLAYMATRIX":
            a, b, _, c, d = np.sign(np.frombuffer(bytes(data), "<i4", 5)).tolist()
            return _ORIENTATIONS.get((a, b, c, d), UPRIGHT)
    return UPRIGHT


def _samples(frame: "av.VideoFrame") -> NDArray[Any]:
    grey = frame.format.name.startswith(("gray", "mono"))
    deep = max(component.bits for component in frame.format.components) > 8
    layout = ("gray16le" if deep else "gray") if grey else ("rgb48le" if deep else "rgb24")
    return np.asarray(frame.to_ndarray(format=layout))


def _open_video(files: Files) -> Frames:
    read = ReadVideo(files[0])
    along = Along(read.times_s, "s", "the time stamps of the video", within=STAMP_JITTER)
    return Frames(read.n_frames, read, along)


def _states_of_video(files: Files) -> Stated:
    step_s = spacing_of(index_of(files[0]).times_s, within=STAMP_JITTER).usual
    if not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S:
        return Stated()
    return Stated({"frame_rate_hz": float(f"{1 / step_s:.6g}")}, f"the time stamps of {files[0].name}")


VIDEO = Format(
    "video",
    lambda path: bool(container_of(path)) or path.suffix.lower() in VIDEO_SUFFIXES,
    _open_video,
    _states_of_video,
)
