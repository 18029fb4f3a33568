"""A side of a pose in the air that it is looked for in. Loads torch: imported only where a pose is looked for."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import torch

from endoct.fusion.evidence.side import Side
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.pose.air import AirAround
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.workbench.running.scheduler import one_blas_thread

ROWS_MM, COLUMNS = 0.05, 1024
"""Of a side's comparison with the CT: far finer than a CT."""
PARAMETERS = CompareParameters(dz_mm=ROWS_MM, n_theta=COLUMNS, polarity="dark")


@dataclass(frozen=True, eq=False)
class SideInAir:
    """A side, and the air around the plan that it is looked for in."""

    air: AirAround
    side: Side

    @cached_property
    def cells(self) -> Segmentation:
        """The cells of the side, found when they are first read, and kept."""
        return segment_side(self.side, PARAMETERS, "dark")


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS and torch to one thread, as a context or a decorator: the order of sums is that of any machine.

    A search and a fit are many steps on small arrays, at which threads wait for one another.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with one_blas_thread():
            yield
    finally:
        torch.set_num_threads(before)
