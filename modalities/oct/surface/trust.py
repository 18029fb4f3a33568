"""How far a surface that was found can be trusted to be the wall's.

By the levels of the recording, an A-scan may show something opaque before the wall, its shadow, or noise.

A second look shares nothing with how the surface was found. An opening is dark where the bore's wall would be, and the
wall is bright. Two levels of the recording, as recorded, say which is which. No noise floor is taken off, no evidence
summed up, no path followed. So it knows nothing of the bore that the search does not, and finds no surface. But where a
whole patch of wall was erased, or cells were walled up, it contradicts, whatever the cause.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.bscan import Spacing, mean_between, rows_from, varying
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.background import Background, relative_power, spread_of_noise
from endoct.modalities.oct.surface.levels import pooled

SURFACE_MM = 0.1
TAIL_MM = (0.3, 0.6)
NEAR_MM = 0.1
SHADOW_EDGE_MM = 0.3
OPAQUE_SHARE = 0.25
BRIGHT_SHARE = 0.5
TAIL_SIGMAS = 1.5
SQUARE_MM = 0.1
MOST_POWER = 30.0
"""A glint counts for no more than so many times the power of the noise."""
POWER_OF_A_PATH = 1.5
"""A path through noise alone follows what is brightest, so many times the power of the noise."""
GAP_MM = (0.06, 0.08)
"""There is nothing between so far behind the outer face and so far before the nominal wall."""
BONE_MM = (0.02, 0.1)
"""Range behind the wall in which bone is looked for."""
BONE_SHARE = 0.75
"""Share of the A-scans that may be openings at most."""
OPENING_MM = 0.05
"""A surface farther behind the nominal wall than this belongs to an opening."""
PLAIN_MM = 0.03
"""A surface nearer to the nominal wall than this is the bore's own."""
CLEAR_MM = 0.015
"""Distance over which the nominal wall and the surface are blurred."""
PATCH_MM = 0.1
"""Averaged over so much of θ, speckle is as bright as bone."""
FEWEST_ROWS = 2
BRIGHT, DARK = 0.5, 0.25
"""Of the way from darkness to bone: what reaches more is bright, what reaches less is dark."""


def trusted(level: Image, row: NDArray[np.intp], background: Background, spacing: Spacing) -> Mask:
    """Return for every A-scan of a logarithmic B-scan (θ, depth) whether its surface at ``row`` is the wall's.

    It is not where a bright surface has nothing behind it while the wall elsewhere in the slice has. There, something
    opaque, such as a guide wire or a clot, lies before the wall. Nor is it next to that, where the shadow shows no
    surface (``row`` = n_depth). Elsewhere no surface means a cell whose floor is out of range, which is trusted.
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


def wall_sigmas(level: Image, row: NDArray[np.intp], trusted: Mask, background: Background, spacing: Spacing) -> float:
    """Return by how many standard errors the wall stands out of the noise, over 0.1 × 0.1 mm of it.

    That is the power just behind the surface at ``row``, in excess of what a path through noise alone would show. It is
    the median over all such patches where ``trusted`` A-scans show a surface. It is 0 where there are none, or where
    the power is less than that of noise.
    """
    n_depth = level.shape[1]
    depth, width = max(1, round(SQUARE_MM / spacing.depth_mm)), max(1, round(SQUARE_MM / spacing.column_mm))
    seen = trusted[:, None] & (row[:, None] + np.arange(depth) < n_depth)
    power = (
        relative_power(rows_from(level, row, depth), background.noise, spread_of_noise(background))
        / background.noise_power
    )
    power = np.where(seen, np.minimum(power, MOST_POWER), 0).sum(axis=1, dtype=np.float64)
    looks, total = (uniform_filter1d(each, width, mode="wrap") for each in (seen.sum(axis=1, dtype=np.float64), power))
    full = looks > depth / 2
    if not full.any():
        return 0.0
    excess = float(np.median(total[full] / looks[full])) - POWER_OF_A_PATH
    return max(0.0, excess * math.sqrt(depth * width))


def _mean(level: Image, first: NDArray[np.intp], last: NDArray[np.intp]) -> Coordinates:
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


@dataclass(frozen=True)
class RawLevels:
    """How bright, in a recording's logarithmic samples, the ``darkness`` before the wall is, and the ``bone`` in it."""

    darkness: float
    bone: float


@dataclass(frozen=True)
class SecondLook:
    """Shares of a turn, 0 to 1.

    Attributes: ``openings``, where the surface lies clearly behind the bore's own wall, or there is none;
    ``bone_before``, the part of these in which there is bone where the wall would be; ``dark_wall``, where the surface
    is the bore's own wall and darkness is behind it.
    """

    openings: float
    bone_before: float
    dark_wall: float


def measure_raw_levels(
    slices: Sequence[SliceFeatures], faces: Faces, lines: Mask, acquisition: OctAcquisition
) -> RawLevels:
    """Return the levels of a recording by A-scans of its ``slices``, in the order of ``faces``.

    ``lines``, bool (n_depth,): rows that do not count. Both levels are NaN where there is no gap before the wall.
    """
    pool, mm = pooled(slices, faces, acquisition), acquisition.mm_per_px
    gap = _means(pool.ascans, (pool.face_mm + GAP_MM[0]) / mm, (pool.wall_mm - GAP_MM[1]) / mm, lines)
    bone = _means(pool.ascans, (pool.wall_mm + BONE_MM[0]) / mm, (pool.wall_mm + BONE_MM[1]) / mm, lines)
    if not (np.isfinite(gap).any() and np.isfinite(bone).any()):
        return RawLevels(np.nan, np.nan)
    return RawLevels(float(np.nanmedian(gap)), float(np.nanquantile(bone, BONE_SHARE)))


def look_again(
    samples: NDArray[Any],
    row: NDArray[np.intp],
    wall_mm: Coordinates,
    trusted: Mask,
    lines: Mask,
    levels: RawLevels,
    spacing: Spacing,
) -> SecondLook:
    """Return what a B-scan (θ, depth), logarithmic and as recorded, says against a surface at ``row`` (θ,).

    ``row`` is n_depth where there is none; ``wall_mm``, float64 (θ,), the depth of the nominal wall; ``trusted``, bool
    (θ,), the columns that count; ``lines``, bool (depth,), rows that do not.
    """
    mm = spacing.depth_mm
    n_depth = samples.shape[1]
    behind_mm = np.where(row < n_depth, row * mm - wall_mm, np.inf)
    opening, plain = trusted & (behind_mm > OPENING_MM), trusted & (np.abs(behind_mm) < PLAIN_MM)
    last_mm = wall_mm + np.minimum(behind_mm - CLEAR_MM, BONE_MM[1])
    before = _means(samples, (wall_mm + CLEAR_MM) / mm, last_mm / mm, lines)
    behind = _means(samples, (wall_mm + BONE_MM[0]) / mm, (wall_mm + BONE_MM[1]) / mm, lines)
    width = max(1, round(PATCH_MM / spacing.column_mm)) | 1
    contrast = levels.bone - levels.darkness
    if not contrast > 0:
        return SecondLook(float(opening.mean()), 0.0, 0.0)
    bright = _patches(before, opening, width) > levels.darkness + BRIGHT * contrast
    dark = _patches(behind, plain, width) < levels.darkness + DARK * contrast
    return SecondLook(float(opening.mean()), float(bright.mean()), float(dark.mean()))


def _means(samples: NDArray[Any], first: Coordinates, last: Coordinates, lines: Mask) -> Coordinates:
    """The mean of each A-scan over its rows from ``first`` (n,) to ``last`` that are under no line; NaN of too few."""
    low, high = (np.clip(np.rint(edge), 0, samples.shape[1]).astype(np.intp) for edge in (first, last))
    return _means_between(samples, low, high, lines)


@compiled
def _means_between(samples: NDArray[Any], low: NDArray[np.intp], high: NDArray[np.intp], lines: Mask) -> Coordinates:
    means = np.empty(len(samples))
    for column in range(len(samples)):
        total, count = 0.0, 0
        for row in range(low[column], high[column]):
            if not lines[row]:
                total += samples[column, row]
                count += 1
        means[column] = total / count if count >= FEWEST_ROWS else np.nan
    return means


def _patches(values: Coordinates, where: Mask, width: int) -> Coordinates:
    """``values`` (θ,) averaged over those ``where`` they count within ``width`` columns; NaN elsewhere."""
    counted = where & np.isfinite(values)
    share = uniform_filter1d(counted.astype(np.float64), width, mode="wrap")
    total = uniform_filter1d(np.where(counted, values, 0.0), width, mode="wrap")
    return np.where(counted, total / np.maximum(share, 1e-9), np.nan)
