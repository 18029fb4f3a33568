"""Simulates one specimen and writes its recordings and its truth."""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tifffile
import torch
from numpy.typing import NDArray
from pydantic import ValidationError

from endoct.modalities.recording import map_frames
from endoct.stitching.errors import EndoctError
from endoct.synthetic.appearance import Appearance, build_appearance
from endoct.synthetic.bscan import render_bscans
from endoct.synthetic.camera import render_frame
from endoct.synthetic.draw import NO_WISHES, draw
from endoct.synthetic.labels.writing import write_labels
from endoct.synthetic.parameters import Sample
from endoct.synthetic.png import png
from endoct.synthetic.presets import PRESETS, PresetName
from endoct.synthetic.ranges import Wish
from endoct.synthetic.raw import write_spectra
from endoct.synthetic.sidecars import endoscope_sidecar, oct_sidecar, toml
from endoct.synthetic.truth import write_truth
from endoct.synthetic.video import write_video
from endoct.synthetic.wall import Wall, build_wall

_Frame = TypeVar("_Frame")
TOGETHER = 4  # slices: tracing their beams at once takes less time
Progress = Callable[[str, float], None]


def simulate(
    folder: Path,
    *,
    preset: PresetName = "quick",
    seed: int = 0,
    bore_seed: int | None = None,
    wishes: Mapping[str, Wish] = NO_WISHES,
    sample: Mapping[str, Any] | None = None,
    labels: bool = False,
    spectra: bool = False,
    on_progress: Progress | None = None,
    workers: int | None = None,
) -> None:
    """Write a specimen into ``folder``, which must not exist; the same arguments give the same bytes.

    Files: ``oct/pullback.tif`` u8 (slice, depth, A-scan) and ``endoscope/frame_0000.png`` … (or ``frames.mkv``), each
    with its ``acquisition.toml``; ``truth/wall.zarr``, ``truth/recording.json`` (see
    :func:`endoct.synthetic.truth.recording`), ``truth/sample.json``. ``bore_seed`` and ``wishes`` are those of
    :func:`endoct.synthetic.draw.draw`. ``sample``, the content of such a ``sample.json``, replays it; what is drawn
    from does not matter then. ``labels`` adds ``truth/labels`` (:mod:`endoct.synthetic.labels`), ``spectra`` adds
    ``oct-spectra`` (:mod:`endoct.synthetic.raw`). ``on_progress(stage, fraction)`` is called from this thread.
    ``workers`` threads render (default: one for each processor, at most four).

    Raises :class:`EndoctError` for an unknown preset, a bad seed or a sample that does not hold together.
    """
    drawn = _checked(sample) if sample is not None else _draw(preset, seed, bore_seed, wishes)
    tell = on_progress or (lambda _stage, _fraction: None)
    workers = workers or min(4, os.cpu_count() or 1)
    with _one_torch_thread():
        tell("wall", 0.0)
        wall = build_wall(drawn, workers)
        appearance = build_appearance(drawn, wall)
        folder.mkdir()
        tell("wall", 1.0)
        write_truth(folder / "truth", drawn, wall)
        _write_oct(folder / "oct", drawn, wall, appearance, partial(tell, "oct"), workers)
        _write_endoscope(folder / "endoscope", drawn, wall, partial(tell, "endoscope"), workers)
        if spectra:
            write_spectra(folder / "oct-spectra", drawn, wall, appearance, partial(tell, "spectra"), workers)
        if labels:
            write_labels(folder / "truth" / "labels", drawn, wall, appearance, partial(tell, "labels"), workers)


@contextmanager
def _one_torch_thread() -> Iterator[None]:
    """Keep torch from starting threads of its own: they would fight the renderer's over the processors."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _draw(preset: PresetName, seed: int, bore_seed: int | None, wishes: Mapping[str, Wish]) -> Sample:
    if preset not in PRESETS:
        raise EndoctError(f"unknown preset '{preset}'", expected=f"one of {', '.join(PRESETS)}")
    if min(seed, bore_seed or 0) < 0:
        raise EndoctError("a seed cannot be negative", found=str(min(seed, bore_seed or 0)))
    return draw(preset, seed, bore_seed=bore_seed, wishes=wishes)


def _checked(sample: Mapping[str, Any]) -> Sample:
    try:
        return Sample.model_validate(sample)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise EndoctError(
            f"'{where}' of the sample to replay cannot be used" if where else "the sample to replay cannot be used",
            found=repr(first["input"])[:80] if where else "",
            expected=first["msg"].removeprefix("Value error, "),
            remedy="replay a sample.json as the simulator wrote it",
        ) from None


def _write_oct(
    folder: Path, sample: Sample, wall: Wall, appearance: Appearance, tell: Callable[[float], None], workers: int
) -> None:
    folder.mkdir()
    size = PRESETS[sample.preset]

    def pages() -> Iterator[NDArray[np.uint8]]:
        groups = [range(first, min(first + TOGETHER, size.n_slices)) for first in range(0, size.n_slices, TOGETHER)]
        rendered = map_frames(lambda group: list(render_bscans(sample, wall, appearance, group)), groups, workers)
        for group, together in zip(groups, rendered, strict=True):
            yield from together
            tell(group.stop / size.n_slices)

    shape = size.n_slices, size.n_depth, size.n_ascans
    with tifffile.TiffWriter(folder / "pullback.tif", bigtiff=math.prod(shape) > 2**32 - 2**25) as tiff:
        tiff.write(pages(), shape=shape, dtype=np.uint8, photometric="minisblack", metadata={"axes": "ZYX"})
    (folder / "acquisition.toml").write_text(toml(oct_sidecar(sample)), encoding="utf-8")


def _write_endoscope(folder: Path, sample: Sample, wall: Wall, tell: Callable[[float], None], workers: int) -> None:
    folder.mkdir()
    n_frames = PRESETS[sample.preset].n_frames
    video = sample.endoscope.storage == "video"

    def recorded(index: int) -> NDArray[np.uint8]:
        return render_frame(sample, wall, index)

    def told(frames: Iterable[_Frame]) -> Iterator[_Frame]:
        for i, frame in enumerate(frames, 1):
            yield frame
            tell(i / n_frames)

    if video:
        write_video(folder / "frames.mkv", told(map_frames(recorded, range(n_frames), workers)))
    else:
        encoded = map_frames(lambda index: png(recorded(index)), range(n_frames), workers)
        for i, data in enumerate(told(encoded)):
            (folder / f"frame_{i:04d}.png").write_bytes(data)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")
