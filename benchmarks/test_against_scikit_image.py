"""Steps of the pipeline next to the same step with scikit-image: one group a step, the ratio in brackets."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from skimage.filters import threshold_li
from skimage.measure import ransac
from skimage.transform import warp

from endoct.base.numeric.sine import Sine, ransac_sine
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.modalities.conformance import Subject
from endoct.modalities.oct.bscan import reduce_theta, sector_angles_rad
from endoct.modalities.oct.undistort import beam_of, resample, volume_radii_mm
from endoct.modalities.registry import manifests
from endoct.synthetic.specimen import simulate

TRIALS = 200
TOLERANCE_MM = 0.02
TRUE_SINE = Sine(amplitude_mm=0.12, omega=1.0, phase_rad=0.7, offset_mm=0.45)


@pytest.fixture(scope="module")
def pullback(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    specimen = tmp_path_factory.mktemp("specimen") / "quick"
    simulate(specimen, preset="quick", seed=1000)
    return Subject(manifests()["oct"], Path(specimen) / "oct")


@pytest.mark.benchmark(group="Li's threshold, 7 million samples", max_time=3)
@pytest.mark.parametrize("method", [li_threshold, threshold_li], ids=["endoct", "scikit-image"])
def test_li(method: Callable[..., float], benchmark: BenchmarkFixture) -> None:
    rng = np.random.default_rng(0)
    relief_mm = np.where(rng.random((14_000, 512)) < 0.2, 0.4, 0.0) + rng.exponential(0.03, (14_000, 512))
    threshold = benchmark(method, relief_mm.astype(np.float32))
    assert threshold == pytest.approx(threshold_li(relief_mm[:1000]), rel=0.05)


def _points() -> tuple[np.ndarray, np.ndarray]:
    """20 000 points: half on the sine, a quarter on a fixed line, a quarter anywhere."""
    rng = np.random.default_rng(1)
    x_rad = rng.uniform(0, 2 * np.pi, 20_000)
    kind = np.maximum(rng.integers(-1, 3, x_rad.size), 0)
    y_mm = np.choose(kind, [TRUE_SINE(x_rad) + rng.normal(0, 0.005, x_rad.size), 1.1, rng.uniform(0, 2.5, x_rad.size)])
    return x_rad, y_mm


class SineModel:
    """A sine with ω = 1, as scikit-image's `ransac` wants a model."""

    def __call__(self, x_rad: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(x_rad), np.cos(x_rad), np.ones(len(x_rad))], axis=1) @ self.params

    def estimate(self, data: np.ndarray) -> bool:
        basis = np.stack([np.sin(data[:, 0]), np.cos(data[:, 0]), np.ones(len(data))], axis=1)
        self.params = np.linalg.lstsq(basis, data[:, 1])[0]
        return True

    @classmethod
    def from_estimate(cls, data: np.ndarray) -> "SineModel":
        model = cls()
        model.estimate(data)
        return model

    def residuals(self, data: np.ndarray) -> np.ndarray:
        return np.abs(data[:, 1] - self(data[:, 0]))


@pytest.mark.benchmark(group=f"RANSAC of a sine, {TRIALS} trials, 20 000 points", max_time=3)
def test_ransac_endoct(benchmark: BenchmarkFixture) -> None:
    x_rad, y_mm = _points()
    start = Sine(0.0, 1.0, 0.0, 0.8)

    def fit() -> Sine:
        rng = np.random.default_rng(2)
        return ransac_sine(x_rad, y_mm, tolerance_mm=TOLERANCE_MM, trials=TRIALS, rng=rng, start=start)[0]

    assert benchmark(fit).amplitude_mm == pytest.approx(TRUE_SINE.amplitude_mm, abs=0.005)


@pytest.mark.benchmark(group=f"RANSAC of a sine, {TRIALS} trials, 20 000 points", max_time=3)
def test_ransac_scikit_image(benchmark: BenchmarkFixture) -> None:
    data = np.stack(_points(), axis=1)

    def fit() -> SineModel:
        options = {"min_samples": 3, "residual_threshold": TOLERANCE_MM, "max_trials": TRIALS, "stop_probability": 1}
        return ransac(data, SineModel, rng=np.random.default_rng(2), **options)[0]

    p, q, _ = benchmark(fit).params
    assert np.hypot(p, q) == pytest.approx(TRUE_SINE.amplitude_mm, abs=0.005)


@pytest.mark.benchmark(group="undistorting one B-scan", max_time=3)
def test_undistort_endoct(pullback: Subject, benchmark: BenchmarkFixture) -> None:
    radii_mm = volume_radii_mm(pullback.calibration)
    assert benchmark(resample, pullback.stream[20], pullback.calibration, radii_mm).shape[1] == radii_mm.size


@pytest.mark.benchmark(group="undistorting one B-scan", max_time=3)
def test_undistort_scikit_image(pullback: Subject, benchmark: BenchmarkFixture) -> None:
    calibration, frame = pullback.calibration, pullback.stream[20]
    grid, radii_mm = calibration.grid, volume_radii_mm(calibration)

    def undistort() -> np.ndarray:
        image = reduce_theta(frame.samples, grid.n_theta)
        angle, depth_mm = beam_of(calibration, frame.index, grid.theta_rad[:, None], radii_mm[None, :])
        first = sector_angles_rad(frame.samples.shape[0], grid.n_theta)[0]
        column = np.mod((angle - first) / grid.dtheta_rad, grid.n_theta)
        places = np.stack([np.broadcast_to(column, depth_mm.shape), depth_mm / calibration.mm_per_px])
        return warp(np.concatenate([image, image[:1]]), places, order=1, cval=np.nan, preserve_range=True)

    ours, theirs = resample(frame, calibration, radii_mm), benchmark(undistort)
    both = np.isfinite(ours) & np.isfinite(theirs)
    assert both.mean() > 0.5
    assert np.median(np.abs(ours - theirs)[both]) < 1.0
