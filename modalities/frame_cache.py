"""A recording of which each frame is read once: what survey and unrolling need of it is kept meanwhile."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Generic, TypeVar

from endoct.base.compute.memory import Kept
from endoct.modalities.contract import Frame, FrameStream, StreamOver

F = TypeVar("F", bound=Frame)


@contextmanager
def kept_frames(stream: FrameStream, needed: Callable[[Frame], F]) -> Iterator[FrameStream]:
    """Give a stream of what is ``needed`` of the frames of ``stream``; each is read when it is first asked for.

    On leaving, what was kept is forgotten.
    """
    with Kept[F]() as kept:
        yield _KeptFrames[F](stream, needed, kept)


class _KeptFrames(StreamOver, Generic[F]):
    """A stream that reads every frame once, in whichever thread comes first."""

    def __init__(self, stream: FrameStream, needed: Callable[[Frame], F], kept: Kept[F]) -> None:
        self.stream, self._needed, self._kept = stream, needed, kept
        self._places: dict[int, int] = {}
        self._lock = Lock()

    def __getitem__(self, index: int) -> F:
        place = self._places.get(index)
        if place is not None:
            return self._kept[place]
        frame = self._needed(self.stream[index])
        with self._lock:
            self._places[index] = len(self._kept)
            self._kept.append(frame)
        return frame
