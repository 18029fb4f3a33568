"""Points on bright lines in one reduced B-scan."""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.bscan import Raster, depth_sums
from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.enhance import equalise, local_threshold, wavelet_denoise
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.robust import robust_sigma

POINTS_PER_COLUMN = 8
WEAKEST_POINT_SIGMAS = 3.0
LINE_HALF_MM, BEHIND_MM, AROUND_MM = (
    0.004,
    0.018,
    0.055,
)  # a line's half width; the dark beyond it, nearest and farthest


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
    noise = robust_sigma(ridge - np.median(ridge))
    peak = np.zeros_like(bright)
    peak[:, 1:-1] = (ridge[:, 1:-1] >= ridge[:, :-2]) & (ridge[:, 1:-1] > ridge[:, 2:])
    height = np.where(peak & bright & (ridge > WEAKEST_POINT_SIGMAS * noise), ridge, 0.0)
    kth = np.partition(height, -POINTS_PER_COLUMN, axis=1)[:, -POINTS_PER_COLUMN, None]
    column, row = np.nonzero((height > 0) & (height >= kth))
    before, here, after = ridge[column, row - 1], ridge[column, row], ridge[column, row + 1]
    shift = 0.5 * (before - after) / np.minimum(before - 2 * here + after, -1e-9)
    strength = np.minimum(1.0, height[column, row] / (4 * WEAKEST_POINT_SIGMAS * max(noise, 1e-9)))
    depth_mm = (row + np.clip(shift, -0.5, 0.5)) * mm_per_px
    return Points(raster.angle_rad[column], depth_mm, strength.astype(np.float64))


def _ridge(image: Image, mm_per_px: float) -> Image:
    """By how much each sample outshines what lies behind it and, at half the weight, what lies before it."""
    half, near, far = (
        round(LINE_HALF_MM / mm_per_px),
        max(2, round(BEHIND_MM / mm_per_px)),
        max(5, round(AROUND_MM / mm_per_px)),
    )
    n = image.shape[1]
    total = depth_sums(image)

    def mean(first: int, last: int) -> Coordinates:
        low, high = np.clip(np.arange(n) + first, 0, n - 1), np.clip(np.arange(n) + last, 0, n - 1)
        return np.asarray((total[:, high + 1] - total[:, low]) / (high + 1 - low))

    here = mean(-half, half)
    over_behind, over_before = here - mean(near, far), here - mean(-far, -near)
    ridge = 0.5 * over_behind + 0.5 * np.minimum(over_behind, over_before)
    ridge[:, n - far :] = 0
    return np.asarray(ridge, dtype=np.float32)
