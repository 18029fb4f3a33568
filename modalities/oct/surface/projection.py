"""What a strip keeps of each A-scan: its maximum beyond the capillary."""

import numpy as np

from endoct.modalities.oct.surface.wall import Rows
from endoct.stitching.arrays import Image
from endoct.stitching.compiled import compiled


def maximum_intensity(image: Image, first_row: Rows) -> Image:
    """Return the maximum of each A-scan of ``image`` (n, depth) cropped from ``first_row`` (n,) on, float32 (n,).

    Laves 2019, Extracting mastoid pattern: crop, then maximum intensity projection along depth.
    """
    return _maxima(image, first_row, image.min())


@compiled
def _maxima(image: Image, first_row: Rows, least: np.float32) -> Image:
    maxima = np.full(len(image), least, np.float32)
    for column in range(len(image)):
        for row in range(first_row[column], image.shape[1]):
            maxima[column] = max(maxima[column], image[column, row])
    return maxima
