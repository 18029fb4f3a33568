"""Which A-scans show the wall, rather than something opaque before it, its shadow, or noise."""

import math

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.oct.bscan import Spacing, mean_between, varying
from endoct.modalities.oct.surface.evidence import Background, relative_power, spread_of_noise
from endoct.modalities.oct.surface.wall import Rows

SURFACE_MM = 0.1
TAIL_MM = (0.3, 0.6)
NEAR_MM = 0.1
SHADOW_EDGE_MM = 0.3
OPAQUE_SHARE = 0.25
BRIGHT_SHARE = 0.5
TAIL_SIGMAS = 1.5
PATCH_MM = 0.1
MOST_POWER = 30.0  # times the noise's: a glint counts for no more
POWER_OF_A_PATH = 1.5  # times the noise's: a path through noise alone follows what is brightest


def trusted(level: Image, row: Rows, background: Background, spacing: Spacing) -> Mask:
    """Return for every A-scan of a logarithmic B-scan (θ, depth) whether its surface at ``row`` is the wall's.

    It is not where a bright surface has nothing behind it while the wall elsewhere in the slice has: something opaque,
    such as a guide wire or a clot, lies before the wall. Nor is it next to that, where the shadow shows no surface
    (``row`` = n_depth). Elsewhere no surface means a cell whose floor is out of range, which is trusted.
    """
    n_theta, n_depth = level.shape
    surface = row < n_depth
    if not surface.any() or not varying(level).any():
        return np.zeros(n_theta, bool)
    mm_per_px, mm_per_column = spacing.depth_mm, spacing.column_mm
    near = max(1, round(NEAR_MM / mm_per_column))
    bright = _mean(level, row, row + round(SURFACE_MM / mm_per_px)) - background.noise
    tail = _mean(level, row + round(TAIL_MM[0] / mm_per_px), row + round(TAIL_MM[1] / mm_per_px)) - background.noise
    opaque = np.zeros(n_theta, bool)
    measured = surface & np.isfinite(tail)
    usual = float(np.median(tail[measured])) if measured.any() else 0.0
    if usual > TAIL_SIGMAS * background.noise_sigma:
        dark = measured & (tail < OPAQUE_SHARE * usual) & (bright > BRIGHT_SHARE * background.contrast)
        # a narrow one would be a gap in the speckle
        share = uniform_filter1d(dark.astype(np.float32), 2 * near + 1, mode="wrap")
        opaque = dark & (maximum_filter1d(share, 2 * near + 1, mode="wrap") > 0.8)
    good = ~opaque
    reach = max(1, round(SHADOW_EDGE_MM / mm_per_column))
    for first, length in _runs(~surface):
        around = np.arange(first - reach, first + length + reach) % n_theta
        if opaque[around].any():
            good[np.arange(first, first + length) % n_theta] = False
    return good


def wall_sigmas(level: Image, row: Rows, trusted: Mask, background: Background, spacing: Spacing) -> float:
    """Return by how many standard errors the wall stands out of the noise, over 0.1 × 0.1 mm of it.

    That is the power just behind the surface at ``row``, in excess of what a path through noise alone would show, the
    median over all such patches where ``trusted`` A-scans show a surface; 0 where there are none, or where the power is
    less than that of noise.
    """
    n_depth = level.shape[1]
    depth, width = max(1, round(PATCH_MM / spacing.depth_mm)), max(1, round(PATCH_MM / spacing.column_mm))
    behind = row[:, None] + np.arange(depth)
    seen = trusted[:, None] & (behind < n_depth)
    levels = np.take_along_axis(level, np.minimum(behind, n_depth - 1), axis=1)
    power = relative_power(levels, background.noise, spread_of_noise(background)) / background.noise_power
    power = np.where(seen, np.minimum(power, MOST_POWER), 0).sum(axis=1, dtype=np.float64)
    looks, total = (uniform_filter1d(each, width, mode="wrap") for each in (seen.sum(axis=1, dtype=np.float64), power))
    full = looks > depth / 2
    if not full.any():
        return 0.0
    excess = float(np.median(total[full] / looks[full])) - POWER_OF_A_PATH
    return max(0.0, excess * math.sqrt(depth * width))


def _mean(level: Image, first: Rows, last: Rows) -> Coordinates:
    """Mean over rows ``first`` to ``last`` of every A-scan, NaN where these leave the depth range."""
    inside = (last <= level.shape[1]) & (last > first)
    return np.where(inside, mean_between(level, first, last), np.nan)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """First index and length of every run of True in a cyclic mask."""
    if mask.all():
        return [(0, mask.size)]
    starts = np.flatnonzero(mask & ~np.roll(mask, 1))
    ends = np.flatnonzero(mask & ~np.roll(mask, -1))
    if ends.size and starts.size and ends[0] < starts[0]:
        ends = np.roll(ends, -1)
    return [(int(start), int((end - start) % mask.size) + 1) for start, end in zip(starts, ends, strict=True)]
