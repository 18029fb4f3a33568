"""The task "speed": seconds and memory of the steps that take time, beside the textbook's way to the same answer.

Every job runs in a process of its own. It runs once untimed, so that nothing is loaded or compiled in a timed run, and
then as often as the case wants. `endoct unroll` is run as a program, from its start to its end. A method's answer is
judged as well, since a fast wrong answer is no rival.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import masked_gaussian
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.reconstruction import Counts, mean_spectrum, reconstruction, taps, window
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.cases import speed_jobs as jobs
from endoct.workbench.bench.cases.speed_jobs import JOBS, Work
from endoct.workbench.bench.task import SUCCESS, Case, Range, Task
from endoct.workbench.bench.tasks import alignment, oct
from endoct.workbench.running.measured import Measured, endoct_command, measure_calls, measure_program

ASCANS_PER_S = 14_000 / 0.154
"""Rate of the scanner whose B-scans have 14 000 A-scans: 91 kHz, 390 turns a minute."""
FRAMES_PER_S = 30.0
"""Rate of an endoscope's camera."""
TOLERANCE: Mapping[str, float] = {
    "pullback": 0.2,
    "strips": 0.2,  # the light and the probe's own pattern are in the frames
    "threshold": 1e-3,
    "alignment": alignment.SUCCESS_PX,
    "spectra": 0.5,
}
"""Largest score ``error`` that an answer may have, for each job."""
WINDOW = "hann"
CLEAR_DB = 20.0
"""Levels of spectra below this may be noise. Reflectors of the job have 25 to 30 dB."""
BLUR_PX = 2.0
EVERY = 50
"""One in this many A-scans of the spectra is checked."""
FEW_STRIPS = 3

PULLBACK: Mapping[str, Range] = {
    "off_axis": (0.3, 0.3),
    "start": ("triggered",),
    "rotation_error_deg": (2.0, 2.0),
    "turn_jitter": (0.01, 0.01),
}
"""Conditions of the task "oct" for a pullback without particular difficulties."""
RANGES: Mapping[str, Range] = {
    "job": JOBS,
    "repeats": (5.0, 5.0),
    "slices": (20.0, 20.0),
    "ascans": (14_000.0, 14_000.0),
    "frames": (20.0, 20.0),
    "frame_px": (1080.0, 1080.0),
}

SpeedCase = Case[Work, Any]


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> SpeedCase:
    """Return one job; those that are wanted take turns from one seed to the next."""
    ranges = {**RANGES, **ranges}
    job = str(ranges["job"][(seed + index) % len(ranges["job"])])
    size = {name: round(float(range_[0])) for name, range_ in ranges.items() if name != "job"}
    return _MAKERS[job](seed, index, size)


def _pullback(seed: int, index: int, size: Mapping[str, int]) -> SpeedCase:
    small = oct.cases(seed, index, PULLBACK)
    specimen = small.given.parent
    folder = jobs.write_pullback(specimen, size["slices"], size["ascans"], specimen.parent / "pullback")
    truth = jobs.repeated_truth(small.truth, size["slices"], size["ascans"])
    work = Work("pullback", (folder,), size["repeats"], size["slices"])
    return replace(_case(seed, index, work, truth, size), scratch=small.scratch)


def _strips(seed: int, index: int, size: Mapping[str, int]) -> SpeedCase:
    from endoct.workbench.bench.cases.specimens import simulated

    with simulated(oct.PRESET, seed, index, {"bore.bone": "phantom"}) as scratch:
        specimen = Path(scratch) / "specimen"
        frames, calibration = jobs.survey_square(specimen, size["frame_px"], size["frames"], Path(scratch) / "frames")
    few = np.linspace(0, len(frames) - 1, FEW_STRIPS).astype(int)
    truth = {int(k): jobs.sampled_strip(frames[k], calibration) for k in few}
    return _case(seed, index, Work("strips", (frames, calibration), size["repeats"], len(frames)), truth, size)


def _threshold(seed: int, index: int, size: Mapping[str, int]) -> SpeedCase:
    from skimage.filters import threshold_li

    relief_mm = jobs.relief_of_cells(seed, index, size["ascans"] * jobs.N_DEPTH)
    truth = float(threshold_li(relief_mm.astype(np.float64)))
    return _case(seed, index, Work("threshold", (relief_mm,), size["repeats"], 1), truth, size)


def _alignment(seed: int, index: int, size: Mapping[str, int]) -> SpeedCase:
    pair = alignment.cases(seed, index, alignment.RANGES)
    return _case(seed, index, Work("alignment", pair.given, size["repeats"], 1), pair, size)


def _spectra(seed: int, index: int, size: Mapping[str, int]) -> SpeedCase:
    spectra, places = jobs.raw_spectra(seed, index, size["ascans"])
    truth_db = jobs.levels_db(spectra[::EVERY], places, mean_spectrum(spectra))
    return _case(seed, index, Work("spectra", (spectra, places), size["repeats"], 1), truth_db, size)


def _case(seed: int, index: int, work: Work, truth: object, size: Mapping[str, int]) -> SpeedCase:
    return Case(f"{work.job}-{seed}-{index}", work, truth, {"job": work.job, **size})


_MAKERS: Mapping[str, Callable[[int, int, Mapping[str, int]], SpeedCase]] = {
    "pullback": _pullback,
    "strips": _strips,
    "threshold": _threshold,
    "alignment": _alignment,
    "spectra": _spectra,
}


def judge(case: SpeedCase, answer: object) -> Mapping[str, float]:
    """Score seconds and memory, and by how much the answer is off. Raises :class:`EndoctError` for another answer."""
    if not isinstance(answer, Measured):
        raise EndoctError("nothing was measured", found=type(answer).__name__, expected="a Measured")
    work = case.given
    seconds = float(np.median(answer.seconds))
    error = _ERRORS[work.job](case, answer.answer)
    ascans = float(case.conditions["ascans"]) * work.amount
    of_instrument = {"pullback": ascans / ASCANS_PER_S, "spectra": ascans / ASCANS_PER_S}
    of_instrument["strips"] = work.amount / FRAMES_PER_S
    return {
        SUCCESS: float(error <= TOLERANCE[work.job]),
        "seconds": seconds,
        "instrument": of_instrument.get(work.job, np.nan) / seconds,
        "peak_mb": answer.peak_mb,
        "error": error,
        "per_s": work.amount / seconds,
        "cpu_seconds": float(np.median(answer.cpu_seconds)),
    }


def _error_of_cells(case: SpeedCase, answer: Path | Panorama | int) -> float:
    """Return 1 − Jaccard index of the cells against the true ones; of who only reads, the share that was not read."""
    work = case.given
    if isinstance(answer, int):
        return abs(1 - answer / (work.amount * float(case.conditions["ascans"]) * jobs.N_DEPTH))
    panorama = load_panorama(answer) if isinstance(answer, Path) else answer
    on = oct.judged_samples(case.truth, panorama)  # of what was done: the textbook does a few slices
    return 1 - (jaccard(on.cells, on.true, on.known) or 0.0)


def _error_of_strips(case: SpeedCase, answer: Sequence[tuple[Image, Mask]]) -> float:
    """Return 1 − the least correlation of some strips with the frame on the mirror's circles, logarithms of both.

    Without the light, so rows and columns are levelled, and without the noise of single pixels.
    """
    return 1 - min(
        float(np.corrcoef(_level(truth, seen), _level(strip, seen))[0, 1])
        for truth, (strip, seen) in ((truth, answer[k]) for k, truth in case.truth.items())
    )


def _level(strip: Image, observed: Mask) -> Image:
    """Return the logarithms of the samples that are ``observed``, less the means of their rows and columns, (n,)."""
    logs = np.where(observed, masked_gaussian(np.log(np.maximum(strip, 1e-3)), observed, BLUR_PX, BLUR_PX), 0)
    for axis in (1, 0):
        n_seen = np.maximum(observed.sum(axis, keepdims=True), 1)
        logs = np.where(observed, logs - logs.sum(axis, keepdims=True) / n_seen, 0)
    return np.asarray(logs[observed], np.float32)


def _error_of_threshold(case: SpeedCase, answer: float) -> float:
    return float(abs(answer / case.truth - 1))


def _error_of_alignment(case: SpeedCase, answer: Any) -> float:
    return float(alignment.judge(case.truth, answer)["landmark_px"])


def _error_of_levels(case: SpeedCase, answer: Image) -> float:
    """Return the median difference of the levels that are clear of the noise, dB."""
    some = answer[::EVERY]
    levels_db = some / COUNTS_PER_DB + ZERO_DB if some.dtype.kind == "u" else some
    clear = case.truth > CLEAR_DB
    return float(np.median(np.abs(levels_db - case.truth)[clear]))


_ERRORS: Mapping[str, Callable[[SpeedCase, Any], float]] = {
    "pullback": _error_of_cells,
    "strips": _error_of_strips,
    "threshold": _error_of_threshold,
    "alignment": _error_of_alignment,
    "spectra": _error_of_levels,
}


TASK = Task(
    name="speed",
    title="seconds and memory of the steps that take time, beside the textbook's way, each in a process of its own",
    signature=(
        "method(work: endoct.workbench.bench.cases.speed_jobs.Work) -> endoct.workbench.running.measured.Measured\n"
        "Does work.job with work.given, work.repeats times, by measure_calls or measure_program of the latter module; "
        "raises Declined for a job that it does not do. pullback: a folder → a Panorama or its store; strips: frames "
        "and their calibration → (strip, valid) of each; threshold: values → Li's threshold; alignment: two panoramas "
        "→ Alignment; spectra: counts (A-scan, 1024) and where even wavenumbers lie → levels in dB (A-scan, 512)."
    ),
    cases=cases,
    judge=judge,
    ranges=RANGES,
    scores={
        "seconds": "seconds of one run, median of the repeats",
        "instrument": "times as fast as it is recorded: 14 000 A-scans in 0.154 s, 30 frames in 1 s",
        "peak_mb": "largest resident set of the process, with interpreter, libraries and what is given, MB",
        "error": "error of the answer: 1 − Jaccard, 1 − correlation, relative, px or dB, by job",
        "per_s": "slices, frames, images or pairs a second",
        "cpu_seconds": "seconds of all processors in one run, median of the repeats",
    },
    by="job",
)


def ours(work: Work) -> Measured[Any]:
    """Do the job as endoct does it."""
    if work.job == "pullback":
        (folder,) = work.given
        store = folder.parent / "unrolled.zarr"
        command = endoct_command("unroll", str(folder), "-o", str(store), "--overwrite")
        return measure_program(command, store, repeats=work.repeats)
    return measure_calls(_OURS[work.job], *work.given, repeats=work.repeats)


def _unroll_frames(frames: Sequence[Frame], calibration: EndoscopeCalibration) -> list[tuple[Image, Mask]]:
    from endoct.modalities.endoscope.unroll import unroll_frame

    strips = thread_map(partial(unroll_frame, calibration=calibration), frames)  # as the program does
    return [(strip.intensity, strip.valid) for strip in strips]


def _bscan(spectra: Counts, places: Coordinates) -> Any:
    return reconstruction(taps(places, "cubic"), window(WINDOW, places)).bscan(spectra)


_OURS: Mapping[str, Callable[..., Any]] = {
    "strips": _unroll_frames,
    "threshold": li_threshold,
    "alignment": alignment.ours,
    "spectra": _bscan,
}
