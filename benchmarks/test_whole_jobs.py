"""Whole jobs of the sizes that rigs record, next to the same job by scikit-image or OpenCV: the ratio in brackets.

Everything runs once untimed, but for the paper's chain, which takes a minute. Answers are held against each other, or
against the truth.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pytest_benchmark.fixture import BenchmarkFixture
from scipy import ndimage
from skimage.exposure import equalize_adapthist
from skimage.filters import threshold_local
from skimage.measure import ransac
from skimage.restoration import denoise_wavelet
from skimage.transform import warp_polar

from benchmarks.test_against_scikit_image import SineModel
from benchmarks.unroll_memory import write_recording
from endoct.modalities.conformance import Subject
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.unroll import unroll_frame
from endoct.modalities.recognition import open_recording
from endoct.modalities.registry import manifests
from endoct.synthetic.specimen import simulate
from endoct.workbench import unroll
from endoct.workbench.bench.rivals.alignment import ecc, phase_correlation
from endoct.workbench.bench.tasks import alignment

SLICES, ASCANS = 20, 14_000
FRAMES = 20
TRIALS, TOLERANCE_PX = 200, 3.0
BEHIND_PX = 6
"""The capillary's face is blurred: what lies nearer behind it is the face itself."""
Warp = Callable[[NDArray[np.float32], tuple[float, float], int, tuple[int, int]], NDArray[Any]]
"""Warps an image around a centre (x, y), out to a radius, to (angle, radius) of a shape."""


def job(name: str) -> Callable[..., Any]:
    return pytest.mark.benchmark(group=name)


@pytest.fixture(scope="module")
def specimen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("jobs") / "quick"
    simulate(folder, preset="quick", seed=1000)
    return folder


@pytest.fixture(scope="module")
def pullback(specimen: Path) -> Path:
    write_recording(specimen, "oct", SLICES, ASCANS, specimen.parent / "pullback")
    return specimen.parent / "pullback"


@job(f"a pullback of {SLICES} slices × {ASCANS} A-scans unrolled")
def test_pullback_endoct(pullback: Path, benchmark: BenchmarkFixture) -> None:
    panorama = benchmark.pedantic(unroll, (pullback,), {"progress": False}, rounds=3, warmup_rounds=1)
    assert panorama.grid.n_z == SLICES


def by_the_paper(bscan: NDArray[Any]) -> NDArray[np.intp]:
    """As Laves 2019 says, each step by scikit-image's function: wavelets, contrast, a local threshold, a sine."""
    image = bscan.astype(np.float32) / float(bscan.max())
    enhanced = equalize_adapthist(np.clip(denoise_wavelet(image), 0, 1))
    return behind_face(image, *np.nonzero(enhanced > threshold_local(enhanced, 51, offset=-0.3)))


def by_the_textbook(bscan: NDArray[Any]) -> NDArray[np.intp]:
    """The short way: a median filter, and a sine through the strongest rise of each A-scan."""
    image = ndimage.median_filter(bscan, 3).astype(np.float32)
    rise = np.argmax(ndimage.gaussian_filter1d(image, 2.0, axis=1, order=1), axis=1)
    return behind_face(image, np.arange(len(image)), rise)


def behind_face(image: NDArray[np.float32], ascan: NDArray[Any], depth: NDArray[Any]) -> NDArray[np.intp]:
    """Return how far behind a sine through points the brightest sample of each A-scan lies, px."""
    points = np.stack([2 * np.pi / len(image) * ascan, depth], axis=1)
    options = {"min_samples": 3, "residual_threshold": TOLERANCE_PX, "max_trials": TRIALS, "stop_probability": 1}
    model, _ = ransac(points, SineModel, rng=np.random.default_rng(0), **options)
    face = model(2 * np.pi / len(image) * np.arange(len(image)))
    behind = np.arange(BEHIND_PX, image.shape[1])
    places = np.broadcast_arrays(np.arange(len(image))[:, np.newaxis], face[:, np.newaxis] + behind)
    return np.asarray(behind[np.argmax(ndimage.map_coordinates(image, places, order=1), axis=1)])


@job(f"a pullback of {SLICES} slices × {ASCANS} A-scans unrolled")
@pytest.mark.parametrize("chain", [by_the_paper, by_the_textbook])
def test_pullback_plainly(
    chain: Callable[[NDArray[Any]], NDArray[np.intp]], pullback: Path, benchmark: BenchmarkFixture
) -> None:
    _, stream = open_recording(pullback)
    rows = benchmark.pedantic(lambda: [chain(stream[k].samples) for k in range(len(stream))])
    assert np.shape(rows) == (SLICES, ASCANS)


@pytest.fixture(scope="module")
def endoscope(specimen: Path) -> Subject:
    return Subject(manifests()["endoscope"], specimen / "endoscope")


@pytest.fixture(scope="module")
def frames(endoscope: Subject) -> list[Frame]:
    return [endoscope.stream[k] for k in range(FRAMES)]


def strips_by(warp: Warp, frames: list[Frame], c: EndoscopeCalibration) -> list[NDArray[Any]]:
    """Return the rows and columns that endoct's strips have of frames warped around the mirror's outer rim."""
    strips = []
    for frame in frames:
        annulus = c.annuli[frame.index].with_drift(*c.drift_px).moved(*c.shift_px)
        half_mm, z_mm = float(c.strip_z_mm[-1]), float(c.z_mm[frame.index])
        first, last = np.searchsorted(c.row_z_mm, [z_mm - half_mm, z_mm + half_mm])
        rows_px = np.rint(c.optics.r_px(c.row_z_mm[first:last] - z_mm)).astype(int)
        n_theta, n_r = c.grid.n_theta, int(np.ceil(annulus.outer_px)) + 1
        grey = np.asarray(frame.samples, np.float32)
        grey = grey.mean(axis=2) if grey.ndim == 3 else grey
        polar = warp(grey, (annulus.outer_x_px, annulus.outer_y_px), n_r, (n_theta, n_r))
        angle = np.rint(c.image_angle(frame.index, c.grid.theta_rad) / (2 * np.pi) * n_theta).astype(int)
        strips.append(polar[angle % n_theta][:, np.clip(rows_px, 0, n_r - 1)].T)
    return strips


def skimage(image: NDArray[np.float32], centre: tuple[float, float], r: int, shape: tuple[int, int]) -> NDArray[Any]:
    return np.asarray(warp_polar(image, centre[::-1], radius=r, output_shape=shape))


def opencv(image: NDArray[np.float32], centre: tuple[float, float], r: int, shape: tuple[int, int]) -> NDArray[Any]:
    return cv2.warpPolar(image, shape[::-1], centre, r, cv2.INTER_LINEAR)


@job(f"strips of {FRAMES} frames in memory")
def test_strips_endoct(endoscope: Subject, frames: list[Frame], benchmark: BenchmarkFixture) -> None:
    assert len(benchmark(lambda: [unroll_frame(frame, endoscope.calibration) for frame in frames])) == FRAMES


@job(f"strips of {FRAMES} frames in memory")
@pytest.mark.parametrize("warp", [skimage, opencv])
def test_strips_plainly(warp: Warp, endoscope: Subject, frames: list[Frame], benchmark: BenchmarkFixture) -> None:
    theirs = benchmark(strips_by, warp, frames, endoscope.calibration)[3]
    ours = unroll_frame(frames[3], endoscope.calibration)
    wall = ours.valid & (theirs > 0)  # endoct's is divided by the light, which varies from row to row
    levelled = [np.log(np.where(wall, strip, 1)) for strip in (ours.intensity, theirs)]
    levelled = [strip - strip.sum(axis=1, keepdims=True) / wall.sum(axis=1, keepdims=True) for strip in levelled]
    assert np.corrcoef(levelled[0][wall], levelled[1][wall])[0, 1] > 0.8


@job("two panoramas of 2048 × 1024 aligned")
@pytest.mark.parametrize("method", [alignment.ours, ecc, phase_correlation])
def test_alignment(method: Callable[..., Any], benchmark: BenchmarkFixture) -> None:
    case = alignment.cases(1000, 0, alignment.RANGES)
    place = benchmark.pedantic(method, case.given, rounds=3, warmup_rounds=1)
    if method is alignment.ours:
        assert alignment.judge(case, place)["landmark_px"] < alignment.SUCCESS_PX
