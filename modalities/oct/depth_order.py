"""Which way depth runs in B-scans: tissue is brightest at its surface and fades behind it."""

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d

from endoct.base.arrays import Image
from endoct.base.numeric.ranks import quantiles
from endoct.modalities.oct.bscan import reduce_theta

SECTORS = 128
WINDOW = 0.05
"""Part of the depth: wider than the lines of sheath and capillary, narrower than the visible tissue."""
UPSIDE_DOWN = 0.4
"""Depth runs the wrong way where fewer of the sectors brighten so, in the mean of several B-scans."""
STEADY = 0.1
"""What nine in ten sectors reach at a depth is no tissue: the sheath fades with depth as tissue does, and noise has
bands."""


def share_brightening(bscan: Image) -> float:
    """Return in which share of its sectors a B-scan (A-scan, depth) brightens with depth faster than it darkens.

    Thin lines are left out, since they do both, and what is there all around.
    """
    sectors = reduce_theta(bscan, min(SECTORS, bscan.shape[0]))
    sectors = (sectors - quantiles(sectors, STEADY)).astype(np.float32)
    size = max(3, round(WINDOW * sectors.shape[1]))
    window, ends = np.ones((1, size | 1), np.uint8), cv2.BORDER_REFLECT
    opened = cv2.dilate(cv2.erode(sectors, window, borderType=ends), window, borderType=ends)
    smooth = uniform_filter1d(opened, size, axis=1)
    rise = smooth[:, size:] - smooth[:, :-size]
    return float(np.mean(rise.max(axis=1) > -rise.min(axis=1)))
