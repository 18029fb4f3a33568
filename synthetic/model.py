"""A specimen in memory: the drawn sample, what is built from it for both instruments, and their recordings rendered.

A worker process renders frames of the endoscope, which need the maps of the wall only; a thread of this process
renders B-scans. Whoever has none left takes the others.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from endoct.base.compute.parallel import Jobs
from endoct.base.compute.worker_process import WorkerProcess
from endoct.synthetic.bone.baked_maps import TracedElsewhere
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.endoscope.camera import StoredFrame, stored_frame
from endoct.synthetic.endoscope.lighting import Lighting, lighting_of
from endoct.synthetic.oct.bscan import render_bscans
from endoct.synthetic.oct.sweep import Appearance, build_appearance
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS

Bscans = list[NDArray[np.uint8]]
COLUMNS_TOGETHER = 16_000
"""B-scans of so many columns are rendered together: tracing the beams of several at once takes less time."""


@dataclass(frozen=True, eq=False)
class Model:
    """The ``sample``, the ``wall`` it describes, how that looks to the OCT, and its ``lighting`` by the endoscope."""

    sample: Sample
    wall: Wall
    appearance: Appearance
    lighting: Lighting


def build_model(sample: Sample, elsewhere: TracedElsewhere = ()) -> Model:
    """Return the model of ``sample``; ``elsewhere`` is that of :func:`endoct.synthetic.bone.wall.build_wall`."""
    wall = build_wall(sample, elsewhere=elsewhere)
    return Model(sample, wall, build_appearance(sample, wall), lighting_of(sample, wall))


@contextmanager
def rendering(model: Model, processes: Sequence[WorkerProcess]) -> Iterator[tuple[Jobs[Bscans], Jobs[StoredFrame]]]:
    """Yield the B-scans of ``model``, in groups, and its frames, while one thread and ``processes`` render them.

    Nothing more is rendered once the context is left.
    """
    groups = _groups_of_slices(model)
    bscans, frames = Jobs[Bscans](len(groups)), Jobs[StoredFrame](len(model.sample.endoscope.z_mm))

    def render_group(index: int) -> Bscans:
        return list(render_bscans(model.sample, model.wall, model.appearance, groups[index]))

    def render_here() -> None:
        bscans.work(render_group)
        frames.work(partial(stored_frame, model.sample, model.wall, model.lighting))

    def render_in(process: WorkerProcess) -> None:
        sample, wall, lighting = (process.store(part) for part in (model.sample, model.wall.maps(), model.lighting))
        frames.work(lambda index: process.call(stored_frame, sample, wall, lighting, index).result())
        bscans.work(render_group)

    with ThreadPoolExecutor(1 + len(processes)) as pool:
        try:
            working = [pool.submit(render_here), *(pool.submit(render_in, process) for process in processes)]
            yield bscans, frames
            for work in working:
                work.result()
        finally:
            bscans.cancel()
            frames.cancel()


def _groups_of_slices(model: Model) -> list[range]:
    size = PRESETS[model.sample.preset]
    together = max(1, COLUMNS_TOGETHER * size.ascans_per_column // size.n_ascans)
    return [range(first, min(first + together, size.n_slices)) for first in range(0, size.n_slices, together)]
