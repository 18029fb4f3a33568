"""Frames without what is not looked at: of a colour frame, its green is all that survey and unrolling need."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.light import full_scale, green
from endoct.modalities.kept_frames import kept_frames


@dataclass(frozen=True, eq=False, kw_only=True)
class GreenFrame(Frame):
    """A frame of which ``samples`` are the green ones, (row, column), and ``full_scale`` is that of all colours."""

    full_scale: float


def green_frames(stream: FrameStream) -> AbstractContextManager[FrameStream]:
    """Give a stream of the green of every frame of ``stream``, each read from there once."""
    return kept_frames(_InGreen(stream, stream.green) if isinstance(stream, _ReadsGreen) else stream, _green_frame)


def full_scale_of(frame: Frame) -> float:
    """Return the value of a saturated sample of a frame, by :func:`full_scale` of all its colours."""
    return frame.full_scale if isinstance(frame, GreenFrame) else full_scale(frame.samples)


@runtime_checkable
class _ReadsGreen(Protocol):
    """What may read of a frame the green alone."""

    def green(self, index: int) -> Frame | None: ...


class _InGreen:
    """A stream of frames in green where ``green`` reads that alone, else of whole ones."""

    def __init__(self, stream: FrameStream, green: Callable[[int], Frame | None]) -> None:
        self._stream, self._green = stream, green

    @property
    def acquisition(self) -> Acquisition:
        return self._stream.acquisition

    def __len__(self) -> int:
        return len(self._stream)

    def __getitem__(self, index: int) -> Frame:
        return self._green(index) or self._stream[index]


def _green_frame(frame: Frame) -> GreenFrame:
    samples = np.ascontiguousarray(green(frame.samples)).view()
    samples.flags.writeable = False
    return GreenFrame(index=frame.index, samples=samples, z_mm=frame.z_mm, full_scale=full_scale(frame.samples))
