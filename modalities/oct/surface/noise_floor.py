"""The noise floor of a recording over depth: a spectrometer's noise is not white, so that it lies in bands over depth.

Half a decibel matters: a wall in a faint recording is told from noise by the power of many samples together.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.pool import FEWEST_ASCANS, pooled
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.compiled import compiled
from endoct.stitching.ranks import ranked

FACE_MM = 0.06  # behind the outer face, which is still in view there
AROUND_MM = 0.2  # before and behind a sample, by which is judged whether it lies in the dark
OWN_MM = 0.015  # of that, as good as the sample itself: the noise that happens to be darkest is darker than noise is
DARK_SHARE = 0.1  # of the A-scans at one depth: hardly a bore has fewer cells
SMOOTH_MM = 0.03


def measure_floor(slices: Sequence[SliceFeatures], faces: Faces, lines: Mask, acquisition: OctAcquisition) -> Image:
    """Return by how much the noise at every depth is brighter than noise typically is, float32 (n_depth,).

    ``slices`` in the order of ``faces``; ``lines``, bool (n_depth,), the detector's fixed lines. At each depth it is
    the median of the A-scans that are darkest around it, behind the outer face; so faint light that is behind the
    wall everywhere counts as noise. Where all of it lies before the face, and under lines, it is as next to that.
    """
    pool = pooled(slices, faces, acquisition)
    n_depth = pool.ascans.shape[1]
    mm_per_px = acquisition.mm_per_px
    clear = np.arange(n_depth) * mm_per_px - pool.face_mm[:, None] > FACE_MM
    clear &= ~lines
    around = _mean_around(pool.ascans, clear, round(AROUND_MM / mm_per_px), round(OWN_MM / mm_per_px))
    last = np.maximum(np.ceil(DARK_SHARE * np.count_nonzero(clear, axis=0)).astype(np.intp) - 1, 0)
    dark = clear & (around <= ranked(around, clear, last))
    count = np.count_nonzero(dark, axis=0)
    known = count >= FEWEST_ASCANS
    if not known.any():
        return np.zeros(n_depth, np.float32)
    level = np.zeros(n_depth)
    lower, upper = (ranked(pool.ascans, dark, middle) for middle in (np.maximum(count - 1, 0) // 2, count // 2))
    level[known] = (lower[known] + upper[known]) / 2
    weight = np.where(known, count, 0).astype(np.float64)
    sigma_px = SMOOTH_MM / mm_per_px
    smooth = gaussian_filter1d(weight * level, sigma_px, mode="constant")[known]
    smooth /= gaussian_filter1d(weight, sigma_px, mode="constant")[known]
    floor = np.interp(np.arange(n_depth), np.flatnonzero(known), smooth - np.median(smooth))
    return np.asarray(floor, dtype=np.float32)


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
