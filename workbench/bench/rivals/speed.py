"""The jobs of the task "speed" as one would do them with scipy, scikit-image or OpenCV, in a few lines each."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from skimage.exposure import equalize_adapthist
from skimage.filters import threshold_li, threshold_local
from skimage.measure import ransac
from skimage.restoration import denoise_wavelet
from skimage.transform import warp_polar

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.spectra.reconstruction import Counts
from endoct.modalities.recognition import open_recording
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import per_frame
from endoct.workbench.bench.cases.speed_jobs import Work, grey, levels_db, view_of
from endoct.workbench.bench.rivals.alignment import ecc, phase_correlation
from endoct.workbench.bench.task import Declined
from endoct.workbench.running.measured import Measured, measure_calls

MOST_ROUNDS = 1000
Chain = Callable[[Any], tuple[Image, Image]]
"""It takes a B-scan (A-scan, depth), and returns the depth behind the face, px, and the wall's brightness by A-scan."""
MEDIAN = 3
TRIALS = 200
TOLERANCE_PX = 3.0
BEHIND_PX = 6
"""The face is blurred: what lies nearer behind it is the face itself."""
BLOCK = 51
CONTRAST = 0.3
"""A pixel on a line is brighter than its surroundings by this part of full scale."""
Warp = Callable[[Image, tuple[float, float], float, tuple[int, int]], Image]
"""Warps an image around a centre (x, y), out to a radius, to (angle, radius) of a shape."""


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
    seconds, cpu_seconds = (
        tuple(work.amount / few * s for s in each) for each in (measured.seconds, measured.cpu_seconds)
    )
    return replace(measured, seconds=seconds, cpu_seconds=cpu_seconds)


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


def _polar_strips(frames: Sequence[Frame], calibration: EndoscopeCalibration, warp: Warp) -> list[tuple[Image, Mask]]:
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
    "strips": partial(_polar_strips, warp=_by_skimage),
    "threshold": li_by_skimage,
    "alignment": phase_correlation,
    "spectra": _levels,
}
_OPENCV: dict[str, Callable[..., Any]] = {"strips": partial(_polar_strips, warp=_by_opencv), "alignment": ecc}


def by_the_paper(bscan: Any) -> tuple[Image, Image]:
    """Unroll a B-scan as Laves 2019 (Image undistortion) says, each step by the function scikit-image has for it.

    Wavelets take the noise away, contrast is equalised, and a local threshold leaves lines. RANSAC fits a sine to
    every pixel that is not zero. The image is moved by the sine's inverse, cropped behind it, and projected.
    """
    image = bscan.astype(np.float32) / max(float(bscan.max()), 1.0)
    enhanced = equalize_adapthist(np.clip(denoise_wavelet(image), 0, 1))
    ascan, depth = np.nonzero(enhanced > threshold_local(enhanced, BLOCK, offset=-CONTRAST))
    return _behind_face(image, _angles(len(image))[ascan], depth)


def by_the_textbook(bscan: Any) -> tuple[Image, Image]:
    """Unroll a B-scan the short way: a median filter, and a sine through the strongest rise of each A-scan."""
    image = ndimage.median_filter(bscan, MEDIAN).astype(np.float32)
    rise = np.argmax(ndimage.gaussian_filter1d(image, 2.0, axis=1, order=1), axis=1)
    return _behind_face(image, _angles(len(image)), rise)


def unroll_by(chain: Chain, folder: Path, few: int) -> Panorama:
    """Return the first ``few`` slices of a pullback unrolled by ``chain``, at every A-scan."""
    _, stream = open_recording(folder)
    acquisition = stream.acquisition
    if not isinstance(acquisition, OctAcquisition):
        raise TypeError(acquisition)
    frames = [stream[index] for index in range(few)]
    rows = [chain(frame.samples) for frame in frames]
    depth_mm = np.stack([depth_px for depth_px, _ in rows]) * acquisition.mm_per_px
    z_mm, valid = np.array([frame.z_mm for frame in frames]), np.ones(depth_mm.shape, np.bool_)
    order = np.argsort(z_mm)
    grid = SurfaceGrid.full_circle(
        few,
        depth_mm.shape[1],
        z0_mm=float(z_mm.min()),
        dz_mm=acquisition.pullback_pitch_mm,
        radius_mm=acquisition.bore_radius_mm,
    )
    return Panorama(
        grid=grid,
        intensity=np.stack([brightest for _, brightest in rows])[order],
        depth_mm=depth_mm[order],
        valid=valid,
        weight=valid.astype(np.float32),
        modality="oct",
        handedness_known=False,
        travel_known=False,
        frame_dim="slice",
        per_frame=per_frame({"slice_index": np.arange(few)[order], "slice_z_mm": z_mm[order]}, {}),
        provenance={"acquisition": acquisition.model_dump(mode="json", exclude_none=True)},
    )


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


def _angles(n_ascans: int) -> Coordinates:
    return np.asarray(2 * np.pi / n_ascans * np.arange(n_ascans))


def _behind_face(image: Image, theta_rad: Coordinates, depth_px: Any) -> tuple[Image, Image]:
    """Return how far behind a sine through points the brightest sample of each A-scan lies, px, and its brightness."""
    n_ascans, n_depth = image.shape
    points = np.stack([theta_rad, depth_px], axis=1)
    options = {"min_samples": 3, "residual_threshold": TOLERANCE_PX, "max_trials": TRIALS, "stop_probability": 1}
    model, _ = ransac(points, _Sine, rng=np.random.default_rng(0), **options)
    face = _basis(_angles(n_ascans)) @ model.params
    depth = np.arange(BEHIND_PX, n_depth)
    places = np.broadcast_arrays(np.arange(n_ascans)[:, np.newaxis], face[:, np.newaxis] + depth)
    level = ndimage.map_coordinates(image, places, order=1, cval=0.0)
    brightest = np.argmax(level, axis=1)
    return depth[brightest].astype(np.float32), np.asarray(level[np.arange(n_ascans), brightest], np.float32)
