"""Videos as cameras and their software write them: frames lost, at uneven times, cut without coding them anew."""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import av
import numpy as np

from benchmarks.frame_faults.drawn import PITCH_MM, RATE_HZ, Frames, Truth, drawn, missing, with_sidecar

Write = Callable[[Path, Random], Truth]
_TICKS = 1000
"""Of a second: as Matroska counts."""
_CODECS = {
    "mkv": ("ffv1", "gray"),
    "mp4": ("libx264", "yuv420p"),
    "mov": ("libx264", "yuv420p"),
    "avi": ("ffv1", "gray"),
}


def _scene(rng: Random) -> Truth:
    """Return frames smooth enough that coding leaves each nearest to itself."""
    truth = drawn(rng, 9, 20)
    blocks = truth.frames[:, ::8, ::8].repeat(8, axis=1).repeat(8, axis=2)
    return Truth(blocks[:, :48, :64], truth.places_mm, "endoscope", exact=False)


def write_video(
    path: Path,
    frames: Frames,
    times_s: Sequence[float],
    *,
    shift_s: float = 0.0,
    group: int = 4,
    empty: Sequence[float] = (),
) -> Path:
    """Write frames at their times; frames before ``shift_s`` are hidden by an edit list; ``empty``: null frames."""
    av.logging.set_level(av.logging.PANIC)
    codec, pixels = _CODECS[path.suffix[1:]]
    with av.open(str(path), "w") as container:
        options: dict[str, str] = {} if codec == "ffv1" else {"crf": "4", "g": str(group), "bf": "0"}
        ticks = RATE_HZ if path.suffix == ".avi" else _TICKS
        stream: Any = container.add_stream(codec, rate=Fraction(int(ticks)), options=options)
        stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], pixels
        stream.thread_count = 1
        stream.codec_context.time_base = Fraction(1, int(ticks))
        packets = []
        for image, time_s in zip(frames, times_s, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray")
            frame.pts, frame.time_base = round(time_s * ticks), Fraction(1, int(ticks))
            packets += stream.encode(frame)
        packets += stream.encode(None)
        for packet in packets:
            packet.pts -= round(shift_s * ticks)
            packet.dts = packet.pts
        for time_s in empty:
            null = av.Packet(b"")
            null.pts = null.dts = round(time_s * ticks)
            null.time_base, null.stream = Fraction(1, int(ticks)), stream
            packets.append(null)
        for packet in sorted(packets, key=lambda one: one.dts):
            container.mux(packet)
    return path


def _even(n: int) -> list[float]:
    return [k / RATE_HZ for k in range(n)]


def _video(change: Callable[[Truth, Random], tuple[Truth, list[float]]], *kinds: str) -> Write:
    def write(folder: Path, rng: Random) -> Truth:
        truth, times = change(_scene(rng), rng)
        write_video(folder / f"r.{rng.choice(kinds)}", truth.frames, times)
        with_sidecar(folder, "endoscope")
        return truth

    return write


def _sound(truth: Truth, _: Random) -> tuple[Truth, list[float]]:
    return truth, _even(len(truth.frames))


def _lost(truth: Truth, rng: Random) -> tuple[Truth, list[float]]:
    kept = missing(rng, len(truth.frames))
    times = [k / RATE_HZ for k in kept]
    return truth.part(kept), times


def _jitter(truth: Truth, rng: Random) -> tuple[Truth, list[float]]:
    return truth, [k / RATE_HZ + rng.uniform(0, 0.003) for k in range(len(truth.frames))]


def _uneven(truth: Truth, rng: Random) -> tuple[Truth, list[float]]:
    """A camera that takes longer for some frames, in the dark."""
    steps = [rng.choice((1.0, 1.0, 1.0, 1.37, 1.6, 2.45)) / RATE_HZ for _ in truth.frames]
    times = np.cumsum([0.0, *steps[:-1]])
    return truth.at(times * RATE_HZ * PITCH_MM), times.tolist()


def _slower(truth: Truth, _: Random) -> tuple[Truth, list[float]]:
    """A rate that falls to a half on the way."""
    n = len(truth.frames)
    times = np.cumsum([0.0, *(1 / RATE_HZ if k < n // 2 else 2 / RATE_HZ for k in range(n - 1))])
    return truth.at(times * RATE_HZ * PITCH_MM), times.tolist()


def _cut(folder: Path, rng: Random) -> Truth:
    """The first frames hidden by an edit list."""
    truth = _scene(rng)
    hidden = rng.randint(1, 6)
    suffix = rng.choice((".mp4", ".mov"))
    write_video(
        folder / f"r{suffix}",
        truth.frames,
        _even(len(truth.frames)),
        shift_s=hidden / RATE_HZ,
        group=rng.choice((4, 99)),
    )
    with_sidecar(folder, "endoscope")
    part = truth.part(slice(hidden, None))
    return part.at(part.places_mm - part.places_mm[0])


def _edited(folder: Path, rng: Random) -> Truth:
    """A piece cut out of the middle by an edit list."""
    truth = _scene(rng)
    n = len(truth.frames)
    path = write_video(folder / "r.mp4", truth.frames, _even(n), group=1)
    first, last = n // 3, n // 3 + rng.randint(1, 3)
    path.write_bytes(with_edits(path.read_bytes(), [(0, first), (last, n - last)]))
    with_sidecar(folder, "endoscope")
    return truth.part([*range(first), *range(last, n)])


def with_edits(data: bytes, runs: Sequence[tuple[int, int]]) -> bytes:
    """Return an MP4 whose edit list shows runs of frames: each the first frame, and how many."""
    at = data.index(b"elst") - 4
    size = int.from_bytes(data[at : at + 4], "big")
    scale_at = data.index(b"mvhd") + 4
    movie_scale = int.from_bytes(data[scale_at + 12 : scale_at + 16], "big")
    media_at = data.index(b"mdhd") + 4
    media_scale = int.from_bytes(data[media_at + 12 : media_at + 16], "big")
    body = b"elst" + bytes(4) + len(runs).to_bytes(4, "big")
    for first, count in runs:
        body += round(count / RATE_HZ * movie_scale).to_bytes(4, "big")
        body += round(first / RATE_HZ * media_scale).to_bytes(4, "big") + b"\0\1\0\0"
    new = (len(body) + 4).to_bytes(4, "big") + body
    longer = len(new) - size
    changed = bytearray(data[:at] + new + data[at + size :])
    for name in (b"edts", b"trak", b"moov"):
        place = data.rindex(name, 0, at) - 4
        length = int.from_bytes(changed[place : place + 4], "big") + longer
        changed[place : place + 4] = length.to_bytes(4, "big")
    return bytes(changed)


def _null(folder: Path, rng: Random) -> Truth:
    """Frames that were dropped, of which the file holds empty ones."""
    truth = _scene(rng)
    kept = missing(rng, len(truth.frames))
    times = [k / RATE_HZ for k in kept]
    gone = [k / RATE_HZ for k in range(len(truth.frames)) if k not in kept]
    write_video(folder / "r.avi", truth.frames[kept], times, empty=gone)
    with_sidecar(folder, "endoscope")
    return truth.part(kept)


def _frozen(folder: Path, rng: Random) -> Truth:
    """One frame written again in place of a lost one."""
    truth = _scene(rng)
    k = rng.randrange(1, len(truth.frames))
    frames = truth.frames.copy()
    frames[k] = frames[k - 1]
    write_video(folder / "r.mkv", frames, _even(len(frames)))
    with_sidecar(folder, "endoscope")
    return Truth(truth.frames, truth.places_mm, "endoscope")


def _other_rate(folder: Path, rng: Random) -> Truth:
    """A video at another rate than the sidecar says; the rate of the video is right."""
    truth = _scene(rng)
    factor = rng.choice((0.5, 0.8, 1.2, 2.0))
    write_video(folder / "r.mkv", truth.frames, [time * factor for time in _even(len(truth.frames))])
    with_sidecar(folder, "endoscope")
    return truth.at(truth.places_mm * factor)


VIDEOS: Mapping[str, Write] = {
    "video, sound": _video(_sound, "mkv", "mp4", "mov", "avi"),
    "video, lost frames": _video(_lost, "mkv", "mp4", "mov", "avi"),
    "video, jitter": _video(_jitter, "mkv", "mp4"),
    "video, variable rate": _video(_uneven, "mkv", "mp4", "mov"),
    "video, slower on the way": _video(_slower, "mkv", "mp4"),
    "video, cut": _cut,
    "video, cut inside": _edited,
    "video, null frames": _null,
    "video, frozen": _frozen,
    "video, other rate": _other_rate,
}
