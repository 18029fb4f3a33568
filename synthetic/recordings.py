"""Renders the recordings of a specimen and writes them with their truth."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.endoscope.camera import stored_frame
from endoct.synthetic.frame_process import FrameProcess, frame_from, part_from, show_wall
from endoct.synthetic.oct.appearance import Appearance, build_appearance
from endoct.synthetic.oct.bscan import render_bscans
from endoct.synthetic.progress import Progress
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sharing import Shared
from endoct.synthetic.sidecars import endoscope_sidecar, oct_sidecar, toml

_Item = TypeVar("_Item")
Bscans = list[NDArray[np.uint8]]
TELL_EVERY_S = 0.2
COLUMNS_TOGETHER = 16_000  # of B-scans: tracing the beams of several at once takes less time


def write_specimen(
    folder: Path,
    sample: Sample,
    processes: Sequence[FrameProcess],
    tell: Progress,
    *,
    workers: int,
    labels: bool,
    spectra: bool,
) -> None:
    """Write what :func:`endoct.synthetic.specimen.simulate` says of ``sample`` into ``folder``, which must not exist.

    ``workers`` threads work, those that speak for one of ``processes`` included, which trace parts of the wall already
    (:func:`endoct.synthetic.frame_process.begin_wall`).
    """
    tell("wall", 0.0)
    elsewhere = [partial(part_from, process) for process in processes]
    wall = build_wall(sample, workers - len(processes), elsewhere)
    appearance = build_appearance(sample, wall)
    folder.mkdir()
    tell("wall", 1.0)
    _record(folder, sample, wall, appearance, processes, tell, workers)
    if spectra:
        from endoct.synthetic.oct.raw import write_spectra  # only who asks for them loads it

        write_spectra(folder / "oct-spectra", sample, wall, appearance, partial(tell, "spectra"), workers)
    if labels:
        from endoct.synthetic.labels.writing import write_labels

        write_labels(folder / "truth" / "labels", sample, wall, appearance, partial(tell, "labels"), workers)


def _record(
    folder: Path,
    sample: Sample,
    wall: Wall,
    appearance: Appearance,
    processes: Sequence[FrameProcess],
    tell: Progress,
    workers: int,
) -> None:
    """Write truth and both recordings; processes take frames, threads B-scans, and whoever has none left the others."""
    size = PRESETS[sample.preset]
    together = max(1, COLUMNS_TOGETHER * size.ascans_per_column // size.n_ascans)
    groups = [range(first, min(first + together, size.n_slices)) for first in range(0, size.n_slices, together)]
    bscans, frames = Shared[Bscans](len(groups)), Shared[Any](size.n_frames)

    def group(index: int) -> Bscans:
        return list(render_bscans(sample, wall, appearance, groups[index]))

    def speak_for(process: FrameProcess) -> None:
        show_wall(process, wall)
        frames.serve(partial(frame_from, process))
        bscans.serve(group)

    def render() -> None:
        bscans.serve(group)
        frames.serve(partial(stored_frame, sample, wall))

    with ThreadPoolExecutor(workers + 1) as pool:
        try:
            serving = [pool.submit(speak_for, process) for process in processes]
            serving += [pool.submit(render) for _ in range(workers - len(processes))]
            written: list[int] = []
            endoscope = pool.submit(_write_endoscope, folder / "endoscope", sample, _noted(frames.results(), written))
            from endoct.synthetic.truth import write_truth  # takes a while to load: meanwhile others work

            write_truth(folder / "truth", sample, wall)
            _write_oct(folder / "oct", sample, _told(bscans.results(), partial(tell, "oct"), len(groups)))
            while wait([endoscope], timeout=TELL_EVERY_S).not_done:
                tell("endoscope", len(written) / size.n_frames)
            endoscope.result()
            tell("endoscope", 1.0)
            for served in serving:
                served.result()
        finally:
            frames.stop()
            bscans.stop()


def _noted(frames: Iterable[_Item], written: list[int]) -> Iterator[_Item]:
    """Pass frames on, and add to ``written`` those that were asked for the next one after."""
    for index, frame in enumerate(frames):
        yield frame
        written.append(index)


def _told(groups: Iterable[_Item], tell: Callable[[float], None], n: int) -> Iterator[_Item]:
    for i, group in enumerate(groups, 1):
        yield group
        tell(i / n)


def _write_oct(folder: Path, sample: Sample, groups: Iterable[Bscans]) -> None:
    folder.mkdir()
    size = PRESETS[sample.preset]
    shape = size.n_slices, size.n_depth, size.n_ascans
    pages = (page for group in groups for page in group)
    with tifffile.TiffWriter(folder / "pullback.tif", bigtiff=math.prod(shape) > 2**32 - 2**25) as tiff:
        tiff.write(pages, shape=shape, dtype=np.uint8, photometric="minisblack", metadata={"axes": "ZYX"})
    (folder / "acquisition.toml").write_text(toml(oct_sidecar(sample)), encoding="utf-8")


def _write_endoscope(folder: Path, sample: Sample, frames: Iterable[Any]) -> None:
    """Write frames as :func:`endoct.synthetic.endoscope.camera.stored_frame` gives them."""
    folder.mkdir()
    if sample.endoscope.storage == "video":
        from endoct.synthetic.endoscope.video import write_video  # only who writes one loads it

        write_video(folder / "frames.mkv", frames)
    else:
        for i, data in enumerate(frames):
            (folder / f"frame_{i:04d}.png").write_bytes(data)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")
