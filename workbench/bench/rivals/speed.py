"""The jobs of the task "speed" as one would do them with scipy, scikit-image or OpenCV, in a few lines each."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from skimage.filters import threshold_li
from skimage.transform import warp_polar

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.oct.spectra.kernels import Counts
from endoct.modalities.registry import open_recording
from endoct.workbench.bench.cases.speed_jobs import Work, grey, levels_db, view_of
from endoct.workbench.bench.rivals.alignment import ecc, phase_correlation
from endoct.workbench.bench.rivals.pullback_chains import Chain, by_the_paper, by_the_textbook, unroll_by
from endoct.workbench.bench.task import Declined
from endoct.workbench.running.measured import Measured, measure_calls

MOST_ROUNDS = 1000


def literal(work: Work) -> Measured[Any]:
    """The paper's chain with scikit-image, of a few slices of a pullback, whose seconds are scaled to all."""
    if work.job != "pullback":
        raise Declined("the paper's chain unrolls pullbacks")
    return _scaled(by_the_paper, work)


def textbook(work: Work) -> Measured[Any]:
    """scipy and scikit-image at full resolution; of a pullback a few slices, whose seconds are scaled to all."""
    if work.job == "pullback":
        return _scaled(by_the_textbook, work)
    return measure_calls(_TEXTBOOK[work.job], *work.given, repeats=work.repeats)


def _scaled(chain: Chain, work: Work) -> Measured[Any]:
    (folder,) = work.given
    few = min(work.repeats, work.amount)
    measured = measure_calls(unroll_by, chain, folder, few, repeats=1)
    scale = work.amount / few
    return Measured(
        measured.answer,
        tuple(scale * s for s in measured.seconds),
        tuple(scale * s for s in measured.cpu_seconds),
        measured.peak_mb,
    )


def opencv(work: Work) -> Measured[Any]:
    """OpenCV, for the jobs that it has a function for."""
    if work.job not in _OPENCV:
        raise Declined("OpenCV has no function for this job")
    return measure_calls(_OPENCV[work.job], *work.given, repeats=work.repeats)


def reading(work: Work) -> Measured[Any]:
    """The file of a pullback read, and no more: what nobody can be faster than."""
    if work.job != "pullback":
        raise Declined("this job is in memory")
    return measure_calls(read_slices, *work.given, repeats=work.repeats)


def read_slices(folder: Path) -> int:
    """Return how many samples a pullback has, all of which are read."""
    _, stream = open_recording(folder)
    return sum(stream[index].samples.size for index in range(len(stream)))


Warp = Callable[[Image, tuple[float, float], float, tuple[int, int]], Image]
"""Warps an image around a centre (x, y), out to a radius, to (angle, radius) of a shape."""


def _polar_strips(
    frames: Sequence[Frame],
    calibration: EndoscopeCalibration,
    warp: Warp,
) -> list[tuple[Image, Mask]]:
    strips = []
    for frame in frames:
        view = view_of(calibration, frame.index)
        n_theta, n_r = view.angle_rad.size, int(np.ceil(view.rim_px)) + 1
        polar = warp(grey(frame), view.centre_px, float(n_r), (n_theta, n_r))
        rows = np.clip(np.rint(view.r_px).astype(int), 0, n_r - 1)
        columns = np.rint(view.angle_rad / (2 * np.pi) * n_theta).astype(int) % n_theta
        strips.append((polar[columns][:, rows].T, np.ones((rows.size, n_theta), np.bool_)))
    return strips


def _by_skimage(image: Image, centre_px: tuple[float, float], radius: float, shape: tuple[int, int]) -> Image:
    x, y = centre_px
    return np.asarray(warp_polar(image, (y, x), radius=radius, output_shape=shape), np.float32)


def _by_opencv(image: Image, centre_px: tuple[float, float], radius: float, shape: tuple[int, int]) -> Image:
    return np.asarray(cv2.warpPolar(image, shape[::-1], centre_px, radius, cv2.INTER_LINEAR), np.float32)


def _strips_by_skimage(frames: Sequence[Frame], calibration: EndoscopeCalibration) -> list[tuple[Image, Mask]]:
    return _polar_strips(frames, calibration, _by_skimage)


def _strips_by_opencv(frames: Sequence[Frame], calibration: EndoscopeCalibration) -> list[tuple[Image, Mask]]:
    return _polar_strips(frames, calibration, _by_opencv)


def li_by_skimage(values: Image) -> float:
    """scikit-image's, given up where it alternates between two thresholds for ever (0.26; its issue 7790)."""
    rounds = itertools.count(1)

    def stop_at_last(threshold: float) -> None:
        if next(rounds) > MOST_ROUNDS:
            raise RuntimeError(f"no end after {MOST_ROUNDS} rounds, last at {threshold:g}")

    return float(threshold_li(values, iter_callback=stop_at_last))


def _levels(spectra: Counts, places: Coordinates) -> Image:
    return levels_db(spectra, places, spectra.mean(axis=0))


_TEXTBOOK: dict[str, Callable[..., Any]] = {
    "strips": _strips_by_skimage,
    "threshold": li_by_skimage,
    "alignment": phase_correlation,
    "spectra": _levels,
}
_OPENCV: dict[str, Callable[..., Any]] = {"strips": _strips_by_opencv, "alignment": ecc}
