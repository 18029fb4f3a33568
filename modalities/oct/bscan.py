"""B-scans made small: area average along θ, and decibels where samples are linear."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image


@dataclass(frozen=True, eq=False)
class Raster:
    """How a reduced B-scan is sampled.

    Attributes: ``angle_rad``, float64 (n_columns,), the centres of its sectors from A-scan 0; ``n_depth`` samples of
    ``mm_per_px`` each, in the medium.
    """

    angle_rad: Coordinates
    n_depth: int
    mm_per_px: float

    @property
    def depth_mm(self) -> float:
        """Depth of the B-scan, mm."""
        return self.n_depth * self.mm_per_px


@dataclass(frozen=True)
class Spacing:
    """Distance of neighbouring samples of a B-scan, mm: ``depth_mm`` along a beam, ``column_mm`` along the wall."""

    depth_mm: float
    column_mm: float


def reduce_theta(samples: NDArray[np.generic], n_columns: int) -> Image:
    """Return the area average of a B-scan (A-scan, depth) over ``n_columns`` sectors, float32 (n_columns, depth).

    ``n_columns`` is at most the number of A-scans. Their centres are :func:`sector_angles_rad`.
    """
    if samples.shape[0] == n_columns:
        return np.ascontiguousarray(samples, dtype=np.float32)
    page = samples.T
    if page.dtype not in (np.uint8, np.uint16, np.float32):
        page = page.astype(np.float32)
    reduced = cv2.resize(np.ascontiguousarray(page), (n_columns, page.shape[0]), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(reduced.T, dtype=np.float32)


def sector_angles_rad(n_ascans: int, n_columns: int) -> Coordinates:
    """Return the rotation angle from A-scan 0 at the centre of each sector, float64 (n_columns,), rad."""
    width = n_ascans / n_columns
    return np.asarray((np.arange(n_columns) * width + (width - 1) / 2) * (2 * np.pi / n_ascans), dtype=np.float64)


def depth_sums(image: Image) -> Coordinates:
    """Return the sums of each A-scan of ``image`` (n, depth) before every depth, float64 (n, depth + 1)."""
    return np.concatenate([np.zeros((image.shape[0], 1)), np.cumsum(image, axis=1, dtype=np.float64)], axis=1)


def mean_between(sums: Coordinates, first: NDArray[np.intp], last: NDArray[np.intp]) -> Coordinates:
    """Return the mean of each A-scan over its rows from ``first`` (n,) up to but without ``last`` (n,), float64 (n,).

    ``sums`` are :func:`depth_sums`. Only rows within the depth range count; the mean of none is 0.
    """
    n_depth = sums.shape[1] - 1
    low, high = np.clip(first, 0, n_depth), np.clip(last, 0, n_depth)
    each = np.arange(len(sums))
    return np.asarray((sums[each, high] - sums[each, low]) / np.maximum(high - low, 1))


def logarithmic(image: Image, intensity: str) -> Image:
    """Return ``image`` on a logarithmic scale: unchanged where it already is, in dB where ``intensity`` is "linear"."""
    if intensity == "log":
        return image
    floor = max(float(np.mean(np.abs(image))) * 1e-6, float(np.finfo(np.float32).tiny))
    return np.asarray(10 * np.log10(np.maximum(image, floor)), dtype=np.float32)
