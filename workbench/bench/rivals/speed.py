"""The jobs of the task "speed" as one would do them with scipy, scikit-image or OpenCV, in a few lines each."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from skimage.filters import threshold_li
from skimage.measure import ransac
from skimage.transform import warp_polar

from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.spectra.kernels import Counts
from endoct.modalities.registry import open_recording
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import per_frame
from endoct.workbench.bench.cases.speed_jobs import Work, grey, levels_db, view_of
from endoct.workbench.bench.rivals.alignment import ecc, phase_correlation
from endoct.workbench.bench.task import Declined
from endoct.workbench.running.measured import Measured, measure_calls

MEDIAN = 3
TRIALS = 200
TOLERANCE_PX = 3.0
BEHIND_PX = 6
"""The face is blurred: what lies nearer behind it is the face itself."""
MOST_ROUNDS = 1000


def textbook(work: Work) -> Measured[Any]:
    """scipy and scikit-image at full resolution; of a pullback a few slices, whose seconds are scaled to all."""
    if work.job == "pullback":
        (folder,) = work.given
        few = min(work.repeats, work.amount)
        measured = measure_calls(unroll_literally, folder, few, repeats=1)
        scale = work.amount / few
        return Measured(
            measured.answer,
            tuple(scale * s for s in measured.seconds),
            tuple(scale * s for s in measured.cpu_seconds),
            measured.peak_mb,
        )
    return measure_calls(_TEXTBOOK[work.job], *work.given, repeats=work.repeats)


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


def unroll_literally(folder: Path, few: int) -> Panorama:
    """Return the first ``few`` slices unrolled by the chain of Laves 2019, taken literally, at every A-scan.

    A median filter, the capillary's face as a sine through the strongest rise of every A-scan by RANSAC, every A-scan
    moved by where that lies, and behind it the brightest sample.
    """
    _, stream = open_recording(folder)
    acquisition = stream.acquisition
    if not isinstance(acquisition, OctAcquisition):
        raise TypeError(acquisition)
    frames = [stream[index] for index in range(few)]
    rows = [_behind_face(frame.samples) for frame in frames]
    depth_mm = np.stack([depth_px for depth_px, _ in rows]) * acquisition.mm_per_px
    z_mm = np.array([frame.z_mm for frame in frames])
    order = np.argsort(z_mm)
    grid = SurfaceGrid.full_circle(
        few,
        depth_mm.shape[1],
        z0_mm=float(z_mm.min()),
        dz_mm=acquisition.pullback_pitch_mm,
        radius_mm=acquisition.bore_radius_mm,
    )
    valid = np.ones(depth_mm.shape, np.bool_)
    return Panorama(
        grid,
        np.stack([brightest for _, brightest in rows])[order],
        depth_mm[order],
        valid,
        valid.astype(np.float32),
        "oct",
        False,
        False,
        frame_dim="slice",
        per_frame=per_frame({"slice_index": np.arange(few)[order], "slice_z_mm": z_mm[order]}, {}),
        provenance={"acquisition": acquisition.model_dump(mode="json", exclude_none=True)},
    )


Warp = Callable[[Image, tuple[float, float], float, tuple[int, int]], Image]
"""Warps an image around a centre (x, y), out to a radius, to (angle, radius) of a shape."""


class _Sine:
    """A sine once around, as scikit-image's `ransac` wants a model."""

    @classmethod
    def from_estimate(cls, data: Coordinates) -> "_Sine":
        model = cls()
        model.estimate(data)
        return model

    def estimate(self, data: Coordinates) -> bool:
        self.params = np.linalg.lstsq(_basis(data[:, 0]), data[:, 1])[0]
        return True

    def residuals(self, data: Coordinates) -> Coordinates:
        return np.asarray(np.abs(data[:, 1] - _basis(data[:, 0]) @ self.params))


def _basis(theta_rad: Coordinates) -> Coordinates:
    return np.stack([np.sin(theta_rad), np.cos(theta_rad), np.ones(theta_rad.size)], axis=1)


def _behind_face(bscan: Any) -> tuple[Image, Image]:
    """Return how far behind the face the brightest sample of each A-scan lies, px, and its brightness."""
    image = ndimage.median_filter(bscan, MEDIAN).astype(np.float32)
    n_ascans, n_depth = image.shape
    theta_rad = 2 * np.pi / n_ascans * np.arange(n_ascans)
    rise = np.argmax(ndimage.gaussian_filter1d(image, 2.0, axis=1, order=1), axis=1)
    points = np.stack([theta_rad, rise], axis=1)
    options = {"min_samples": 3, "residual_threshold": TOLERANCE_PX, "max_trials": TRIALS, "stop_probability": 1}
    model, _ = ransac(points, _Sine, rng=np.random.default_rng(0), **options)
    face = _basis(theta_rad) @ model.params
    depth = np.arange(BEHIND_PX, n_depth)
    places = np.broadcast_arrays(np.arange(n_ascans)[:, np.newaxis], face[:, np.newaxis] + depth)
    level = ndimage.map_coordinates(image, places, order=1, cval=0.0)
    brightest = np.argmax(level, axis=1)
    return depth[brightest].astype(np.float32), np.asarray(level[np.arange(n_ascans), brightest], np.float32)


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
