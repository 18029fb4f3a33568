"""Masked normalised cross-correlation on the cylinder: θ is a circle, z is a line."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.stitching.arrays import Image, Mask


def masked_correlation(a: Image, a_valid: Mask, b: Image, b_valid: Mask) -> tuple[Image, Image]:
    """Return (correlation, overlap) of ``b`` shifted over ``a`` for every shift, both float32 (n_lags, n_theta).

    Row i is the z lag i − (n_z of b − 1), column k the θ lag k: b[y, x] meets a[y + lag_z, (x + lag_θ) mod n].
    The correlation is Pearson's over the samples valid in both (Padfield 2012, Masked object registration in
    the Fourier domain); ``overlap`` counts them. Both images must have the same number of columns.
    """
    n_lags = a.shape[0] + b.shape[0] - 1
    n_z = fft.next_fast_len(n_lags, real=True)
    shape = n_z, a.shape[1]

    def spectrum(image: NDArray[np.floating]) -> NDArray[np.complex64]:
        return np.asarray(fft.rfft2(image, shape), dtype=np.complex64)

    def shifts(product: NDArray[np.complex64]) -> Image:
        lags = fft.irfft2(product, shape)
        return np.roll(lags, b.shape[0] - 1, axis=0)[:n_lags]

    # without their means the sums of squares stay small, which float32 needs
    a = np.where(a_valid, a - a[a_valid].mean(), np.float32(0)) if a_valid.any() else a
    b = np.where(b_valid, b - b[b_valid].mean(), np.float32(0)) if b_valid.any() else b
    fa, fa2, fma = spectrum(a), spectrum(a * a), spectrum(a_valid.astype(np.float32))
    fb, fb2, fmb = (np.conj(spectrum(image)) for image in (b, b * b, b_valid.astype(np.float32)))
    overlap = np.maximum(np.rint(shifts(fma * fmb)), 0)
    count = np.maximum(overlap, 1)
    sum_a, sum_b = shifts(fa * fmb), shifts(fma * fb)
    variance_a = shifts(fa2 * fmb) - sum_a * sum_a / count
    variance_b = shifts(fma * fb2) - sum_b * sum_b / count
    covariance = shifts(fa * fb) - sum_a * sum_b / count
    scale = np.sqrt(np.maximum(variance_a, 0) * np.maximum(variance_b, 0))
    # shifts that meet next to no structure have no correlation worth the name
    enough = scale > 1e-3 * max(float(scale.max()), np.finfo(np.float32).tiny)
    ratio = np.divide(covariance, scale, out=np.zeros_like(scale), where=enough)
    return np.clip(ratio, -1, 1), overlap
