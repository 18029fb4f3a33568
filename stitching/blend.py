"""Strips to one panorama: a weighted mean wherever they overlap."""

from collections.abc import Iterable

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.strip import Strip

ROW_TOLERANCE_MM = 1e-6


@np.errstate(invalid="ignore")  # of samples that are not valid
def blend(strips: Iterable[Strip], grid: SurfaceGrid, row_z_mm: Coordinates) -> tuple[Image, Image | None, Mask, Image]:
    """Return (intensity, depth_mm or None, valid, weight), each (n_z, n_theta), of all ``strips``.

    Every strip's rows must be among ``row_z_mm`` and its columns must be the grid's: plug-ins sample
    straight onto the panorama, so nothing is interpolated twice. The strips' order decides nothing but the
    last bit of rounding. Raises :class:`EndoctError` for a strip off the grid.
    """
    total = np.zeros(grid.shape)
    total_depth: np.ndarray | None = None
    weight = np.zeros(grid.shape)
    for strip in strips:
        rows = _rows_of(strip, grid, row_z_mm)
        own_weight = strip.weight.astype(np.float64)
        np.add(weight[rows], own_weight, out=weight[rows], where=strip.valid)
        np.add(total[rows], own_weight * strip.intensity, out=total[rows], where=strip.valid)
        if strip.depth_mm is not None:
            if total_depth is None:
                total_depth = np.zeros(grid.shape)
            np.add(total_depth[rows], own_weight * strip.depth_mm, out=total_depth[rows], where=strip.valid)
    valid = weight > 0
    mean = np.divide(total, weight, out=total, where=valid).astype(np.float32)
    if total_depth is None:
        return mean, None, valid, weight.astype(np.float32)
    total_depth[~valid] = np.nan
    depth = np.divide(total_depth, weight, out=total_depth, where=valid).astype(np.float32)
    return mean, depth, valid, weight.astype(np.float32)


def _rows_of(strip: Strip, grid: SurfaceGrid, row_z_mm: Coordinates) -> slice:
    first = int(np.searchsorted(row_z_mm, strip.z_mm[0] - ROW_TOLERANCE_MM)) if strip.z_mm.size else 0
    rows = slice(first, first + strip.z_mm.size)
    if (
        strip.theta_rad.shape != (grid.n_theta,)
        or not np.allclose(strip.theta_rad, grid.theta_rad, rtol=0, atol=1e-9)
        or row_z_mm[rows].shape != strip.z_mm.shape
        or not np.allclose(row_z_mm[rows], strip.z_mm, rtol=0, atol=ROW_TOLERANCE_MM)
    ):
        raise EndoctError(
            "a strip does not lie on its panorama's grid",
            found=f"{strip.z_mm.size} rows × {strip.theta_rad.size} columns",
            expected="consecutive rows of the calibration's row_z_mm and all columns of its grid",
        )
    return rows
