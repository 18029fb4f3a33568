"""What a strip keeps of each A-scan: its maximum beyond the capillary."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.surface.largest import largest
from endoct.modalities.oct.surface.line_removal import Bridges, bridge_ascan, bridges_over
from endoct.modalities.oct.surface.wall import Rows
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.compiled import compiled


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
    ascan = np.empty(n_depth, np.float32)
    for i in range(n_ascans):
        for row in range(n_depth):
            ascan[row] = np.float32(samples[i, row])
        bridge_ascan(ascan, bridges)
        maxima[i] = largest(ascan[first_row[i] :])
    return maxima
