"""From the counts of a detector to a B-scan: less the background, at even wavenumbers, window, dispersion, Fourier.

Samples lie at uneven wavenumbers. Taps say which of them are read for an even one, and with which weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, LEAST_ASCANS, ZERO_DB

Interpolation = Literal["sinc", "cubic", "linear"]
N_TAPS = {"sinc": 8, "cubic": 4, "linear": 4}
KAISER_BETA = 5.0
"""The window over a sinc of 8 samples has this β. It ends where waves of 0.7 of the depth range are still whole."""
COSINES = {"hann": (0.5, 0.5), "hamming": (0.54, 0.46), "blackman": (0.42, 0.5, 0.08), "flat": (1.0,)}
"""A window is a₀ − a₁·cos 2πu + a₂·cos 4πu, u from 0 to 1 (Harris 1978)."""
Counts = NDArray[np.integer[Any]]
BLOCK = LEAST_ASCANS
"""So many A-scans are taken at a time, to keep what lies between two steps in a processor's cache.

Every slice has as many."""
_PER_OCTAVE = np.float32(10 * np.log10(2) * COUNTS_PER_DB)
_AT_ONE = np.float32(0.5 - ZERO_DB * COUNTS_PER_DB)
"""The level of power 1 in counts; the half rounds."""
_LOG2 = tuple(
    np.float32(a)
    for a in np.polynomial.Chebyshev.interpolate(np.log2, 5, domain=[1, 2]).convert(kind=np.polynomial.Polynomial).coef
)
"""This polynomial is log₂ of 1 … 2, off by 1e-5 at most, a hundredth of a count."""
LINE = 16
"""A line of a processor's cache holds so many float32. Rows lie apart by one: what lies 4 KiB apart shares its places
there."""
_ROOM = Room()


@dataclass(frozen=True, eq=False)
class Taps:
    """How n even wavenumbers are read: k is the sum of ``weights[k]`` × samples ``first[k]``, ``first[k]`` + 1, ….

    Attributes: ``first``, int32 (n,), from 0 to n less the taps; ``weights``, float64 (n, taps), zero where k was not
    recorded.
    """

    first: NDArray[np.int32]
    weights: Coordinates


def sample_places(chirp: Coordinates, gives: Literal["wavenumber", "sample"]) -> Coordinates:
    """Return where each even wavenumber 0, 1, … n − 1 lies among the n samples, float64 (n,); NaN: beyond them.

    ``chirp``, float64 (n,), rises. The inverse of one that gives wavenumbers is interpolated by monotone cubics
    (Fritsch and Butland 1984).
    """
    even = np.arange(chirp.size, dtype=np.float64)
    if gives == "sample":
        return np.where((chirp >= 0) & (chirp <= chirp.size - 1), chirp, np.nan)
    from scipy.interpolate import PchipInterpolator  # takes a while to load, and other chirps do without

    return np.asarray(PchipInterpolator(chirp, even, extrapolate=False)(even), dtype=np.float64)


def taps(places: Coordinates, interpolation: Interpolation) -> Taps:
    """Return the taps that read n samples at ``places``, float64 (n,), NaN where there is nothing to read.

    Cubic: the polynomial through the four nearest samples (Lagrange). Sinc: the eight nearest, by a sinc in a Kaiser
    window, whose weights are made to sum to one. At the ends those four or eight that there are.
    """
    n, n_taps = places.size, N_TAPS[interpolation]
    recorded = np.isfinite(places)
    at = np.where(recorded, places, 0.0)
    first = np.clip(np.floor(at).astype(np.int32) - n_taps // 2 + 1, 0, n - n_taps)
    part = at - first
    nodes = np.arange(n_taps)
    if interpolation == "linear":
        weights = np.maximum(0.0, 1 - np.abs(part[:, None] - nodes))
    elif interpolation == "sinc":
        apart = part[:, None] - nodes
        weights = np.sinc(apart) * np.i0(KAISER_BETA * np.sqrt(np.clip(1 - (2 * apart / n_taps) ** 2, 0, 1)))
        weights /= weights.sum(axis=1, keepdims=True)
    else:
        weights = np.ones((n, n_taps))
        for node in nodes:
            for other in nodes[nodes != node]:
                weights[:, node] *= (part - other) / (node - other)
    return Taps(first, np.where(recorded[:, None], weights, 0.0))


def window(name: str, places: Coordinates) -> Coordinates:
    """Return the window over the even wavenumbers that were recorded, float64 (n,), zero over the others."""
    recorded = np.flatnonzero(np.isfinite(places))
    u = (np.arange(places.size) - recorded[0]) / max(1, recorded[-1] - recorded[0])
    shape = sum((-1) ** i * a * np.cos(2 * np.pi * i * u) for i, a in enumerate(COSINES[name]))
    return np.where(np.isfinite(places), shape, 0.0)


def dispersion_phase(n: int, coefficients_rad: Sequence[float]) -> Coordinates:
    """Return a·x² + b·x³ + … over n even wavenumbers, x from −1 to 1, rad, float64 (n,)."""
    return np.asarray(np.polynomial.Polynomial([0, 0, *coefficients_rad])(np.linspace(-1, 1, n)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """How spectra of n samples become A-scans of n / 2; picklable.

    Attributes: ``first`` uint32 (n,) and ``weights`` float32 (n, taps), with window and electrons in them;
    ``gain`` float32 (n / 2,), by which powers are multiplied to make up for the roll-off of the interpolation;
    ``background`` float64 (n,), counts, None: the mean over the A-scans of a slice; ``cos_sin`` float32 (2, n) of the
    dispersion's phase, if any. The weights are scaled so that a cosine of amplitude 1 has the level 0 dB, whatever n
    and the window are.
    """

    first: NDArray[np.uint32]
    weights: Image
    gain: Image
    background: Coordinates | None
    cos_sin: Image | None

    def bscan(self, spectra: Counts) -> NDArray[np.uint16]:
        """Return the B-scan (A-scan, n / 2) of ``spectra`` (A-scan, n), at least :data:`BLOCK` of them.

        :data:`~endoct.modalities.oct.spectra.keys.COUNTS_PER_DB` counts a decibel, from
        :data:`~endoct.modalities.oct.spectra.keys.ZERO_DB` on.
        """
        n_ascans, n = spectra.shape
        background = self._resampled(self.background if self.background is not None else mean_spectrum(spectra))
        counts = np.empty((n_ascans, n // 2), np.uint16)
        beside: Counts = _ROOM.array("beside", (n, BLOCK), spectra.dtype)
        even: Image = _ROOM.array("even", (n, BLOCK))
        fringes: Image = _ROOM.array("fringes", (BLOCK, n + LINE))[:, :n]
        power: Image = _ROOM.array("power", (n // 2,))
        for start in range(0, n_ascans, BLOCK):
            first = min(start, n_ascans - BLOCK)  # the last block begins before the one before it ends
            block = slice(first, first + BLOCK)
            cv2.transpose(spectra[block], beside)
            resample(beside, self.first, self.weights, background, even)
            cv2.transpose(even, fringes)
            write_levels(self._half_spectra(fringes), self.gain, power, counts[block])
        return counts

    def _resampled(self, background: Coordinates) -> Image:
        around = background[self.first[:, None] + np.arange(self.weights.shape[1])]
        return np.asarray((around * self.weights).sum(axis=1), dtype=np.float32)

    def _half_spectra(self, fringes: Image) -> Image:
        """Return half-spectra of ``fringes`` (BLOCK, n), as :func:`write_levels` wants them."""
        parts: Image = _ROOM.array("parts", (2 * BLOCK, fringes.shape[1]))
        if self.cos_sin is None:
            return np.asarray(cv2.dft(fringes, parts[:BLOCK], cv2.DFT_ROWS), np.float32)
        # fringes × exp(−iφ) by two real transforms, which are much faster than a complex one
        turned: Image = _ROOM.array("turned", (2, *fringes.shape))
        np.multiply(fringes, self.cos_sin[:, None], out=turned)
        return np.asarray(cv2.dft(turned.reshape(parts.shape), parts, cv2.DFT_ROWS), np.float32)


def reconstruction(
    taps: Taps,
    window: Coordinates,
    *,
    electrons_per_count: float = 1.0,
    background: Coordinates | None = None,
    phase_rad: Coordinates | None = None,
) -> Reconstruction:
    """Return the chain with these taps.

    ``window`` and ``phase_rad`` are of the n even wavenumbers; ``background`` is in counts, None: the mean of a slice.
    """
    scale = 2 * electrons_per_count / window.sum() * window
    return Reconstruction(
        first=taps.first.astype(np.uint32),
        weights=(taps.weights * scale[:, None]).astype(np.float32),
        gain=_gain(taps, window),
        background=background,
        cos_sin=None if phase_rad is None else np.stack([np.cos(phase_rad), np.sin(phase_rad)]).astype(np.float32),
    )


def _gain(taps: Taps, window: Coordinates) -> Image:
    """Return what makes up for the fall of power with depth as samples are interpolated, float32 (n / 2,).

    The measure is white noise of the detector, whose level is to be one over all depths. What interpolation takes from
    it, it takes from fringes too.
    """
    n, n_taps = taps.weights.shape
    power, even = np.zeros(n // 2 + 1), np.arange(n)
    for some in np.array_split(even, max(1, n // 256)):
        responses = np.zeros((some.size, n))  # to single samples
        for t in range(n_taps):
            sample = taps.first + t - some[0]
            reads = (sample >= 0) & (sample < some.size)
            responses[sample[reads], even[reads]] = taps.weights[reads, t] * window[reads]
        power += (np.abs(np.fft.rfft(responses)) ** 2).sum(axis=0)
    return np.asarray(power[0] / power[: n // 2], dtype=np.float32)


def mean_spectrum(spectra: Counts) -> Coordinates:
    """Return the mean of ``spectra`` (A-scan, n) over the A-scans, float64 (n,)."""
    sums = np.zeros(spectra.shape[1], np.int64)
    add_up(spectra, sums)
    return sums / len(spectra)


@compiled
def add_up(spectra: Counts, sums: NDArray[np.int64]) -> None:
    """Add ``spectra`` (A-scan, n) to ``sums`` (n,)."""
    together = spectra.shape[0] // 4 * 4
    for i in range(0, together, 4):
        one, two, three, four = spectra[i], spectra[i + 1], spectra[i + 2], spectra[i + 3]
        for p in range(spectra.shape[1]):
            sums[p] += np.int32(one[p]) + np.int32(two[p]) + np.int32(three[p]) + np.int32(four[p])
    for i in range(together, spectra.shape[0]):
        for p in range(spectra.shape[1]):
            sums[p] += spectra[i, p]


@compiled
def resample(spectra: Counts, first: NDArray[np.uint32], weights: Image, background: Image, fringes: Image) -> None:
    """Write ``spectra`` (n, :data:`BLOCK`) at even wavenumbers, less ``background`` (n,), to ``fringes`` float32.

    ``first`` (n,) and ``weights`` float32 (n, taps) are taps, four or a multiple of it. A-scans lie side by side, in
    ``fringes`` too. So a wavenumber of all of them is made of rows, each of which lies in one piece.
    """
    for k in range(first.size):
        less, fringe = background[k], fringes[k]
        for t in range(0, weights.shape[1], 4):
            a, b, c, d = weights[k, t], weights[k, t + 1], weights[k, t + 2], weights[k, t + 3]
            near = np.intp(first[k]) + t
            one, two, three, four = spectra[near], spectra[near + 1], spectra[near + 2], spectra[near + 3]
            for i in range(BLOCK):
                value = (
                    a * np.float32(one[i]) + b * np.float32(two[i]) + c * np.float32(three[i]) + d * np.float32(four[i])
                )
                fringe[i] = value - less if t == 0 else fringe[i] + value


@compiled
def write_levels(parts: Image, gain: Image, power: Image, counts: NDArray[np.uint16]) -> None:
    """Write the levels of half-spectra as ``counts`` (A-scan, depth), :data:`COUNTS_PER_DB` from :data:`ZERO_DB` on.

    A row of ``parts``, float32 (A-scan, n), holds the real part of depth 0, then real and imaginary parts of depths 1,
    2, …. Of complex fringes there are twice as many rows: first those of their real parts, then those of their
    imaginary parts with the opposite sign. Powers are multiplied by ``gain``, float32 (n / 2,); ``power``, of the same
    shape, is room for one A-scan.
    """
    n_ascans, n_depth = counts.shape
    bits = power.view(np.int32)
    for i in range(n_ascans):
        row = parts[i]
        if parts.shape[0] == n_ascans:
            power[0] = row[0] * row[0] * gain[0]
            for k in range(1, n_depth):
                real, imaginary = row[2 * k - 1], row[2 * k]
                power[k] = (real * real + imaginary * imaginary) * gain[k]
        else:
            other = parts[n_ascans + i]
            power[0] = (row[0] * row[0] + other[0] * other[0]) * gain[0]
            for k in range(1, n_depth):
                real, imaginary = row[2 * k - 1] + other[2 * k], row[2 * k] - other[2 * k - 1]
                power[k] = (real * real + imaginary * imaginary) * gain[k]
        for k in range(n_depth):
            octave = np.float32((bits[k] >> 23) - 127)
            bits[k] = (bits[k] & 0x7FFFFF) | 0x3F800000  # its mantissa, from 1 to 2
            x = power[k]
            log2 = _LOG2[0] + x * (_LOG2[1] + x * (_LOG2[2] + x * (_LOG2[3] + x * (_LOG2[4] + x * _LOG2[5]))))
            level = _PER_OCTAVE * (octave + log2) + _AT_ONE
            counts[i, k] = np.uint16(min(max(level, np.float32(0)), np.float32(65535)))
