"""The paper's enhancement before the fit: wavelet denoising, histogram equalisation, local threshold.

Laves 2019, Image undistortion. All work on a reduced B-scan (θ, depth), where θ is a circle.
"""

import cv2
import numpy as np
import pywt

from endoct.stitching.arrays import Image, Mask
from endoct.stitching.circle import pad_circle
from endoct.stitching.ranks import median, quantile_pair

WAVELET, MODE = pywt.Wavelet("db2"), "periodization"


def wavelet_denoise(image: Image, threshold_sigmas: float) -> Image:
    """Return ``image`` with its wavelet coefficients shrunk by ``threshold_sigmas`` of their noise.

    Two levels of Daubechies-2, soft threshold, the noise's σ from the finest diagonal coefficients. Where that σ or
    the threshold is 0, the image is returned unchanged.
    """
    coarse, *fine = _bands(np.asarray(image, dtype=np.float32))
    coarsest, *middle = _bands(coarse)
    threshold = threshold_sigmas * (median(np.abs(fine[-1])) / 0.6745)
    if threshold == 0:
        return image  # nothing to shrink by; PyWavelets would make 0/0 of coefficients that are 0
    middle, fine = ([pywt.threshold(band, threshold, mode="soft") for band in level] for level in (middle, fine))
    coarse = _joined(coarsest, *middle)[: coarse.shape[0], : coarse.shape[1]]
    return np.ascontiguousarray(_joined(coarse, *fine)[: image.shape[0], : image.shape[1]])


def _bands(image: Image) -> list[Image]:
    """Return the four bands of one level of a wavelet transform: low or high along rows, then so along columns.

    As ``pywt.dwt2`` has them, to the bit: it takes five times as long along columns as along rows, so these are turned
    over.
    """
    halves = pywt.dwt(cv2.transpose(image), WAVELET, MODE)
    return [band for half in halves for band in pywt.dwt(cv2.transpose(half), WAVELET, MODE)]


def _joined(low: Image, low_high: Image, high_low: Image, high: Image) -> Image:
    """Return the image of :func:`_bands`, in one more row or column where their number was odd."""
    halves = [pywt.idwt(*bands, WAVELET, MODE) for bands in ((low, low_high), (high_low, high))]
    return np.asarray(cv2.transpose(pywt.idwt(*map(cv2.transpose, halves), WAVELET, MODE)))


def equalise(image: Image, clip_limit: float, tile_depth_px: float) -> Image:
    """Return ``image`` after contrast-limited adaptive histogram equalisation, float32 0…255."""
    low, high = quantile_pair(image, 0.005, 0.995)
    grey = np.clip((image - low) * (255 / max(high - low, 1e-12)), 0, 255).astype(np.uint8)
    pad = image.shape[0] // 4
    wrapped = pad_circle(grey, pad, axis=0)
    tiles = max(1, round(image.shape[1] / tile_depth_px)), 6
    equalised = cv2.createCLAHE(clip_limit, tiles).apply(wrapped)
    return np.asarray(equalised[pad : pad + image.shape[0]], dtype=np.float32)


def local_threshold(image: Image, window_px: float) -> Mask:
    """Return where ``image`` exceeds its Gaussian mean along depth over ``window_px``, bool of its shape."""
    window = max(3, round(window_px) | 1)
    mean = cv2.GaussianBlur(image, (window, 1), 0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(image > mean)
