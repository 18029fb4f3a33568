"""The passes over samples of which numpy would make many, compiled."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.stitching.arrays import Image
from endoct.stitching.compiled import compiled

Counts = NDArray[np.integer[Any]]
TOGETHER = 8
"""A-scans that share what is read of the taps."""
_PER_OCTAVE = np.float32(10 * np.log10(2) * COUNTS_PER_DB)
_AT_ONE = np.float32(0.5 - ZERO_DB * COUNTS_PER_DB)
"""Of power 1; the half rounds."""
_LOG2 = tuple(
    np.float32(a)
    for a in np.polynomial.Chebyshev.interpolate(np.log2, 5, domain=[1, 2]).convert(kind=np.polynomial.Polynomial).coef
)
"""log₂ of 1 … 2 as a polynomial: off by 1e-5 at most, a hundredth of a count."""


@compiled
def add_up(spectra: Counts, sums: NDArray[np.int64]) -> None:
    """Add ``spectra`` (A-scan, n) to ``sums`` (n,)."""
    for i in range(spectra.shape[0]):
        for p in range(spectra.shape[1]):
            sums[p] += spectra[i, p]


@compiled
def resample(
    spectra: Counts,
    first: NDArray[np.uint32],
    weights: Image,
    background: Image,
    samples: Image,
    fringes: Image,
) -> None:
    """Write ``spectra`` (A-scan, n) at even wavenumbers, less ``background`` (n,), to ``fringes`` float32 (A-scan, n).

    ``first`` (n,) and ``weights`` float32 (n, taps) are taps, four or a multiple of it; ``samples`` float32
    (:data:`TOGETHER`, n) is room for as many A-scans, whose number divides that of ``spectra``.
    """
    second, third, fourth = samples[:, 1:], samples[:, 2:], samples[:, 3:]
    for start in range(0, spectra.shape[0], TOGETHER):
        for i in range(TOGETHER):
            for p in range(first.size):
                samples[i, p] = np.float32(spectra[start + i, p])
        for quad in range(weights.shape[1] // 4):
            shift, t = np.uint32(4 * quad), 4 * quad
            for k in range(first.size):
                near = np.uint32(first[k] + shift)
                a, b, c, d = weights[k, t], weights[k, t + 1], weights[k, t + 2], weights[k, t + 3]
                if quad == 0:
                    less = background[k]
                    for i in range(TOGETHER):
                        fringes[start + i, k] = (
                            a * samples[i, near] + b * second[i, near] + c * third[i, near] + d * fourth[i, near] - less
                        )
                else:
                    for i in range(TOGETHER):
                        fringes[start + i, k] += (
                            a * samples[i, near] + b * second[i, near] + c * third[i, near] + d * fourth[i, near]
                        )


@compiled
def write_levels(parts: Image, gain: Image, power: Image, counts: NDArray[np.uint16]) -> None:
    """Write the levels of half-spectra as ``counts`` (A-scan, depth), :data:`COUNTS_PER_DB` from :data:`ZERO_DB` on.

    A row of ``parts``, float32 (A-scan, n), holds the real part of depth 0, then real and imaginary parts of depths 1,
    2, …. Powers are multiplied by ``gain``, float32 (n / 2,); ``power``, of the same shape, is room for one A-scan.
    """
    n_depth = counts.shape[1]
    bits = power.view(np.int32)
    for i in range(counts.shape[0]):
        power[0] = parts[i, 0] * parts[i, 0] * gain[0]
        for k in range(1, n_depth):
            real, imaginary = parts[i, 2 * k - 1], parts[i, 2 * k]
            power[k] = (real * real + imaginary * imaginary) * gain[k]
        for k in range(n_depth):
            octave = np.float32((bits[k] >> 23) - 127)
            bits[k] = (bits[k] & 0x7FFFFF) | 0x3F800000  # its mantissa, from 1 to 2
            x = power[k]
            log2 = _LOG2[0] + x * (_LOG2[1] + x * (_LOG2[2] + x * (_LOG2[3] + x * (_LOG2[4] + x * _LOG2[5]))))
            level = _PER_OCTAVE * (octave + log2) + _AT_ONE
            counts[i, k] = np.uint16(min(max(level, np.float32(0)), np.float32(65535)))


@compiled
def join_halves(parts: Image) -> None:
    """Make the first half of the rows of ``parts`` (2 × A-scan, n) half-spectra of what is complex.

    These rows are transforms of its real part, the others of its imaginary part with the opposite sign, laid out as
    :func:`write_levels` wants them. At depth 0 only the magnitude is kept.
    """
    n_ascans, n = parts.shape[0] // 2, parts.shape[1]
    for i in range(n_ascans):
        real, imaginary = parts[i], parts[n_ascans + i]
        real[0] = np.sqrt(real[0] * real[0] + imaginary[0] * imaginary[0])
        for k in range(1, n - 1, 2):
            real[k] += imaginary[k + 1]
            real[k + 1] -= imaginary[k]
