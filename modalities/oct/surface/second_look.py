"""A second look at a surface that was found, by means that share nothing with how it was found.

An opening is dark where the bore's wall would be, and the wall is bright: two levels of the recording, as recorded, say
which is which. No noise floor is taken off, no evidence summed up, no path followed. So this knows nothing of the bore
that the search does not, and finds no surface; but where a whole patch of wall was erased, or cells were walled up, it
contradicts, whatever the cause.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.levels import pooled

GAP_MM = (0.06, 0.08)  # behind the outer face, and before the nominal wall: between these there is nothing
BONE_MM = (0.02, 0.1)  # behind the wall
BONE_SHARE = 0.75  # of the A-scans, up to so many may be openings
OPENING_MM = 0.05  # behind the nominal wall, from which a surface is that of an opening
PLAIN_MM = 0.03  # from the nominal wall: as near, it is the bore's own
CLEAR_MM = 0.015  # from the nominal wall and from the surface, where both are blurred
PATCH_MM = 0.1  # along θ: averaged over that, speckle is as bright as bone
FEWEST_ROWS = 2
BRIGHT, DARK = 0.5, 0.25  # of the way from darkness to bone


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
