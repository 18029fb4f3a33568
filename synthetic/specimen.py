"""Simulates one specimen: checks what is asked for, draws it, and has its files written by several processes."""

import json
import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from pydantic import ValidationError

from endoct.base.compute.parallel import Progress
from endoct.base.compute.worker_process import worker_process
from endoct.base.errors import EndoctError, cause_of
from endoct.modalities.acquisition import abridged
from endoct.synthetic.sample.parameter_fields import LARGEST_SEED
from endoct.synthetic.sample.parameters import Sample, Volume
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.synthetic.sample.ranges import NO_RANGES, Range

SPECIMEN_VERSION = "1"
"""Version of the bytes that are written for a seed. Every change of these raises it, so that no data set mixes two."""
MOST_WORKERS = 4


def simulate(
    folder: Path,
    *,
    preset: PresetName = "quick",
    seed: int = 0,
    bore_seed: int | None = None,
    ranges: Mapping[str, Range] = NO_RANGES,
    volume: Volume | None = None,
    ct: bool = False,
    ct_slice_mm: float | None = None,
    cone_beam: bool = False,
    sample: Mapping[str, object] | None = None,
    labels: bool = False,
    spectra: bool = False,
    on_progress: Progress | None = None,
    workers: int | None = None,
) -> None:
    """Write a specimen into ``folder``, which must not exist; the same arguments give the same bytes.

    Files: ``oct/pullback.tif`` u8 (slice, depth, A-scan) and ``endoscope/frame_0000.png`` … (or ``frames.mkv``), each
    with its ``acquisition.toml``; ``truth/wall.zarr``, ``truth/recording.json`` (see
    :func:`endoct.synthetic.truth.recording`), ``truth/sample.json``. ``bore_seed`` and ``ranges`` are those of
    :func:`endoct.synthetic.draw.draw`. ``volume`` is the user's bone to drill into
    (:func:`endoct.synthetic.bone.patient.stated_volume`). ``ct`` adds ``truth/ct.nii.gz`` with labels and cells,
    its true line and, in ``folder``, a plan off it (:mod:`endoct.synthetic.ct_scan`); ``cone_beam``
    ``truth/cone_beam.nii.gz`` (:mod:`endoct.synthetic.ct_scan`). ``sample``, the content of such a
    ``sample.json``, replays it; what is drawn from does not matter then. ``labels`` adds ``truth/labels``
    (:mod:`endoct.synthetic.labels`), ``spectra`` ``oct-spectra`` (:mod:`endoct.synthetic.oct.bscan`).
    ``on_progress(stage, fraction)`` is called from this thread.
    ``workers`` processors render (default: all, at most four): a thread of this process, and worker processes that
    trace parts of the wall and render frames.

    Raises :class:`EndoctError` for an unknown preset, a bad seed or a sample that does not hold together.
    """
    replayed = _checked(sample) if sample is not None else None
    _check(preset, seed, bore_seed)
    progress = on_progress or (lambda _stage, _fraction: None)
    workers = workers or min(MOST_WORKERS, os.cpu_count() or 1)
    with ExitStack() as stack:
        processes = [stack.enter_context(worker_process()) for _ in range(workers - 1)]
        for process in processes:
            process.preload("endoct.synthetic.endoscope.camera")  # it loads what tracing the wall takes as well
            process.call(_keep_to_one_thread)
        # this takes most of a second to load, in which the processes get ready
        from endoct.synthetic.draw import Scans, draw
        from endoct.synthetic.specimen_files import write_specimen

        scans = Scans(ct, ct_slice_mm, cone_beam)
        drawn = replayed or draw(preset, seed, bore_seed=bore_seed, ranges=ranges, volume=volume, scans=scans)
        write_specimen(folder, drawn, processes, progress, labels=labels, spectra=spectra)


def _keep_to_one_thread() -> None:
    """Have OpenCV of a process use one thread."""
    import cv2

    cv2.setNumThreads(1)


def _check(preset: PresetName, seed: int, bore_seed: int | None) -> None:
    if preset not in PRESETS:
        raise EndoctError(f"unknown preset '{preset}'", expected=f"one of {', '.join(PRESETS)}")
    if min(seed, bore_seed or 0) < 0:
        raise EndoctError("a seed cannot be negative", found=abridged(min(seed, bore_seed or 0)))
    if (largest := max(seed, bore_seed or 0)) > LARGEST_SEED:
        raise EndoctError("a seed is too large", found=abridged(largest), expected=f"{LARGEST_SEED} at most")


def _checked(sample: Mapping[str, object]) -> Sample:
    try:
        # as JSON, checking does not take true for 1, nor "2" for 2, and what is no JSON is no sample
        return Sample.model_validate_json(json.dumps(sample), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise EndoctError(
            f"'{where}' of the sample to replay cannot be used" if where else "the sample to replay cannot be used",
            found=abridged(first["input"]) if where else "",
            expected=first["msg"].removeprefix("Value error, "),
            remedy="replay a sample.json as the simulator wrote it",
        ) from None
    except (TypeError, ValueError, RecursionError) as error:
        raise EndoctError("the sample to replay cannot be used", found=cause_of(error)) from error
