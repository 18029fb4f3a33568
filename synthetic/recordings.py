"""Writes the two recordings of a specimen: samples in order, and the sidecar."""

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import cast

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.stitching.worker_process import WorkerProcess
from endoct.synthetic.endoscope.camera import StoredFrame
from endoct.synthetic.model import Model
from endoct.synthetic.progress import Progress
from endoct.synthetic.rendering import Bscans, rendering
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sidecars import endoscope_sidecar, oct_sidecar, toml

PROGRESS_EVERY_S = 0.2
ALL_TAKEN = 0.99


def write_recordings(folder: Path, model: Model, processes: Sequence[WorkerProcess], progress: Progress) -> None:
    """Write ``oct`` and ``endoscope`` into ``folder`` while this process and ``processes`` render them."""
    with ThreadPoolExecutor(2) as pool, rendering(model, processes) as (bscans, frames):
        oct_ = pool.submit(write_oct, folder / "oct", model.sample, bscans.results())
        endoscope = pool.submit(write_endoscope, folder / "endoscope", model.sample, frames.results())
        for title, writing, share in (("oct", oct_, bscans.share_taken), ("endoscope", endoscope, frames.share_taken)):
            while wait([writing], timeout=PROGRESS_EVERY_S).not_done:
                progress(title, min(share(), ALL_TAKEN))  # what was taken last is still being written
            writing.result()
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
        from endoct.synthetic.endoscope.video import write_video  # only who writes one loads it

        write_video(folder / "frames.mkv", cast(Iterable[NDArray[np.uint8]], frames))
    else:
        for i, data in enumerate(cast(Iterable[bytes], frames)):
            (folder / f"frame_{i:04d}.png").write_bytes(data)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")
