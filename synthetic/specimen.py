"""Simulates one specimen and writes its recordings and its truth."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from endoct.modalities.keys import shown
from endoct.stitching.errors import EndoctError, cause_of
from endoct.synthetic.frame_process import begin_wall, frame_processes
from endoct.synthetic.progress import Progress
from endoct.synthetic.sample.parameter_fields import LARGEST_SEED
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.synthetic.sample.ranges import NO_WISHES, Wish

MOST_WORKERS = 4


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
    ``oct-spectra`` (:mod:`endoct.synthetic.oct.raw`). ``on_progress(stage, fraction)`` is called from this thread.
    ``workers`` processors render (default: all, at most four): threads of this process, and all but one of them
    mostly in a process of its own that traces a part of the wall and renders frames.

    Raises :class:`EndoctError` for an unknown preset, a bad seed or a sample that does not hold together.
    """
    checked = _checked(sample) if sample is not None else None
    _check(preset, seed, bore_seed)
    workers = workers or min(MOST_WORKERS, os.cpu_count() or 1)
    with frame_processes(workers - 1) as processes:
        # what is imported here takes a while to load: meanwhile the processes get ready, and then trace
        from endoct.synthetic.draw import draw

        drawn = checked or draw(preset, seed, bore_seed=bore_seed, wishes=wishes)
        begin_wall(processes, drawn)
        from endoct.synthetic.recordings import write_specimen

        tell = on_progress or (lambda _stage, _fraction: None)
        write_specimen(folder, drawn, processes, tell, workers=workers, labels=labels, spectra=spectra)


def _check(preset: PresetName, seed: int, bore_seed: int | None) -> None:
    if preset not in PRESETS:
        raise EndoctError(f"unknown preset '{preset}'", expected=f"one of {', '.join(PRESETS)}")
    if min(seed, bore_seed or 0) < 0:
        raise EndoctError("a seed cannot be negative", found=shown(min(seed, bore_seed or 0)))
    if (largest := max(seed, bore_seed or 0)) > LARGEST_SEED:
        raise EndoctError("a seed is too large", found=shown(largest), expected=f"{LARGEST_SEED} at most")


def _checked(sample: Mapping[str, Any]) -> Sample:
    try:
        # as JSON, checking does not take true for 1, nor "2" for 2, and what is no JSON is no sample
        return Sample.model_validate_json(json.dumps(sample), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise EndoctError(
            f"'{where}' of the sample to replay cannot be used" if where else "the sample to replay cannot be used",
            found=shown(first["input"]) if where else "",
            expected=first["msg"].removeprefix("Value error, "),
            remedy="replay a sample.json as the simulator wrote it",
        ) from None
    except (TypeError, ValueError, RecursionError) as error:
        raise EndoctError("the sample to replay cannot be used", found=cause_of(error)) from error
