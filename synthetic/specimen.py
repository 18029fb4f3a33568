"""Simulates one specimen and writes its recordings and its truth."""

import math
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray
from pydantic import ValidationError

from endoct.modalities.recording import map_frames
from endoct.stitching.errors import EndoctError
from endoct.synthetic.appearance import build_appearance
from endoct.synthetic.bscan import render_bscan
from endoct.synthetic.camera import render_frame
from endoct.synthetic.draw import NO_WISHES, draw
from endoct.synthetic.parameters import Sample
from endoct.synthetic.presets import PRESETS, PresetName
from endoct.synthetic.ranges import Wish
from endoct.synthetic.sidecars import endoscope_sidecar, oct_sidecar, toml
from endoct.synthetic.truth import write_truth
from endoct.synthetic.wall import Wall, build_wall

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

    Files: ``oct/pullback.tif`` u8 (slice, depth, A-scan) and ``endoscope/frame_0000.png`` …, each with its
    ``acquisition.toml``; ``truth/wall.zarr``, ``truth/recording.json`` (see
    :func:`endoct.synthetic.truth.recording`), ``truth/sample.json``. ``bore_seed`` and ``wishes`` are those of
    :func:`endoct.synthetic.draw.draw`. ``sample``, the content of such a ``sample.json``, replays it; what is drawn
    from does not matter then. ``labels`` adds ``truth/labels``, ``spectra`` adds ``oct-spectra``.
    ``on_progress(stage, fraction)`` is called from this thread. ``workers`` threads render (default: one for each processor, at most four).

    Raises :class:`EndoctError` for an unknown preset, a bad seed or a sample that does not hold together.
    """
    drawn = _checked(sample) if sample is not None else _draw(preset, seed, bore_seed, wishes)
    tell = on_progress or (lambda _stage, _fraction: None)
    workers = workers or min(4, os.cpu_count() or 1)
    tell("wall", 0.0)
    wall = build_wall(drawn)
    folder.mkdir()
    tell("wall", 1.0)
    write_truth(folder / "truth", drawn, wall)
    _write_oct(folder / "oct", drawn, wall, tell, workers)
    _write_endoscope(folder / "endoscope", drawn, wall, tell, workers)


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


def _write_oct(folder: Path, sample: Sample, wall: Wall, tell: Progress, workers: int) -> None:
    folder.mkdir()
    size = PRESETS[sample.preset]
    appearance = build_appearance(sample, wall)

    def pages() -> Iterator[NDArray[np.uint8]]:
        rendered = map_frames(lambda i: render_bscan(sample, wall, appearance, i), range(size.n_slices), workers)
        for i, page in enumerate(rendered, 1):
            yield page
            tell("oct", i / size.n_slices)

    shape = size.n_slices, size.n_depth, size.n_ascans
    with tifffile.TiffWriter(folder / "pullback.tif", bigtiff=math.prod(shape) > 2**32 - 2**25) as tiff:
        tiff.write(pages(), shape=shape, dtype=np.uint8, photometric="minisblack", metadata={"axes": "ZYX"})
    (folder / "acquisition.toml").write_text(toml(oct_sidecar(sample)), encoding="utf-8")


def _write_endoscope(folder: Path, sample: Sample, wall: Wall, tell: Progress, workers: int) -> None:
    folder.mkdir()
    n_frames = PRESETS[sample.preset].n_frames

    def png(index: int) -> NDArray[np.uint8]:
        frame = render_frame(sample, wall, index)
        done, data = cv2.imencode(".png", frame[:, :, ::-1] if frame.ndim == 3 else frame)
        if not done:
            raise EndoctError(f"frame {index} could not be encoded as PNG")
        return np.asarray(data, dtype=np.uint8)

    for i, data in enumerate(map_frames(png, range(n_frames), workers)):
        (folder / f"frame_{i:04d}.png").write_bytes(data.tobytes())
        tell("endoscope", (i + 1) / n_frames)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")
