"""The passes over samples of which numpy would make many, compiled."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, LEAST_ASCANS, ZERO_DB

Counts = NDArray[np.integer[Any]]
BLOCK = LEAST_ASCANS
"""A-scans at a time, so that what lies between two steps stays in a processor's cache. Every slice has so many."""
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
    ``fringes`` too, so that a wavenumber of all of them is made of rows that lie in one piece each.
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
    2, …. Where what was transformed is complex, there are twice as many rows: those of its real parts, then those of
    its imaginary parts with the opposite sign. Powers are multiplied by ``gain``, float32 (n / 2,); ``power``, of the
    same shape, is room for one A-scan.
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
