"""The two recordings of a specimen: rendered at the same time, written with their sidecars, samples in order.

A worker process renders frames of the endoscope, which need the maps of the wall only; a thread of this process
renders B-scans. Whoever has none left takes the others.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.base.compute.parallel import Jobs, Progress
from endoct.base.compute.worker_process import WorkerProcess
from endoct.synthetic.endoscope.camera import StoredFrame, stored_frame
from endoct.synthetic.model import Model
from endoct.synthetic.oct.bscan import render_bscans
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sidecars import endoscope_sidecar, oct_sidecar, toml

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


PROGRESS_EVERY_S = 0.2
ALL_TAKEN = 0.99


def write_recordings(folder: Path, model: Model, processes: Sequence[WorkerProcess], progress: Progress) -> None:
    """Write ``oct`` and ``endoscope`` into ``folder`` while this process and ``processes`` render them."""
    with ThreadPoolExecutor(2) as pool, rendering(model, processes) as (bscans, frames):
        oct_ = pool.submit(write_oct, folder / "oct", model.sample, bscans.results())
        endoscope = pool.submit(write_endoscope, folder / "endoscope", model.sample, frames.results())
        taken = {"oct": bscans.share_taken, "endoscope": frames.share_taken}
        for title, writing in (("oct", oct_), ("endoscope", endoscope)):
            while wait([writing], timeout=PROGRESS_EVERY_S).not_done:
                for each in [*taken]:
                    progress(each, min(taken[each](), ALL_TAKEN))  # what was taken last is still being written
            writing.result()
            del taken[title]
            progress(title, 1.0)


def write_oct(folder: Path, sample: Sample, groups: Iterable[Bscans]) -> None:
    """Write ``pullback.tif`` u8 (slice, depth, A-scan) and ``acquisition.toml``; ``groups`` of B-scans in order."""
    folder.mkdir()
    size = PRESETS[sample.preset]
    shape = size.n_slices, size.n_depth, size.n_ascans
    pages = (page for group in groups for page in group)
    with tifffile.TiffWriter(folder / "pullback.tif", bigtiff=math.prod(shape) > 2**32 - 2**25) as tiff:
        tiff.write(pages, shape=shape, dtype=np.uint8, photometric="minisblack", metadata={"axes": "ZYX"})
    (folder / "acquisition.toml").write_text(toml(oct_sidecar(sample)), encoding="utf-8")


def write_endoscope(folder: Path, sample: Sample, frames: Iterable[StoredFrame]) -> None:
    """Write ``frame_0000.png`` … or ``frames.mkv``, and ``acquisition.toml``; ``frames`` in order."""
    folder.mkdir()
    if sample.endoscope.storage == "video":
        from endoct.synthetic.endoscope.video_file import write_video  # only who writes one loads it

        write_video(folder / "frames.mkv", cast(Iterable[NDArray[np.uint8]], frames))
    else:
        for i, data in enumerate(cast(Iterable[bytes], frames)):
            (folder / f"frame_{i:04d}.png").write_bytes(data)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")
