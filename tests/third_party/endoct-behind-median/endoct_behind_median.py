"""A method for `endoct bench segmentation`: cells are what lies 60 µm behind the median of its slice."""

import numpy as np

from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.task import Declined


def behind_median(panorama: Panorama) -> np.ndarray:
    """Return the cells of ``panorama`` on its own samples, bool (n_z, n_theta)."""
    if panorama.depth_mm is None:
        raise Declined("there is no depth to go by")
    slices = zip(panorama.depth_mm, panorama.valid, strict=True)
    return np.array([row > np.median(row[seen]) + 0.06 if seen.any() else seen for row, seen in slices])
