"""What a strip keeps of each A-scan: its maximum beyond the capillary."""

import numpy as np

from endoct.modalities.oct.surface.wall import Rows
from endoct.stitching.arrays import Image


def maximum_intensity(image: Image, first_row: Rows) -> Image:
    """Return the maximum of each A-scan of ``image`` (n, depth) cropped from ``first_row`` (n,) on, float32 (n,).

    Laves 2019, Extracting mastoid pattern: crop, then maximum intensity projection along depth.
    """
    beyond = np.arange(image.shape[1]) >= first_row[:, None]
    return np.asarray(np.max(image, axis=1, where=beyond, initial=float(image.min())), dtype=np.float32)
