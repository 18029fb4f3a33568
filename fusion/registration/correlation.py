"""Masked normalised cross-correlation on the cylinder: θ is a circle, z is a line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.fusion.evidence.evidence import Evidence
from endoct.stitching.arrays import Image, Mask


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier transforms of an image, its square and its mask, complex64, z padded to ``n_padded`` rows."""

    values: NDArray[np.complex64]
    squares: NDArray[np.complex64]
    mask: NDArray[np.complex64]
    n_z: int
    n_theta: int
    n_padded: int


def spectra(image: Image, valid: Mask, n_padded: int) -> Spectra:
    """Transform a float32 (n_z, n_theta) image of which only ``valid`` samples count."""
    # without its mean the sums of squares stay small, which float32 needs
    centred = np.where(valid, image - image[valid].mean(), np.float32(0)) if valid.any() else np.zeros_like(image)
    shape = n_padded, image.shape[1]
    values, squares, mask = (
        np.asarray(fft.rfft2(part, shape), dtype=np.complex64)
        for part in (centred, centred * centred, valid.astype(np.float32))
    )
    return Spectra(values, squares, mask, image.shape[0], image.shape[1], n_padded)


def padded_rows(n_a: int, n_b: int) -> int:
    """Return to how many rows images of ``n_a`` and ``n_b`` rows must be padded for their correlation."""
    return int(fft.next_fast_len(n_a + n_b - 1, real=True))


def correlate(fixed: Spectra, moved: Evidence) -> tuple[Image, Image]:
    """Return (correlation, overlap) of ``moved`` shifted over ``fixed``, as :func:`masked_correlation`."""
    return masked_correlation(fixed, spectra(moved.values, moved.valid, fixed.n_padded))


def masked_correlation(a: Spectra, b: Spectra) -> tuple[Image, Image]:
    """Return (correlation, overlap) of ``b`` shifted over ``a`` for every shift, both float32 (n_lags, n_theta).

    Row i is the z lag i − (n_z of b − 1), column k the θ lag k: b[y, x] meets a[y + lag_z, (x + lag_θ) mod n].
    The correlation is Pearson's over the samples valid in both (Padfield 2012, Masked object registration in
    the Fourier domain); ``overlap`` counts them. Both must have the same number of columns and padded rows.
    """
    n_lags = a.n_z + b.n_z - 1

    def shifts(of_a: NDArray[np.complex64], of_b: NDArray[np.complex64]) -> Image:
        lags = np.asarray(fft.irfft2(of_a * np.conj(of_b), (a.n_padded, a.n_theta)), dtype=np.float32)
        return np.roll(lags, b.n_z - 1, axis=0)[:n_lags]

    overlap = np.maximum(np.rint(shifts(a.mask, b.mask)), 0)
    count = np.maximum(overlap, 1)
    sum_a, sum_b = shifts(a.values, b.mask), shifts(a.mask, b.values)
    variance_a = shifts(a.squares, b.mask) - sum_a * sum_a / count
    variance_b = shifts(a.mask, b.squares) - sum_b * sum_b / count
    covariance = shifts(a.values, b.values) - sum_a * sum_b / count
    scale = np.sqrt(np.maximum(variance_a, 0) * np.maximum(variance_b, 0))
    # shifts that meet next to no structure have no correlation worth the name
    enough = scale > max(1e-3 * float(scale.max()), 1e-30)
    ratio = np.divide(covariance, scale, out=np.zeros_like(scale), where=enough)
    return np.clip(ratio, -1, 1).astype(np.float32), overlap.astype(np.float32)
