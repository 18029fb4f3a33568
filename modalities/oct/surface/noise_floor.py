"""The noise floor of a recording over depth: a spectrometer's noise is not white, so that it lies in bands over depth.

Half a decibel matters: a wall in a faint recording is told from noise by the power of many samples together.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.pool import FEWEST_ASCANS, pooled
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.compiled import compiled
from endoct.stitching.ranks import median, ranked
from endoct.stitching.robust import robust_sigma

FACE_MM = 0.06  # behind the outer face, which is still in view there
WALL_MM = 0.08  # before the nominal wall: nearer to it, a wall that is not quite there may lie
AROUND_MM = 0.2  # before and behind a sample, by which is judged whether it lies in the dark
OWN_MM = 0.015  # of that, as good as the sample itself: the noise that happens to be darkest is darker than noise is
DARK_SHARE = 0.1  # of the A-scans at one depth: in openings of cells, where there are enough of them
SLACK_SIGMAS = 0.25  # of the noise: farther beyond what the gap shows, bands do not reach, and it is bone
SMOOTH_MM = 0.03


def measure_floor(slices: Sequence[SliceFeatures], faces: Faces, lines: Mask, acquisition: OctAcquisition) -> Image:
    """Return by how much the noise at every depth is brighter than noise typically is, float32 (n_depth,).

    ``slices`` in the order of ``faces``; ``lines``, bool (n_depth,), the detector's fixed lines. Only in the gap
    between glass and wall can there be nothing but noise; a catheter off the axis sees that gap at many depths. At each
    of them the floor is the median of the A-scans that are darkest around it, no more of them than see the gap there.
    Deeper than any gap, the darkest tenth of the A-scans are openings of cells, or else bone: they count where they are
    as dark as the gap is somewhere. All other depths are as those next to them.
    """
    pool = pooled(slices, faces, acquisition)
    n_depth = pool.ascans.shape[1]
    mm_per_px = acquisition.mm_per_px
    depth_mm = np.arange(n_depth) * mm_per_px
    clear = (depth_mm > pool.face_mm[:, None] + FACE_MM) & ~lines
    in_gap = clear & (depth_mm < pool.wall_mm[:, None] - WALL_MM)
    if not in_gap.any():
        return np.zeros(n_depth, np.float32)
    around = _mean_around(pool.ascans, clear, round(AROUND_MM / mm_per_px), round(OWN_MM / mm_per_px))
    tenth = np.ceil(DARK_SHARE * np.count_nonzero(clear, axis=0)).astype(np.intp)
    of_gap = np.count_nonzero(in_gap, axis=0)
    gap = of_gap >= FEWEST_ASCANS
    level, weight = _darkness(pool.ascans, clear, around, np.where(gap, np.minimum(tenth, of_gap), tenth))
    smooth = _smoothed(level, np.where(gap, weight, 0), mm_per_px)
    noise = pool.ascans[in_gap]
    slack = SLACK_SIGMAS * robust_sigma(noise - median(noise))
    low, high = smooth[gap].min() - slack, smooth[gap].max() + slack
    weight[~gap & ((level < low) | (level > high))] = 0
    known = weight > 0
    smooth = _smoothed(level, weight, mm_per_px)
    floor = np.interp(np.arange(n_depth), np.flatnonzero(known), smooth[known] - np.median(smooth[gap]))
    return np.asarray(floor, dtype=np.float32)


def _darkness(
    ascans: Image, candidates: Mask, around: Coordinates, count: NDArray[np.intp]
) -> tuple[Coordinates, Coordinates]:
    """Return the median of the ``candidates`` that are darkest ``around``, and of how many, at every depth."""
    dark = candidates & (around <= ranked(around, candidates, np.maximum(count - 1, 0)))
    count = np.count_nonzero(dark, axis=0)
    known = count >= FEWEST_ASCANS
    lower, upper = (ranked(ascans, dark, middle) for middle in (np.maximum(count - 1, 0) // 2, count // 2))
    return np.where(known, (lower + upper) / 2, 0.0), np.where(known, count, 0).astype(np.float64)


def _smoothed(level: Coordinates, weight: Coordinates, mm_per_px: float) -> Coordinates:
    """Return ``level`` smoothed over depth where it is known, 0 elsewhere."""
    sigma_px = SMOOTH_MM / mm_per_px
    total = gaussian_filter1d(weight * level, sigma_px, mode="constant")
    count = gaussian_filter1d(weight, sigma_px, mode="constant")
    return np.asarray(np.divide(total, count, out=np.zeros_like(total), where=weight > 0))


@compiled
def _mean_around(ascans: Image, counted: Mask, reach_px: int, own_px: int) -> Coordinates:
    """Return the mean of the ``counted`` samples around each one, but for its own; infinite where it is not counted."""
    n, n_depth = ascans.shape
    around = np.full((n, n_depth), np.inf)
    total, count = np.zeros(n_depth + 1), np.zeros(n_depth + 1)
    for i in range(n):
        for row in range(n_depth):
            total[row + 1] = total[row] + (ascans[i, row] if counted[i, row] else 0)
            count[row + 1] = count[row] + counted[i, row]
        for row in range(n_depth):
            if counted[i, row]:
                first, last = max(row - reach_px, 0), min(row + reach_px + 1, n_depth)
                own_first, own_last = max(row - own_px, 0), min(row + own_px + 1, n_depth)
                level = (total[last] - total[first]) - (total[own_last] - total[own_first])
                n_around = (count[last] - count[first]) - (count[own_last] - count[own_first])
                around[i, row] = level / max(n_around, 1)
    return around
