"""Raw spectra to a B-scan of 14 000 A-scans × 1024 samples, step by step, next to NumPy and SciPy.

Times are of one processor: what a single thread spends, not the clock on the wall.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pytest_benchmark.fixture import BenchmarkFixture
from scipy import fft
from scipy.interpolate import CubicSpline

from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.reconstruction import (
    BLOCK,
    LINE,
    Reconstruction,
    mean_spectrum,
    reconstruction,
    resample,
    sample_places,
    taps,
    window,
    write_levels,
)
from endoct.synthetic.oct.spectrometer import chirp

ASCANS, N = 14_000, 1024
EVEN = np.arange(N, dtype=np.float64)
CHIRP = chirp(N)
Spectra = NDArray[np.uint16]


def step(name: str) -> Callable[..., Any]:
    return pytest.mark.benchmark(group=name, timer=time.process_time, max_time=1, min_rounds=3, warmup=True)


@pytest.fixture(scope="module")
def spectra() -> Iterator[Spectra]:
    """A wall of ten reflectors in noise, 12 bits."""
    rng = np.random.default_rng(0)
    counts = rng.normal(2000, 20, (ASCANS, N)).astype(np.float32)
    for depth_px in rng.uniform(60, 300, 10):
        phase = rng.uniform(0, 2 * np.pi, (ASCANS, 1)).astype(np.float32)
        counts += 30 * np.cos((2 * np.pi / N * depth_px * CHIRP).astype(np.float32) + phase)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield counts.round().astype(np.uint16)
    cv2.setNumThreads(threads)


@pytest.fixture(scope="module")
def chain() -> Reconstruction:
    places = sample_places(CHIRP, "wavenumber")
    return reconstruction(taps(places, "cubic"), window("hann", places))


@pytest.fixture(scope="module")
def fringes(spectra: Spectra) -> NDArray[np.float32]:
    return np.asarray((spectra - spectra.mean(axis=0)) * np.hanning(N), dtype=np.float32)


def interp_each(spectra: Spectra) -> NDArray[np.float64]:
    """As the rig's own chain: less the mean, ``numpy.interp`` A-scan by A-scan, Hann."""
    less = spectra - spectra.mean(axis=0)
    return np.stack([np.interp(EVEN, CHIRP, ascan) for ascan in less]) * np.hanning(N)


def spline_all(spectra: Spectra) -> NDArray[np.float64]:
    """The same with SciPy's cubic splines, all A-scans in one call."""
    return np.asarray(CubicSpline(CHIRP, spectra - spectra.mean(axis=0), axis=1)(EVEN) * np.hanning(N))


def level_all(spectrum: NDArray[Any]) -> NDArray[np.float64]:
    power = spectrum.real**2 + spectrum.imag**2
    return np.asarray(10 * np.log10(np.maximum(power, 1e-12)))


@step("background, even wavenumbers and window")
def test_resample_endoct(spectra: Spectra, chain: Reconstruction, benchmark: BenchmarkFixture) -> None:
    beside, even = np.empty((N, BLOCK), np.uint16), np.empty((N, BLOCK), np.float32)
    out = np.empty((BLOCK, N + LINE), np.float32)[:, :N]

    def all_blocks() -> None:
        background = chain._resampled(mean_spectrum(spectra))
        for start in range(0, ASCANS - BLOCK + 1, BLOCK):
            cv2.transpose(spectra[start : start + BLOCK], beside)
            resample(beside, chain.first, chain.weights, background, even)
            cv2.transpose(even, out)

    benchmark(all_blocks)


@step("background, even wavenumbers and window")
@pytest.mark.parametrize("method", [interp_each, spline_all], ids=["numpy.interp", "scipy.CubicSpline"])
def test_resample_plainly(method: Callable[..., Any], spectra: Spectra, benchmark: BenchmarkFixture) -> None:
    benchmark(method, spectra)


def _opencv(fringes: NDArray[np.float32]) -> None:
    """One block again and again, from the cache, where the step before left it."""
    block, out = np.ascontiguousarray(fringes[:BLOCK]), np.empty((BLOCK, N), np.float32)
    for _ in range(ASCANS // BLOCK):
        cv2.dft(block, out, cv2.DFT_ROWS)


def _scipy_blocks(fringes: NDArray[np.float32]) -> None:
    block = np.ascontiguousarray(fringes[:BLOCK])
    for _ in range(ASCANS // BLOCK):
        fft.rfft(block, workers=1)


@step("Fourier")
@pytest.mark.parametrize(
    "method",
    [_opencv, _scipy_blocks, lambda fringes: fft.rfft(fringes, workers=1), np.fft.rfft],
    ids=["endoct", "scipy in blocks", "scipy", "numpy"],
)
def test_fourier(method: Callable[..., Any], fringes: NDArray[np.float32], benchmark: BenchmarkFixture) -> None:
    benchmark(method, fringes)


@step("level")
def test_level_endoct(fringes: NDArray[np.float32], chain: Reconstruction, benchmark: BenchmarkFixture) -> None:
    parts, power = np.ascontiguousarray(fringes[:BLOCK]), np.empty(N // 2, np.float32)
    counts = np.empty((ASCANS, N // 2), np.uint16)

    def all_blocks() -> None:
        for start in range(0, ASCANS - BLOCK + 1, BLOCK):
            write_levels(parts, chain.gain, power, counts[start : start + BLOCK])

    benchmark(all_blocks)


@step("level")
def test_level_numpy(fringes: NDArray[np.float32], benchmark: BenchmarkFixture) -> None:
    benchmark(level_all, fft.rfft(fringes)[:, : N // 2])


@step("raw spectra to a B-scan")
def test_bscan_endoct(spectra: Spectra, chain: Reconstruction, benchmark: BenchmarkFixture) -> None:
    assert benchmark(chain.bscan, spectra).shape == (ASCANS, N // 2)


@step("raw spectra to a B-scan")
@pytest.mark.parametrize("method", [interp_each, spline_all], ids=["numpy.interp", "scipy.CubicSpline"])
def test_bscan_plainly(
    method: Callable[..., Any], spectra: Spectra, chain: Reconstruction, benchmark: BenchmarkFixture
) -> None:
    def bscan() -> NDArray[np.float64]:
        return level_all(np.fft.rfft(method(spectra) * (2 / np.hanning(N).sum()))[:, : N // 2])

    theirs = benchmark(bscan)
    ours = chain.bscan(spectra) / COUNTS_PER_DB + ZERO_DB
    bright = theirs[:, :300] > 20
    assert np.corrcoef(ours[:, :300][bright], theirs[:, :300][bright])[0, 1] > 0.95
