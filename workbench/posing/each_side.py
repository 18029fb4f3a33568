"""What is done for each side of a pose by itself: for the first one here, for the second in another process meanwhile.

A search and a fit are many steps on small arrays, at which threads of one process wait for one another.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import torch

from endoct.fusion.evidence.side import Side
from endoct.fusion.pose.air import AirAround
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.running.threads import one_blas_thread

Out = TypeVar("Out")


class EachSide:
    """The sides of a pose in one CT; ``process`` takes the second one, where it is not None."""

    def __init__(self, air: AirAround, sides: Sequence[Side], process: WorkerProcess | None) -> None:
        self._air, self._process, self._here = air, process, sides if process is None else sides[:1]
        self._there = []
        if process is not None:
            air_there = process.store(air)
            self._there = [(air_there, process.store(side)) for side in sides[1:]]

    def map(self, function: Callable[..., Out], *more: object) -> list[Out]:
        """Return ``function(air, side, *more)`` of every side, the same with and without another process."""
        there = [] if self._process is None else [self._process.call(function, *of, *more) for of in self._there]
        return [*(function(self._air, side, *more) for side in self._here), *(one.result() for one in there)]


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS and torch to one thread, as a context or a decorator: the order of sums is that of any machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with one_blas_thread():
            yield
    finally:
        torch.set_num_threads(before)
