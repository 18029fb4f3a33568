"""Where a wall is as dark as an opening, and what depth by parallax is worth there.

A rim hides part of a floor, and what is seen instead is a side of the cell. That looks alike from all frames at several
depths, so the depth is drawn to the wall's. An opening that does not lie behind the wall is therefore less sure than
its costs say. If the optics are assumed, the frames may have next to no parallax: then no opening lies behind the wall.
"""

import cv2
import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import pad_circle
from endoct.modalities.endoscope.light import DARKEST
from endoct.stitching.panorama import Panorama

AROUND_MM, GRAIN_MM = 1.5, 0.05
"""A place of the second size is held against the brighter half of what lies so far around."""
DARK, DARKEST_WALL = 0.08, 0.2
"""It is as dark as an opening from the first to the second on, in the logarithm of the intensity."""
SHALLOW_MM = 0.2
"""An opening is doubted the less, the deeper it lies, and not from here on."""
DOUBTED = 3.0
"""The spread of the depths of an opening that lies with the wall counts so many times more."""
FEWEST = 200
"""Openings of fewer samples than this do not judge assumed optics."""


def darkness(panorama: Panorama) -> Image:
    """Return how surely each sample is dark as an opening, 0 to 1, float32 (n_z, n_theta)."""
    grid = panorama.grid
    logs = np.log(np.maximum(panorama.intensity, np.float32(DARKEST))).astype(np.float32)
    seen = panorama.valid.astype(np.float32)

    def mean(where: Image, size_mm: float) -> Image:
        along, around = (2 * int(size_mm / step / 2) + 1 for step in (grid.dz_mm, grid.dtheta_mm))
        beyond = min(around // 2, grid.n_theta)
        kept = slice(beyond, beyond + grid.n_theta)
        total, weight = (
            cv2.blur(pad_circle(each, beyond), (2 * beyond + 1, along), borderType=cv2.BORDER_REPLICATE)[:, kept]
            for each in (logs * where, where)
        )
        return np.asarray(np.divide(total, weight, out=logs.copy(), where=weight > 0), dtype=np.float32)

    bright = seen * (logs >= mean(seen, AROUND_MM))
    darker = mean(bright, AROUND_MM) - mean(seen, GRAIN_MM)
    return np.where(panorama.valid, np.clip((darker - DARK) / (DARKEST_WALL - DARK), 0, 1), np.float32(0))


def more_error_mm(dark: Image, depth_mm: Image, spread_mm: Image) -> Image:
    """Return by how much openings are less sure than their ``spread_mm``, mm, all of them of one shape.

    ``dark``: by :func:`darkness`. ``depth_mm``: from the wall.
    """
    shallow = np.clip(1 - depth_mm / SHALLOW_MM, 0, 1)
    return np.asarray(DOUBTED * spread_mm * dark * shallow, dtype=np.float32)


def lie_behind(dark: Image, depth_mm: Image, known: Mask) -> bool:
    """Say whether openings lie behind the wall, as far as their ``depth_mm`` is ``known``; True where there are few.

    One in ten has to be deeper than nine in ten of the rest by ``SHALLOW_MM``.
    """
    opening, wall = known & (dark > 0.5), known & (dark == 0)
    if min(opening.sum(), wall.sum()) < FEWEST:
        return True
    return bool(np.quantile(depth_mm[opening], 0.9) - np.quantile(depth_mm[wall], 0.9) > SHALLOW_MM)
