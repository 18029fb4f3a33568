"""From the counts of a detector to a B-scan: less the background, at even wavenumbers, window, dispersion, Fourier."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.memory import Room
from endoct.modalities.oct.spectra.kernels import BLOCK, Counts, add_up, resample, write_levels
from endoct.modalities.oct.spectra.resampling import Taps

LINE = 16
"""float32 in a line of a processor's cache, by which rows lie apart: what lies 4 KiB apart shares its places there."""
_ROOM = Room()


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """How spectra of n samples become A-scans of n / 2; picklable.

    Attributes: ``first`` uint32 (n,) and ``weights`` float32 (n, taps), with window, electrons and the scale in them
    that gives a cosine of amplitude 1 the level 0 dB, whatever n and the window are; ``gain`` float32 (n / 2,),
    by which powers are multiplied to make up for the roll-off of the interpolation; ``background`` float64 (n,),
    counts, None: the mean over the A-scans of a slice; ``cos_sin`` float32 (2, n) of the dispersion's phase, if any.
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
    """Return by what power falls with depth as samples are interpolated, its inverse, float32 (n / 2,).

    The measure is white noise of the detector, whose level is to be one over all depths: what interpolation takes from
    it, it takes from fringes.
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
