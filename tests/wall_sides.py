"""What two sides show of a small bore with discs for cells, made up."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.fusion.wall.both_sides import BothSides, MeasuredRows
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(150, 400, z0_mm=1.0, dz_mm=0.02, radius_mm=1.25)
ROWS_MM = np.arange(0.0, 5.0, 0.2)
NAMES = "endoscope", "oct"


def disc(z_mm: float, theta_rad: float, radius_mm: float) -> Mask:
    """Return a round cell, which may cross the seam."""
    away = np.abs(np.mod(GRID.theta_rad - theta_rad + np.pi, 2 * np.pi) - np.pi) * GRID.radius_mm
    return np.asarray(np.hypot(GRID.z_mm[:, None] - z_mm, away) < radius_mm)


def sides(light: Mask, depth: Mask, relief_mm: NDArray[np.float64] | None = None, **changed: object) -> BothSides:
    """Return what an endoscope and an OCT show of ``light`` and ``depth``: floors 0.3 mm deep, a little noise."""
    noise = np.random.default_rng(0).normal(0, 0.004, GRID.shape)
    relief = (np.where(depth, 0.3, 0.0) if relief_mm is None else relief_mm) + noise
    nowhere = np.full(GRID.shape, np.nan, np.float32)
    on_rows = np.searchsorted(GRID.z_mm, ROWS_MM[5:20])
    made = BothSides(
        grid=GRID,
        depth_side=1,
        light_side=0,
        cells=(light, depth),
        observed=(np.ones(GRID.shape, np.bool_), np.ones(GRID.shape, np.bool_)),
        probability=np.where(light, 0.98, 0.02).astype(np.float32),
        relief_mm=relief.astype(np.float32),
        parallax_mm=nowhere,
        parallax_error_mm=nowhere,
        light_mm=nowhere,
        light_error_mm=nowhere,
        darkness=np.where(light, np.float32(1), np.float32(0)),
        rows=MeasuredRows(
            z_mm=ROWS_MM[5:20],
            relief_mm=relief[on_rows].astype(np.float32),
            cells=depth[on_rows].astype(np.float32),
            brightness=np.zeros((on_rows.size, GRID.n_theta), np.float32),
        ),
    )
    return replace(made, **changed)  # type: ignore[arg-type]
