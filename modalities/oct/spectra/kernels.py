"""The passes over samples that numpy would make many of, compiled; without the interpreter's lock, in one thread each.

Sums may be contracted to fused multiply-adds, so the last bit of a float32 may differ from one processor to another.
"""

import numba
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image

COUNTS_PER_DB = 256
ZERO_DB = -100.0
"""The level at which counts of a B-scan begin: between −100 and 156 dB they are linear in it."""
_PER_OCTAVE = np.float32(10 * np.log10(2) * COUNTS_PER_DB)
_AT_ONE = np.float32(0.5 - ZERO_DB * COUNTS_PER_DB)
"""Of power 1; the half rounds."""
_LOG2 = tuple(
    np.float32(a)
    for a in np.polynomial.Chebyshev.interpolate(np.log2, 5, domain=[1, 2]).convert(kind=np.polynomial.Polynomial).coef
)
"""log₂ of 1 … 2 as a polynomial: off by 1e-5 at most, a hundredth of a count."""
_compiled = numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})


@_compiled
def add_up(spectra: NDArray[np.uint16], sums: NDArray[np.int64]) -> None:
    """Add ``spectra`` (A-scan, n) to ``sums`` (n,)."""
    for i in range(spectra.shape[0]):
        for p in range(spectra.shape[1]):
            sums[p] += spectra[i, p]


@_compiled
def resample(
    spectra: NDArray[np.uint16],
    first: NDArray[np.uint32],
    weights: Image,
    background: Image,
    samples: Image,
    fringes: Image,
) -> None:
    """Write ``spectra`` (A-scan, n) at even wavenumbers, less ``background`` (n,), to ``fringes`` float32 (A-scan, n).

    ``first`` (n,) and ``weights`` float32 (n, 4) are taps; ``samples`` float32 (8, n) is room for as many A-scans,
    which share what is read of the taps.
    """
    at_a_time = samples.shape[0]
    second, third, fourth = samples[:, 1:], samples[:, 2:], samples[:, 3:]
    for start in range(0, spectra.shape[0], at_a_time):
        count = min(at_a_time, spectra.shape[0] - start)
        for i in range(count):
            for p in range(first.size):
                samples[i, p] = np.float32(spectra[start + i, p])
        for k in range(first.size):
            p = first[k]
            a, b, c, d, less = weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3], background[k]
            for i in range(at_a_time):
                value = a * samples[i, p] + b * second[i, p] + c * third[i, p] + d * fourth[i, p] - less
                if i < count:
                    fringes[start + i, k] = value


@_compiled
def write_levels(parts: Image, power: Image, counts: NDArray[np.uint16]) -> None:
    """Write the levels of half-spectra as ``counts`` (A-scan, depth), :data:`COUNTS_PER_DB` from :data:`ZERO_DB` on.

    A row of ``parts``, float32 (A-scan, n), holds the real part of depth 0, then real and imaginary parts of depths 1,
    2, …. ``power``, float32 (n / 2,), is room for one A-scan.
    """
    n_depth = counts.shape[1]
    bits = power.view(np.int32)
    for i in range(counts.shape[0]):
        power[0] = parts[i, 0] * parts[i, 0]
        for k in range(1, n_depth):
            power[k] = parts[i, 2 * k - 1] * parts[i, 2 * k - 1] + parts[i, 2 * k] * parts[i, 2 * k]
        for k in range(n_depth):
            octave = np.float32((bits[k] >> 23) - 127)
            bits[k] = (bits[k] & 0x7FFFFF) | 0x3F800000  # its mantissa, from 1 to 2
            x = power[k]
            log2 = octave + (_LOG2[0] + x * (_LOG2[1] + x * (_LOG2[2] + x * (_LOG2[3] + x * (_LOG2[4] + x * _LOG2[5])))))
            level = _PER_OCTAVE * log2 + _AT_ONE
            counts[i, k] = np.uint16(min(max(level, np.float32(0)), np.float32(65535)))
