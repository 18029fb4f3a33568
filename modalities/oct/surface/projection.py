"""What a strip keeps of each A-scan: its maximum beyond the capillary."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.surface.line_removal import Bridges, bridge_ascan, bridges_over
from endoct.modalities.oct.surface.wall import Rows
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.compiled import compiled

AT_ONCE = 16  # rows whose maxima are kept apart, so that a processor takes them as a vector


def maximum_intensity(samples: NDArray[Any], first_row: Rows, lines: Mask) -> Image:
    """Return the maximum of each A-scan of ``samples`` (n, depth) cropped from ``first_row`` (n,) on, float32 (n,).

    The rows ``lines``, bool (depth,), are interpolated from their neighbours. Laves 2019, Extracting mastoid pattern:
    crop, then maximum intensity projection along depth.
    """
    return _maxima(samples, first_row, bridges_over(lines))


@compiled
def _maxima(samples: NDArray[Any], first_row: Rows, bridges: Bridges) -> Image:
    n_ascans, n_depth = samples.shape
    maxima = np.empty(n_ascans, np.float32)
    ascan, highest = np.empty(n_depth, np.float32), np.empty(AT_ONCE, np.float32)
    for i in range(n_ascans):
        for row in range(n_depth):
            ascan[row] = np.float32(samples[i, row])
        bridge_ascan(ascan, bridges)
        first = first_row[i]
        blocks = (n_depth - first) // AT_ONCE
        highest[:] = ascan[n_depth - 1]
        for block in range(blocks):
            for k in range(AT_ONCE):
                highest[k] = max(highest[k], ascan[first + block * AT_ONCE + k])
        for row in range(first + blocks * AT_ONCE, n_depth):
            highest[0] = max(highest[0], ascan[row])
        maxima[i] = highest.max()
    return maxima
