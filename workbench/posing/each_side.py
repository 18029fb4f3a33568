"""What is done for each side of a pose by itself: for the first one here, for the second in another process meanwhile.

A search and a fit are many steps on small arrays, at which threads of one process wait for one another.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import torch

from endoct.base.compute.worker_process import WorkerProcess
from endoct.fusion.evidence.side import Side
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.pose.air import AirAround
from endoct.fusion.segmentation.segmented_side import SegmentedSide, segment_side
from endoct.workbench.running.second_process import one_blas_thread

ROWS_MM, COLUMNS = 0.05, 1024
"""Of a side's comparison with the CT: far finer than a CT."""
PARAMETERS = CompareParameters(dz_mm=ROWS_MM, n_theta=COLUMNS, polarity="dark")

Out = TypeVar("Out")


@dataclass(frozen=True, eq=False)
class OneSide:
    """A side, and the air around the plan that it is looked for in."""

    air: AirAround
    side: Side

    @cached_property
    def segmented(self) -> SegmentedSide:
        """The side with its cells, found when they are first read, and kept."""
        return segment_side(self.side, PARAMETERS, "dark")


class EachSide:
    """The sides of a pose; ``process`` takes the second one, where it is not None."""

    def __init__(self, air: AirAround, sides: Sequence[Side], process: WorkerProcess | None) -> None:
        given = [OneSide(air, side) for side in sides]
        self._process = process
        self._here, there = (given, []) if process is None else (given[:1], given[1:])
        self._there = [] if process is None else [process.store(one) for one in there]

    def map(self, function: Callable[..., Out], *more: object) -> list[Out]:
        """Return ``function(one, *more)`` of every :class:`OneSide`, the same with and without another process."""
        there = [] if self._process is None else [self._process.call(function, one, *more) for one in self._there]
        return [*(function(one, *more) for one in self._here), *(answer.result() for answer in there)]


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
