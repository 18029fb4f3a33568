"""A second process for what can be done at the same time: unrolling the other recording, drawing figures."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from endoct.stitching.worker_process import WorkerProcess, worker_process
from endoct.workbench.running.refusals import tame_libraries


@contextmanager
def second_process() -> Iterator[WorkerProcess | None]:
    """Start a worker process; yield None on a computer with one processor, where it would be no help."""
    if (os.cpu_count() or 1) < 2:
        yield None
        return
    with worker_process() as process:
        process.call(tame_libraries)
        yield process
