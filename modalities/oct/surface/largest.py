"""The largest of many values by vectors: a loop that keeps one maximum waits for every comparison."""

import numpy as np

from endoct.stitching.arrays import Image
from endoct.stitching.compiled import compiled

AT_ONCE = 16  # maxima that are kept apart, so that a processor takes them as a vector


@compiled
def largest(values: Image) -> np.float32:
    """Return the largest of ``values``, float32 (n,), n from 1; none of them is NaN."""
    highest = np.full(AT_ONCE, values[-1])
    blocks = values.size // AT_ONCE
    for block in range(blocks):
        for k in range(AT_ONCE):
            highest[k] = max(highest[k], values[block * AT_ONCE + k])
    most = highest.max()
    for i in range(blocks * AT_ONCE, values.size):
        most = max(most, values[i])
    return np.float32(most)
