"""B-scans averaged over the columns of the panorama: all that survey and unrolling need, made as each is read once."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock

import numpy as np

from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.oct.bscan import sector_means
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Image
from endoct.stitching.kept import Kept

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


@contextmanager
def reduced_pullback(stream: FrameStream, parameters: OctParameters) -> Iterator[FrameStream]:
    """Give a stream of the :class:`ReducedBscan` of ``stream``; each is read from there when it is first asked for.

    On leaving, what was kept is forgotten.
    """
    with Kept[ReducedBscan]() as kept:
        yield _ReducedPullback(stream, columns_of(stream[0], parameters), kept)


class _ReducedPullback:
    """A stream that reduces every B-scan once, in whichever thread comes first."""

    def __init__(self, stream: FrameStream, n_columns: int, kept: Kept[ReducedBscan]) -> None:
        self._stream, self._n_columns, self._kept = stream, n_columns, kept
        self._places: dict[int, int] = {}
        self._lock = Lock()

    @property
    def acquisition(self) -> Acquisition:
        return self._stream.acquisition

    def __len__(self) -> int:
        return len(self._stream)

    def __getitem__(self, index: int) -> ReducedBscan:
        place = self._places.get(index)
        if place is not None:
            return self._kept[place]
        bscan = reduced(self._stream[index], self._n_columns)
        with self._lock:
            self._places[index] = len(self._kept)
            self._kept.append(bscan)
        return bscan


def _saturated(frame: Frame) -> bool:
    """Whether the median of some A-scans is the largest value that samples can have."""
    if isinstance(frame, ReducedBscan):
        return frame.saturated
    if frame.samples.dtype.kind != "u":
        return False
    some = frame.samples[:: max(1, len(frame.samples) // JUDGED_ASCANS)]
    return 2 * int(np.count_nonzero(some == np.iinfo(some.dtype).max)) > some.size
