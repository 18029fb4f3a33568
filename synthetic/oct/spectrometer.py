"""The spectrometer: from the complex field of an A-scan to counts of its detector, and back to depth.

Sample m of a spectrum, 0 ≤ m < n, is at even steps of the wavenumber. A reflector's path is longer than the reference's
by x axial pixels. It returns the field E(m) = a·exp(2πi(m − (n − 1)/2)·x/n), a relative to that of the reference. The
detector counts R(m)·|1 + E(m)|²: reference, fringes, their mirror image and the autocorrelation of
what returns. The carrier, exp(2i·k₀·path), is left out: it turns faster than A-scans can follow, and no magnitude
shows it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import bell

FULL_SCALE = 4095  # 12 bits
CHIRP = np.polynomial.Polynomial([-0.48, 1.25467, -2.017e-4, -4.6e-8])
"""Pixel p of the detector records the spectrum at m = CHIRP(p): a fit to the vectors of the rig, see its facts."""
LOG_BIAS_DB = 2.5068
"""The mean logarithm of an exponential is 10·γ/ln 10 dB under the logarithm of its mean."""
BAND_LAGS = (1, 5, 13)
"""Noise comes again after so many samples: half a wave over the depth, two and a half, and six and a half."""
BLOCK = 128
"""Number of A-scans that fit the cache."""


@dataclass(frozen=True, eq=False)
class Spectrometer:
    """What the detector counts and how that is scaled; n = ``window``.size samples a spectrum.

    ``sigma``: of the Gaussian spectrum, samples (infinite: flat). ``peak_counts``: of the reference alone.
    ``noise_counts2``: variance of the noise per count of reference, counts². ``unit``: relative amplitude of a
    reflector at 0 dB, the level of the mean noise. ``bone_unit2``: |a|² of white scatterers, one for each axial
    pixel, that together show at 0 dB. ``echoes``: which share of the noise comes again after each of ``BAND_LAGS``
    samples, which makes bands over depth of it.
    """

    window: Coordinates
    sigma: float
    peak_counts: float
    noise_counts2: float
    unit: float
    bone_unit2: float
    echoes: tuple[float, ...] = ()

    def reference(self, m: Coordinates) -> Coordinates:
        """Return the counts of the reference alone at samples ``m``."""
        counts: Coordinates = self.peak_counts * _gaussian(m - (self.window.size - 1) / 2, self.sigma)
        return counts


def _gaussian(x: Coordinates, sigma: float) -> Coordinates:
    shape: Coordinates = np.exp(-0.5 * (x / sigma) ** 2)
    return shape


def axial_fwhm_px(shape: Coordinates) -> float:
    """Return the full width at half maximum, in axial pixels, of the intensity that the spectrum ``shape`` gives."""
    finer = 64
    half = np.abs(fft.rfft(shape, finer * shape.size)[: 8 * finer]) ** 2
    beyond = int(np.argmax(half < half[0] / 2))
    share = (half[beyond - 1] - half[0] / 2) / (half[beyond - 1] - half[beyond])
    return float(2 * (beyond - 1 + share) / finer)


def spectrometer(oct_: Oct, n: int) -> Spectrometer:
    """Return the spectrometer of ``oct_`` with ``n`` samples a spectrum.

    Its spectrum is as narrow as the axial resolution after a Hann window says; flat where even that is too wide.
    """
    window: Coordinates = np.hanning(n)
    centred = np.arange(n, dtype=np.float64) - (n - 1) / 2
    sigma = _sigma(oct_.axial_resolution_mm / oct_.axial_pixel_mm, n)
    excess = 10 ** (oct_.excess_noise_db / 10) / oct_.electrons_per_count
    reference = oct_.reference_counts * _gaussian(centred, sigma)
    coherent = float(np.sum(reference * window))
    noise = float(np.sum(window**2 * (excess * reference + 1 / 12)))  # the last is that of rounding
    return Spectrometer(
        window=window,
        sigma=sigma,
        peak_counts=oct_.reference_counts,
        noise_counts2=excess,
        unit=float(np.sqrt(noise)) / coherent,
        bone_unit2=noise / (n * float(np.sum((reference * window) ** 2))),
        echoes=_echoes(oct_.floor_bands_db, oct_.floor_bands, n),
    )


def floor(echoes: Sequence[float], depth_px: Coordinates, n: int) -> Coordinates:
    """Return the level of the noise at ``depth_px``, as a power, 1 in the mean."""
    turned = 2 * np.pi / n * np.multiply.outer(depth_px, BAND_LAGS[: len(echoes)])
    share = np.array(echoes)
    power: Coordinates = np.abs(1 + np.exp(1j * turned) @ share) ** 2 / (1 + np.sum(share**2))
    return power


@lru_cache(maxsize=16)
def _echoes(bands_db: float, weights: tuple[float, ...], n: int) -> tuple[float, ...]:
    """Return the shares of echoes, in proportion to their weights, that cause this difference over depth."""
    if not bands_db or not any(weights):
        return ()
    depth_px, low, high = np.arange(n / 2), 0.0, 1 / sum(map(abs, weights))
    for _ in range(30):
        scale = (low + high) / 2
        power = floor([scale * weight for weight in weights], depth_px, n)
        low, high = (scale, high) if 10 * np.log10(power.max() / power.min()) < bands_db else (low, scale)
    return tuple(low * weight for weight in weights)


@lru_cache(maxsize=16)
def _sigma(fwhm_px: float, n: int) -> float:
    """Return the Gaussian spectrum that after a Hann window gives this axial resolution; infinite if none does."""
    window: Coordinates = np.hanning(n)
    centred = np.arange(n, dtype=np.float64) - (n - 1) / 2
    if fwhm_px <= axial_fwhm_px(window):
        return math.inf
    narrow, wide = 0.01 * n, 20.0 * n
    for _ in range(40):
        sigma = math.sqrt(narrow * wide)
        if axial_fwhm_px(window * _gaussian(centred, sigma)) > fwhm_px:
            narrow = sigma
        else:
            wide = sigma
    return sigma


def roll_off(oct_: Oct, delay_px: Coordinates, n: int) -> Coordinates:
    """Return the amplitude left at a path difference of ``delay_px`` (any sign) axial pixels.

    A pixel's width gives sinc(x/n), 3.9 dB at full depth x = n/2; its blur a Gaussian, the rest of ``roll_off_db``.
    """
    blur_db = max(0.0, oct_.roll_off_db + 20 * np.log10(np.sinc(0.5)))
    amplitude: Coordinates = np.abs(np.sinc(delay_px / n)) * 10 ** (-blur_db * (2 * delay_px / n) ** 2 / 20)
    return amplitude


def centred(bins: NDArray[np.intp]) -> Coordinates:
    """Return the signs that make scatterers in axial pixels ``bins`` refer to the middle of the spectrum.

    There they must vary smoothly with place, so that they can be interpolated, and not at its first sample.
    """
    sign: Coordinates = np.where(bins % 2, -1.0, 1.0)
    return sign


def chirp(n: int) -> Coordinates:
    """Return m of every pixel of the detector: pixel p records the spectrum at sample m = chirp(n)[p].

    Float64 (n,), rising; scaled from 1024. To resample is to interpolate the recorded values, which lie at
    ``chirp(n)``, at 0, 1, … n − 1.
    """
    m: Coordinates = CHIRP(np.arange(n) * (1024 / n)) * (n / 1024)
    return m


def dark_counts(rng: Generator, oct_: Oct, n: int) -> Coordinates:
    """Return what each of ``n`` pixels counts in the dark: an offset and a fixed pattern."""
    return oct_.dark_counts + oct_.dark_pattern_counts * rng.standard_normal(n)


def counts(instrument: Spectrometer, m: Coordinates, field: NDArray[np.complex64]) -> Image:
    """Return what the detector counts on average, float32 (A-scan, sample), of a field at samples ``m``."""
    reference = instrument.reference(m).astype(np.float32)
    total = field.real + np.float32(1)
    total *= total
    total += field.imag * field.imag
    total *= reference
    return total


def digitised(
    rng: Generator, instrument: Spectrometer, m: Coordinates, mean_counts: Image, dark: Coordinates
) -> NDArray[np.uint16]:
    """Return noisy u16 samples of 12 bits, clipped at the top.

    The noise is that of the reference, ``excess_noise_db`` over its shot noise, as hardly any light else arrives.
    """
    sigma = np.sqrt(instrument.noise_counts2 * instrument.reference(m)).astype(np.float32)
    noisy = bell(rng, mean_counts.size).reshape(mean_counts.shape)
    noisy = _banded(noisy, instrument.echoes)
    noisy *= sigma
    noisy += mean_counts
    noisy += dark.astype(np.float32) + np.float32(0.5)  # rounds
    np.clip(noisy, 0, FULL_SCALE, out=noisy)
    return noisy.astype(np.uint16)


def _banded(noise: Image, echoes: Sequence[float]) -> Image:
    """Return white ``noise`` (A-scan, n) with its echoes, of the same power."""
    if not echoes:
        return noise
    power = 1 + sum(share**2 for share in echoes)
    banded: Image = noise * np.float32(power**-0.5)
    for lag, share in zip(BAND_LAGS, echoes, strict=False):
        part = share * power**-0.5
        for late, early in ((banded[:, lag:], noise[:, :-lag]), (banded[:, :lag], noise[:, -lag:])):
            cv2.scaleAdd(early, part, late, late)
    return banded


def reconstruct(oct_: Oct, instrument: Spectrometer, spectra: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return the B-scan of spectra (A-scan, n) at even wavenumbers: u8 (n/2, A-scan), logarithmic.

    Minus the mean over A-scans (which holds the offset), Hann, FFT, half of it, squared magnitude, logarithm.
    """
    mean = (np.sum(spectra, axis=0, dtype=np.uint64) / spectra.shape[0]).astype(np.float32)
    return logarithmic(oct_, instrument, spectra, mean)


def logarithmic(
    oct_: Oct, instrument: Spectrometer, spectra: NDArray[np.uint16] | Image, background: Image
) -> NDArray[np.uint8]:
    """Return the same with a given background (n,) in counts."""
    n_ascans, n = spectra.shape
    samples = np.empty((n // 2, n_ascans), np.uint8)
    coherent = float(np.sum(instrument.reference(np.arange(n, dtype=np.float64)) * instrument.window))
    window = (instrument.window / (instrument.unit * coherent)).astype(np.float32)
    scale, floor = 10 / math.log(10) / oct_.db_per_count, oct_.floor_count + LOG_BIAS_DB / oct_.db_per_count
    for first in range(0, n_ascans, BLOCK):
        fringes = spectra[first : first + BLOCK].astype(np.float32)
        fringes -= background
        fringes *= window
        # a row holds the real part of 0, then real and imaginary parts of 1, 2, …
        parts = np.asarray(cv2.dft(fringes, flags=cv2.DFT_ROWS), dtype=np.float32)
        parts *= parts
        power = np.empty((parts.shape[0], n // 2), np.float32)
        power[:, 0] = parts[:, 0]
        np.add(parts[:, 1:-1:2], parts[:, 2::2], out=power[:, 1:])
        level = cv2.log(np.maximum(power, np.float32(1e-12), out=power), power)
        # rounds, and clips to what 8 bits hold
        stored = cv2.addWeighted(level, scale, level, 0, floor, dtype=cv2.CV_8U)
        samples[:, first : first + BLOCK] = cv2.transpose(stored)
    return samples
