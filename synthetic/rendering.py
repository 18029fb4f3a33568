"""Renders both recordings at the same time, by threads of this process and by worker processes.

A worker process renders frames of the endoscope, which need the maps of the wall only; a thread of this process
renders B-scans. Whoever has none left takes the others.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.parallel import Jobs
from endoct.stitching.worker_process import WorkerProcess
from endoct.synthetic.endoscope.camera import StoredFrame, stored_frame
from endoct.synthetic.model import Model
from endoct.synthetic.oct.bscan import render_bscans
from endoct.synthetic.sample.presets import PRESETS

Bscans = list[NDArray[np.uint8]]
COLUMNS_TOGETHER = 16_000  # of B-scans: tracing the beams of several at once takes less time


@contextmanager
def rendering(model: Model, processes: Sequence[WorkerProcess]) -> Iterator[tuple[Jobs[Bscans], Jobs[StoredFrame]]]:
    """Yield the B-scans of ``model``, in groups, and its frames, while one thread and ``processes`` render them.

    Nothing more is rendered once the context is left.
    """
    groups = _groups_of_slices(model)
    bscans, frames = Jobs[Bscans](len(groups)), Jobs[StoredFrame](PRESETS[model.sample.preset].n_frames)

    def render_group(index: int) -> Bscans:
        return list(render_bscans(model.sample, model.wall, model.appearance, groups[index]))

    def render_here() -> None:
        bscans.work(render_group)
        frames.work(partial(stored_frame, model.sample, model.wall, model.lighting))

    def render_in(process: WorkerProcess) -> None:
        sample, wall, lighting = (process.store(one) for one in (model.sample, model.wall.maps(), model.lighting))
        frames.work(lambda index: process.call(stored_frame, sample, wall, lighting, index).result())
        bscans.work(render_group)

    with ThreadPoolExecutor(1 + len(processes)) as pool:
        try:
            working = [pool.submit(render_here), *(pool.submit(render_in, process) for process in processes)]
            yield bscans, frames
            for one in working:
                one.result()
        finally:
            bscans.cancel()
            frames.cancel()


def _groups_of_slices(model: Model) -> list[range]:
    size = PRESETS[model.sample.preset]
    together = max(1, COLUMNS_TOGETHER * size.ascans_per_column // size.n_ascans)
    return [range(first, min(first + together, size.n_slices)) for first in range(0, size.n_slices, together)]
