"""Frames without what is not looked at: of a colour frame, its green is all that survey and unrolling need."""

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.light import full_scale, green
from endoct.modalities.kept_frames import kept_frames


@dataclass(frozen=True, eq=False, kw_only=True)
class GreenFrame(Frame):
    """A frame of which ``samples`` are the green ones, (row, column), and ``full_scale`` is that of all colours."""

    full_scale: float


def green_frames(stream: FrameStream) -> AbstractContextManager[FrameStream]:
    """Give a stream of the green of every frame of ``stream``, each read from there once."""
    return kept_frames(stream, _green_frame)


def full_scale_of(frame: Frame) -> float:
    """Return the value of a saturated sample of a frame, by :func:`full_scale` of all its colours."""
    return frame.full_scale if isinstance(frame, GreenFrame) else full_scale(frame.samples)


def _green_frame(frame: Frame) -> GreenFrame:
    samples = np.ascontiguousarray(green(frame.samples)).view()
    samples.flags.writeable = False
    return GreenFrame(index=frame.index, samples=samples, z_mm=frame.z_mm, full_scale=full_scale(frame.samples))
