"""One drawn recording, given to the plug-in that reads it: what becomes of it."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.frame_faults.drawn import Truth
from benchmarks.frame_faults.folders import FAULTS, SOUND
from benchmarks.frame_faults.masks import SOUND_MASKS, UNCLEAR_MASKS, cells
from benchmarks.frame_faults.pictures import CODED
from benchmarks.frame_faults.streams import READABLE, STREAMS
from benchmarks.frame_faults.videos import VIDEOS
from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import read_drawing
from endoct.modalities.reading.remarks import remarks_of
from endoct.modalities.recognition import open_recording

PLACE_MM = 0.03
"""What clocks of videos and in names leave uncertain: less than a sixth of a step."""
LOSSY = 12.0
"""Mean difference of samples that coding may leave; those of two frames differ by 85."""
WRITERS: Mapping[str, Callable[[Path, Random], Truth]] = {**SOUND, **FAULTS, **CODED, **VIDEOS, **STREAMS}
MASKS = {**SOUND_MASKS, **UNCLEAR_MASKS}
ALL = (*WRITERS, *MASKS)
MUST_BE_READ = (*SOUND, *SOUND_MASKS, *READABLE)
RIGHT, REFUSED, DOUBTED, BELIEVED = "right", "refused", "doubted", "believed"


@dataclass(frozen=True)
class Trial:
    """``end``: right, where every frame has its samples and its place; refused; doubted by name; or believed."""

    fault: str
    number: int
    end: str
    said: str


def tried(fault: str, number: int, seed: int, scratch: Path) -> Trial:
    """Write a recording with a fault, or a sound one, into ``scratch``, read it, and say what became of it."""
    rng = Random(f"{seed} {fault} {number}")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    try:
        if fault in MASKS:
            path = MASKS[fault](scratch / "mask", drawn := cells(rng), rng)
            right = np.array_equal(read_drawing(path, drawn.shape), drawn)
            return Trial(fault, number, RIGHT if right else BELIEVED, path.name)
        truth = WRITERS[fault](scratch, rng)
        _, stream = open_recording(scratch)
        frames = [stream[k].samples for k in range(len(stream))]
        places = np.array([stream[k].z_mm for k in range(len(stream))])
        remarks = remarks_of(stream)
    except EndoctError as error:
        return Trial(fault, number, REFUSED, str(error))
    names = ", ".join(sorted(path.name for path in scratch.iterdir())[:6])
    said = "; ".join([*(doubt.what for doubt in remarks.doubts), *remarks.notes])
    told = not truth.doubted or truth.doubted in {doubt.code for doubt in remarks.doubts}
    if told and _is_right(frames, places, truth):
        return Trial(fault, number, DOUBTED if remarks.doubts else RIGHT, said)
    return Trial(fault, number, DOUBTED if remarks.doubts else BELIEVED, f"{said} [{names}]")


def _is_right(frames: list[np.ndarray], places: np.ndarray, truth: Truth) -> bool:
    """Whether all frames are those that were drawn, in their order, at their places."""
    if len(frames) != len(truth.frames) or np.abs(places - truth.places_mm).max() > PLACE_MM:
        return False
    for frame, drawn in zip(frames, truth.frames, strict=True):
        one_plane = frame.ndim == 3 and drawn.ndim == 2
        seen = (frame.T if truth.kind == "oct" else frame[..., 0] if one_plane else frame).astype(float)
        if seen.shape != drawn.shape or np.abs(seen - drawn).mean() > (0 if truth.exact else LOSSY):
            return False
    return True
