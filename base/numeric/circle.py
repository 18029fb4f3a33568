"""Arithmetic and filters on the bore wall, where axis −1 (θ) is a circle and axis −2 (z) ends."""

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates, Image, Mask

Scalar = TypeVar("Scalar", bound=np.generic)


def wrap_rad(angle_rad: ArrayLike) -> Coordinates:
    """Return ``angle_rad`` (any shape) wrapped to [−π, π)."""
    return np.mod(np.asarray(angle_rad, dtype=np.float64) + np.pi, 2 * np.pi) - np.pi


def mean_angle_rad(angle_rad: ArrayLike, axis: int | None = None) -> Coordinates:
    """Return the mean direction of ``angle_rad`` along ``axis`` (all of it for None), in (−π, π]; NaN are left out."""
    return np.asarray(np.angle(np.nansum(np.exp(1j * np.asarray(angle_rad, dtype=np.float64)), axis=axis)))


def turned_harmonic(factors: Coordinates, by_rad: ArrayLike) -> Coordinates:
    """Return factors of (cos θ, sin θ), (n, 2), as factors of those of θ + ``by_rad``, one angle or (n,)."""
    cos, sin = np.cos(by_rad), np.sin(by_rad)
    return np.stack([factors[:, 0] * cos - factors[:, 1] * sin, factors[:, 0] * sin + factors[:, 1] * cos], axis=1)


def pad_circle(samples: NDArray[Scalar], n: int, axis: int = -1) -> NDArray[Scalar]:
    """Return ``samples`` with the ``n`` nearest of the other end repeated at both ends of ``axis``, a full circle."""
    widths = [(0, 0)] * samples.ndim
    widths[axis] = n, n
    return np.pad(samples, widths, mode="wrap")


def largest_divisor(n: int, at_most: int) -> int:
    """Return the largest divisor of ``n`` that does not exceed ``at_most``; 1 where ``at_most`` is below 1.

    So many columns of a circle of ``n`` can be taken together without a remainder at its seam.
    """
    return max(k for k in range(1, max(at_most, 1) + 1) if n % k == 0)


def gaussian(image: Image, sigma_rows_px: float, sigma_columns_px: float) -> Image:
    """Blur a float32 (n_z, n_theta) image: cyclic along θ, replicated at the ends of z.

    A sigma of 0 leaves its axis alone. Callers convert from mm or rad with their grid.
    """
    pad = int(np.ceil(4 * sigma_columns_px))  # more than one turn where the blur is wider than the circle
    padded = pad_circle(image, pad)
    blurred = cv2.sepFilter2D(
        padded, cv2.CV_32F, _kernel(sigma_columns_px), _kernel(sigma_rows_px), borderType=cv2.BORDER_REPLICATE
    )
    return np.ascontiguousarray(blurred[:, pad : pad + image.shape[1]], dtype=np.float32)


def masked_gaussian(image: Image, valid: Mask, sigma_rows_px: float, sigma_columns_px: float) -> Image:
    """Blur as :func:`gaussian` does over the ``valid`` samples alone, bool (n_z, n_theta); 0 where not valid."""
    weight = gaussian(valid.astype(np.float32), sigma_rows_px, sigma_columns_px)
    total = gaussian(np.where(valid, image, np.float32(0)), sigma_rows_px, sigma_columns_px)
    return np.divide(total, weight, out=np.zeros_like(total), where=valid)


def _kernel(sigma_px: float) -> Image:
    if sigma_px <= 0:
        return np.ones(1, np.float32)
    reach = max(1, int(np.ceil(4 * sigma_px)))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    return np.asarray(taps / taps.sum(), dtype=np.float32)
