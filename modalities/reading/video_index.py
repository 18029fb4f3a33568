"""Which frames a video file has, and when each was taken: by its packets, without decoding them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import largest_array_bytes
from endoct.modalities.reading.remarks import NONE, Remarks, doubted
from endoct.modalities.reading.video_container import (
    PIXEL_BYTES,
    FilePart,
    Source,
    cause_of_video,
    container_of,
    has_edits,
    is_cut_off,
    is_shortage,
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
_WOVEN = (
    "The video says that its frames are interlaced: every other row was taken half a frame later. What moves has "
    "combs; the feed is less certain. Have the recorder write whole frames (progressive)."
)
INTERLACED = doubted("frames-interlaced", _WOVEN)
PROGRESSIVE = 1
"""FFmpeg counts orders of fields from here on; 0 is one that is not known."""


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
            check_order(path)
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
    remarks += on_edits + (INTERLACED if walk.interlaced else NONE)
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
    return doubted("video-shorter-than-stated", what, float(n))


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
    taken = np.array([when.get(place, np.nan) for place in places], np.float64)
    if not (np.diff(taken, prepend=-np.inf) > 0).all():
        what = (
            "The video's edit list shows frames in another order than they were recorded in, or at times that are not "
            "known: they were placed as they are shown."
        )
        return displayed, remarks + doubted("video-edited", what)
    return taken, remarks


def decoded(path: Source, start: int | None) -> "Iterator[av.VideoFrame]":
    """Yield the frames from the key frame at time stamp ``start`` (None: from the beginning) in the order shown."""
    with opened_video(path) as container:
        stream = pictures_of(container)
        if start is not None:
            container.seek(start, stream=stream)
        yield from container.decode(stream)


def check_order(path: Source) -> None:
    """Raise :class:`EndoctError` where pictures come in another order than that of their time stamps."""
    shown = [frame.pts for frame in islice(decoded(path, None), LOOKED_AT) if frame.pts is not None]
    if shown != sorted(shown):
        raise EndoctError(
            f"the frames of {path} have no times at which they are shown",
            found="time stamps in the order of decoding, as B-frames have in AVI",
            remedy="convert it: ffmpeg -i IN -c:v ffv1 OUT.mkv",
        )
