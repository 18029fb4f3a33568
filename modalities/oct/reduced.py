"""B-scans averaged over the columns of the panorama: all that survey and unrolling need, made as each is read once."""

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.kept_frames import kept_frames
from endoct.modalities.oct.bscan import sector_means
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Image

MOST_COLUMNS = 2048
JUDGED_ASCANS = 64


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedBscan(Frame):
    """A B-scan of which ``samples`` are means over sectors of the turn, (n_columns, depth), in the recording's type.

    Attributes: ``n_ascans`` that were recorded; ``saturated``, whether most samples of the B-scan are.
    """

    n_ascans: int
    saturated: bool

    @property
    def image(self) -> Image:
        """The samples as float32 (n_columns, depth)."""
        return np.ascontiguousarray(self.samples, dtype=np.float32)


def reduced(frame: Frame, n_columns: int) -> ReducedBscan:
    """Return a B-scan as means over ``n_columns``; one that was reduced to as many already is returned as it is."""
    if isinstance(frame, ReducedBscan) and len(frame.samples) == n_columns:
        return frame
    return ReducedBscan(
        index=frame.index,
        samples=sector_means(frame.samples, n_columns),
        z_mm=frame.z_mm,
        n_ascans=ascans_of(frame),
        saturated=_saturated(frame),
    )


def ascans_of(frame: Frame) -> int:
    """Return how many A-scans of a B-scan were recorded."""
    return frame.n_ascans if isinstance(frame, ReducedBscan) else len(frame.samples)


def columns_of(frame: Frame, parameters: OctParameters) -> int:
    """Return how many columns a panorama of B-scans as ``frame`` has."""
    return min(parameters.n_theta or MOST_COLUMNS, ascans_of(frame))


def reduced_pullback(stream: FrameStream, parameters: OctParameters) -> AbstractContextManager[FrameStream]:
    """Give a stream of the :class:`ReducedBscan` of ``stream``; each is read from there when it is first asked for."""
    return kept_frames(stream, lambda frame: reduced(frame, columns_of(frame, parameters)))


def _saturated(frame: Frame) -> bool:
    """Whether the median of some A-scans is the largest value that samples can have."""
    if isinstance(frame, ReducedBscan):
        return frame.saturated
    if frame.samples.dtype.kind != "u":
        return False
    some = frame.samples[:: max(1, len(frame.samples) // JUDGED_ASCANS)]
    return 2 * int(np.count_nonzero(some == np.iinfo(some.dtype).max)) > some.size
