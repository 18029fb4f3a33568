"""Points on bright lines in one reduced B-scan, and the paper's enhancement before the fit.

The enhancement is wavelet denoising, histogram equalisation and a local threshold (Laves 2019, Image undistortion).
All work on a reduced B-scan (θ, depth), where θ is a circle.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import pywt
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.circle import pad_circle
from endoct.base.numeric.least_squares import vertex
from endoct.base.numeric.ranks import median, quantile_pair, robust_sigma
from endoct.modalities.oct.bscan import Raster
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.parameters import OctParameters

WAVELET, MODE = pywt.Wavelet("db2"), "periodization"
POINTS_PER_COLUMN = 8
WEAKEST_POINT_SIGMAS = 3.0
LINE_HALF_MM, BEHIND_MM, AROUND_MM = (
    0.004,
    0.018,
    0.055,
)  # a line's half width; the dark beyond it, nearest and farthest


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


@dataclass(frozen=True, eq=False)
class Points:
    """Points on bright lines: ``angle_rad``, ``depth_mm`` (from depth sample 0), ``strength`` 0…1, each (n,)."""

    angle_rad: Coordinates
    depth_mm: Coordinates
    strength: Coordinates

    @classmethod
    def none(cls) -> "Points":
        """Return no points at all."""
        return cls(np.empty(0), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return self.strength.size

    def where(self, good: Mask) -> "Points":
        """Return the points that are ``good``, bool (n,)."""
        return Points(self.angle_rad[good], self.depth_mm[good], self.strength[good])

    def outside_rows(self, rows: Mask, mm_per_px: float) -> "Points":
        """Return the points that do not lie in depth ``rows``, bool (n_depth,)."""
        row = np.clip(np.round(self.depth_mm / mm_per_px), 0, rows.size - 1).astype(np.intp)
        return self.where(~rows[row])

    def beyond_mm(self, circle: Circle) -> Coordinates:
        """Return how much deeper than ``circle`` the points lie, float64 (n,), mm."""
        return np.asarray(self.depth_mm - circle.axis_depth_mm - circle.distance_mm(self.angle_rad))


def tukey_weight(residual: Coordinates, width: float) -> Coordinates:
    """Return Tukey's weights of residuals, 1 at 0 and 0 from ``width`` on; both in one unit."""
    return np.asarray(np.maximum(1 - (residual / width) ** 2, 0) ** 2)


def line_points(image: Image, raster: Raster, parameters: OctParameters) -> Points:
    """Return the points of a reduced logarithmic B-scan, float32 (θ, depth), where a line has darkness behind it.

    The image is enhanced as in the paper; each column's strongest ridges above the local threshold are returned.
    """
    mm_per_px = raster.mm_per_px
    denoised = wavelet_denoise(image, parameters.denoise_threshold)
    equal = equalise(denoised, parameters.clahe_clip_limit, parameters.clahe_tile_mm / mm_per_px)
    bright = local_threshold(equal, parameters.threshold_window_mm / mm_per_px)
    ridge = _ridge(denoised, mm_per_px)
    noise = robust_sigma(ridge - median(ridge))
    column, row, height = _peaks(ridge, bright, np.float32(WEAKEST_POINT_SIGMAS * noise))
    shift = vertex(ridge[column, row - 1], height, ridge[column, row + 1])
    strength = np.minimum(1.0, height / (4 * WEAKEST_POINT_SIGMAS * max(noise, 1e-9)))
    depth_mm = (row + np.clip(shift, -0.5, 0.5)) * mm_per_px
    return Points(raster.angle_rad[column], depth_mm, strength.astype(np.float64))


@compiled
def _peaks(ridge: Image, bright: Mask, least: np.float32) -> tuple[NDArray[np.intp], NDArray[np.intp], Image]:
    """Column, row and height of every column's highest peaks above ``least`` where it is ``bright``."""
    n_columns, n_rows = ridge.shape
    columns, rows = np.empty(ridge.size // 2, np.intp), np.empty(ridge.size // 2, np.intp)
    heights = np.empty(ridge.size // 2, np.float32)
    highest = np.empty(POINTS_PER_COLUMN, np.float32)
    count = 0
    for column in range(n_columns):
        each = ridge[column]
        first = count
        for row in range(1, n_rows - 1):
            here = each[row]
            if bright[column, row] and here > least and here >= each[row - 1] and here > each[row + 1]:
                columns[count], rows[count], heights[count] = column, row, here
                count += 1
        if count - first > POINTS_PER_COLUMN:
            highest[:] = -np.inf
            for k in range(first, count):
                at = POINTS_PER_COLUMN - 1
                if heights[k] > highest[at]:
                    while at > 0 and heights[k] > highest[at - 1]:
                        highest[at] = highest[at - 1]
                        at -= 1
                    highest[at] = heights[k]
            last, count = count, first
            for k in range(first, last):
                if heights[k] >= highest[POINTS_PER_COLUMN - 1]:
                    columns[count], rows[count], heights[count] = column, rows[k], heights[k]
                    count += 1
    return columns[:count], rows[:count], heights[:count]


def _ridge(image: Image, mm_per_px: float) -> Image:
    """By how much each sample outshines what lies behind it and, at half the weight, what lies before it."""
    half, near, far = (
        round(LINE_HALF_MM / mm_per_px),
        max(2, round(BEHIND_MM / mm_per_px)),
        max(5, round(AROUND_MM / mm_per_px)),
    )
    return _contrasts(image, half, near, far)


@compiled
def _contrasts(image: Image, half: int, near: int, far: int) -> Image:
    n_columns, n = image.shape
    ridge = np.zeros((n_columns, n), np.float32)
    total = np.zeros(n + 1)
    for column in range(n_columns):
        for row in range(n):
            total[row + 1] = total[row] + image[column, row]
        for row in range(n - far):
            low, high = max(row - half, 0), row + half + 1
            here = (total[high] - total[low]) / (high - low)
            behind = (total[row + far + 1] - total[row + near]) / (far + 1 - near)
            low, high = max(row - far, 0), max(row - near, 0) + 1
            before = (total[high] - total[low]) / (high - low)
            ridge[column, row] = 0.5 * (here - behind) + 0.5 * min(here - behind, here - before)
    return ridge
