"""Bores far wider than those in bone, seen as one of 2.5 mm: what is found by lengths grows with the bore.

A cell in bone has its size whether the bore has 2.2 mm or 2.8 mm, so that lengths are in mm there. In a hole forty
times as wide, a length in mm is a share of the bore. There the wall is looked at as if the bore had 2.5 mm.
"""

from dataclasses import replace

import numpy as np

from endoct.base.arrays import Image
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

REFERENCE_RADIUS_MM = 1.25
WIDEST_IN_BONE_MM = 5.0
"""Up to this radius, lengths are in mm."""


def bore_scale(radius_mm: float) -> float:
    """Return how many times as wide as one of 2.5 mm a bore is to be seen; 1 for every bore in bone."""
    return radius_mm / REFERENCE_RADIUS_MM if radius_mm > WIDEST_IN_BONE_MM else 1.0


def scaled_grid(grid: SurfaceGrid, factor: float) -> SurfaceGrid:
    """Return ``grid`` with every length times ``factor``."""
    rows = None if grid.rows_mm is None else tuple(factor * z for z in grid.rows_mm)
    lengths = {name: factor * getattr(grid, name) for name in ("z0_mm", "dz_mm", "radius_mm")}
    return replace(grid, **lengths, rows_mm=rows)


def scaled_panorama(panorama: Panorama, factor: float) -> Panorama:
    """Return ``panorama`` with its places and depths times ``factor``; values per frame stay."""

    def scaled(image: Image | None) -> Image | None:
        return None if image is None else np.float32(factor) * image

    return replace(
        panorama,
        grid=scaled_grid(panorama.grid, factor),
        depth_mm=scaled(panorama.depth_mm),
        parallax_depth_mm=scaled(panorama.parallax_depth_mm),
        parallax_error_mm=scaled(panorama.parallax_error_mm),
    )
