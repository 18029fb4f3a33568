"""Frames of a video file by their index: Matroska, WebM, MP4, AVI or QuickTime, decoded exactly, one at a time.

Which frames there are, and when each was taken, is known from the file's packets, without decoding them.
"""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import largest_array_bytes
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.numbering import Along, spacing_of
from endoct.modalities.reading.orientation import UPRIGHT, on_orientation, upright
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.reading.video_container import (
    PIXEL_BYTES,
    VIDEO_SUFFIXES,
    FilePart,
    Source,
    cause_of_video,
    container_of,
    has_edits,
    is_cut_off,
    is_shortage,
    is_video,
    load_av,
    opened_video,
    pictures_of,
)

if TYPE_CHECKING:
    import av

LOOKED_AT = 64
"""B-frames are among so many."""
RECENT_FRAMES = 8
"""So many decoded frames are kept, since threads ask for neighbours in any order; fewer where frames are very large."""
MOST_FRAMES = 1_000_000
STAMP_JITTER = 0.1
"""Time stamps of a video jitter by this share of the usual step. Where they do by more, frames were taken at uneven
times."""
SHORTEST_STEP_S, LONGEST_STEP_S = 1e-5, 100.0
"""Frames of a camera lie between these apart; a file whose time stamps lie otherwise states no rate."""
_WOVEN = (
    "The video says that its frames are interlaced: every other row was taken half a frame later. What moves has "
    "combs; the feed is less certain. Have the recorder write whole frames (progressive)."
)
_INTERLACED = Remarks(doubts=(Doubt("frames-interlaced", _WOVEN),))
PROGRESSIVE = 1
"""FFmpeg counts orders of fields from here on; 0 is one that is not known."""
_OF_A_PROCESS = ("_lock", "_recent", "_ahead", "_next")
_ORIENTATIONS = {
    (-1, 0, 0, 1): 2, (-1, 0, 0, -1): 3, (1, 0, 0, -1): 4, (0, 1, 1, 0): 5, (0, 1, -1, 0): 6, (0, -1, -1, 0): 7,
    (0, -1, 1, 0): 8,
}  # fmt: skip
"""The orientation follows from the signs of x' = a·x + c·y, y' = b·x + d·y, as (a, b, c, d); y runs down."""


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """``times``: the stamps by which frames are found, int64 (n,), ascending; ``keys``: which are key frames.

    ``kept``: how many decoded frames may be kept; ``times_s``: when each was taken, float64 (n,); ``pixel_aspect``: how
    many times as wide as high a pixel is.
    """

    times: NDArray[np.int64]
    keys: NDArray[np.int64]
    kept: int
    times_s: Coordinates
    remarks: Remarks
    pixel_aspect: float


@dataclass
class _Walk:
    """What going through a video's packets showed.

    ``stamps``: time stamp → key frame?, and place in the file; ``others``: packets that are not shown, or empty.
    """

    stamps: dict[int, tuple[bool, int]] = field(default_factory=dict)
    others: int = 0
    empty: int = 0
    together: int = 0
    last_end: int = 0
    declared: int = 0
    seconds: float | None = None
    unit: float = 1.0
    kept: int = 1
    pixel_aspect: float = 1.0
    interlaced: bool = False
    reordered: bool = False


def index_of(path: Source) -> VideoIndex:
    """Return the frames of a video.

    Kept of the last files, as long as they do not change. Raises :class:`EndoctError` where there are none, the file
    was cut off, or time stamps do not tell frames apart.
    """
    with refusing(f"{path} is no readable video"):
        now = (path.path if isinstance(path, FilePart) else path).stat()
    return _index_of(path, now.st_size, now.st_mtime_ns)


@lru_cache(maxsize=4)
def _index_of(path: Source, size: int, changed_ns: int) -> VideoIndex:  # noqa: ARG001 – by which a file is the same
    try:
        walk = _walked(path)
        unedited = _walked(path, edited=False) if _may_be_edited(path, walk) else None
        cut_off = is_cut_off(path)
        if walk.reordered and container_of(path) == "avi":
            _check_order(path)
    except EndoctError:
        raise
    except Exception as error:  # a demuxer may say anything of damaged bytes
        if is_shortage(error):
            raise
        raise EndoctError(
            f"{path} is no readable video", found=cause_of_video(error), remedy="copy or export it again"
        ) from error
    if not walk.stamps:
        raise EndoctError(f"{path} holds no frames", found="a video without pictures", remedy="copy or export it again")
    if walk.together:
        raise EndoctError(
            f"the frames of {path} cannot be told apart",
            found=f"{walk.together} of {walk.together + len(walk.stamps)} with the time stamp of another",
            expected="a time stamp for each",
            remedy="convert it: ffmpeg -i IN -c:v ffv1 OUT.mkv",
        )
    times = np.array(sorted(walk.stamps), np.int64)
    keys = np.flatnonzero([walk.stamps[time][0] for time in times.tolist()]).astype(np.int64)
    remarks = _on_end(path, walk, unedited, cut_off)
    taken, on_edits = _taken(times, walk, unedited)
    remarks += on_edits + (_INTERLACED if walk.interlaced else NONE)
    return VideoIndex(times, keys, walk.kept, taken * walk.unit, remarks, walk.pixel_aspect)


def _may_be_edited(path: Source, walk: _Walk) -> bool:
    """Say whether a file may hold frames that are not shown, or show them in another order or at other times."""
    if container_of(path) != "mov":
        return False
    return walk.others > walk.empty or walk.declared > len(walk.stamps) + walk.others or has_edits(path)


def _walked(path: Source, *, edited: bool = True) -> _Walk:
    """Go through a video's packets, as its edit list has them, or as they were recorded."""
    walk = _Walk()
    with opened_video(path, edited=edited) as container:
        stream = pictures_of(container)
        for packet in container.demux(stream):
            stamp = packet.pts if packet.pts is not None else packet.dts
            if stamp is None:
                continue
            if not packet.size or packet.is_discard:
                walk.others += 1
                walk.empty += not packet.size
                continue
            walk.together += stamp in walk.stamps
            walk.stamps[stamp] = packet.is_keyframe, packet.pos if packet.pos is not None else -1
            walk.last_end = max(walk.last_end, stamp + (packet.duration or 0))
            if len(walk.stamps) > MOST_FRAMES:
                raise EndoctError(f"{path} has too many frames", expected=f"{MOST_FRAMES} at most")
        alone = len(container.streams) == 1
        walk.seconds = container.duration / load_av().time_base if container.duration and alone else None
        walk.unit = float(stream.time_base or 1)
        walk.declared = stream.frames
        walk.pixel_aspect = float(stream.sample_aspect_ratio or 1)
        walk.reordered = bool(stream.codec_context.has_b_frames)
        walk.interlaced = getattr(stream.codec_context, "field_order", 0) > PROGRESSIVE
        size = PIXEL_BYTES * stream.codec_context.width * stream.codec_context.height
        walk.kept = min(max(largest_array_bytes() // max(size, 1), 1), RECENT_FRAMES)
    return walk


def _on_end(path: Source, walk: _Walk, unedited: _Walk | None, cut_off: bool | None) -> Remarks:
    """Return a doubt where a whole file has fewer frames than it states. Raises where it was cut off."""
    n = len(walk.stamps)
    held = n + walk.others if unedited is None else max(n, len(unedited.stamps)) + max(walk.empty, unedited.others)
    times = sorted(walk.stamps)
    step = float(np.median(np.diff(times))) if n > 1 else 0.0
    stated_end = None if walk.seconds is None else walk.seconds / walk.unit
    ends_early = stated_end is not None and walk.last_end + step / 2 < stated_end
    if container_of(path) == "avi":  # it counts frames that were dropped, and time stamps count them too
        held = max(held, times[-1] + 1)
    if not (walk.declared > held if walk.declared else ends_early):
        return NONE
    stated = f"{walk.declared}" if walk.declared or walk.seconds is None else f"{walk.seconds:.2f} s of them"
    if cut_off is not False:
        raise EndoctError(
            f"{path} is truncated", found=f"{n} frames", expected=stated, remedy="copy or export it again"
        )
    what = f"The video's header states {stated}{' frames' if walk.declared else ''}; the file is whole and holds {n}."
    return Remarks(doubts=(Doubt("video-shorter-than-stated", what, value=float(n), unit="1"),))


def _taken(times: NDArray[np.int64], walk: _Walk, unedited: _Walk | None) -> tuple[Coordinates, Remarks]:
    """Return when each frame was taken, in time stamps: before an edit list cut the video."""
    displayed = times.astype(np.float64)
    if unedited is None:
        return displayed, NONE
    when = {place: stamp for stamp, (_, place) in unedited.stamps.items() if place >= 0}
    places = [walk.stamps[time][1] for time in times.tolist()]
    hidden = len(unedited.stamps) - len(times)
    remarks = NONE
    if hidden > 0:
        note = f"By its edit list the video shows {len(times)} of {len(unedited.stamps)} frames that it holds."
        remarks = Remarks(notes=(note,))
    if not all(place in when for place in places) or len(when) < len(unedited.stamps):
        what = "When the frames of an edited video were taken is not known: they were placed as they are shown."
        return displayed, remarks + Remarks(doubts=(Doubt("video-edited", what),))
    taken = np.array([when[place] for place in places], np.float64)
    if (np.diff(taken) <= 0).any():
        what = "The video's edit list shows frames in another order than they were recorded in; that order was taken."
        return displayed, remarks + Remarks(doubts=(Doubt("video-edited", what),))
    return taken, remarks


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
        self.path = path
        found = index_of(path)
        self._times, self._keys, self._kept = found.times, found.keys, found.kept
        self.times_s = found.times_s
        self._remarks = found.remarks
        self._orientation, self._interlaced, self.pixel_aspect = UPRIGHT, False, found.pixel_aspect
        self.n_frames = len(self._times)
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
        return self._remarks + on_orientation(self._orientation) + (_INTERLACED if self._interlaced else NONE)

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
        first = int(self._keys[key]) if self._keys.size and self._keys[0] <= index else 0  # the key frame may be hidden
        if self._ahead is None or not first <= self._next <= index:
            self._ahead, self._next = _decoded(self.path, int(self._times[first]) if first else None), first
        found = self._walk(index)
        if found is None and first:  # the file's own index led past it
            self._ahead, self._next = _decoded(self.path, None), 0
            found = self._walk(index)
        if found is None:
            _check_order(self.path)
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

    def _unreadable(self, index: int, reason: str) -> EndoctError:
        self._forget()
        return EndoctError(
            f"frame {index} of {self.path} cannot be decoded", found=reason, remedy="copy or export the video again"
        )


def _decoded(path: Source, start: int | None) -> "Iterator[av.VideoFrame]":
    """Yield the frames from the key frame at time stamp ``start`` (None: from the beginning) in the order shown."""
    with opened_video(path) as container:
        stream = pictures_of(container)
        if start is not None:
            container.seek(start, stream=stream)
        yield from container.decode(stream)


def _check_order(path: Source) -> None:
    """Raise :class:`EndoctError` where pictures come in another order than that of their time stamps."""
    shown = [frame.pts for frame in islice(_decoded(path, None), LOOKED_AT) if frame.pts is not None]
    if shown != sorted(shown):
        raise EndoctError(
            f"the frames of {path} have no times at which they are shown",
            found="time stamps in the order of decoding, as B-frames have in AVI",
            remedy="convert it: ffmpeg -i IN -c:v ffv1 OUT.mkv",
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


def _claims_video(path: Path) -> bool:
    return is_video(path) or path.suffix.lower() in VIDEO_SUFFIXES


def _states_of_video(files: Files) -> Stated:
    step_s = spacing_of(index_of(files[0]).times_s, within=STAMP_JITTER).usual
    if not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S:
        return Stated()
    return Stated({"frame_rate_hz": float(f"{1 / step_s:.6g}")}, f"the time stamps of {files[0].name}")


VIDEO = Format("video", _claims_video, _open_video, _states_of_video)
