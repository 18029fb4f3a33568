"""What there is to export, image by image, read in blocks of rows: no image need fit into memory."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.window import StoredImage

Quantity = Literal["intensity", "relief"]
Ids = NDArray[np.uint16]
NOWHERE = -1
FARTHEST_ROW = 0.75
"""How far, in row spacings, a place may lie from the nearest row and still show what that observed."""
_EVEN = 1e-3
"""Rows that lie no farther from even steps, in row spacings, lie evenly."""


@dataclass(frozen=True, eq=False)
class Layer:
    """An image of the wall on the even rows of a source's grid: of ``side``, its ``quantity``, in ``unit``.

    ``rows`` (n_z,) says which row of the stored images every row is, :data:`NOWHERE` for none. ``valid`` is where it
    was observed; None: wherever it is a number.
    """

    name: str
    side: str
    quantity: Quantity
    unit: str
    image: StoredImage
    valid: StoredImage | None
    rows: NDArray[np.intp]

    def read(self, start: int, stop: int) -> Image:
        """Return the rows from ``start`` to before ``stop``, float32 (rows, n_theta), NaN where nothing was observed.

        Raises :class:`EndoctError` where the store is damaged.
        """
        rows = self.rows[start:stop]
        image = np.full((rows.size, self.image.shape[1]), np.nan, np.float32)
        there = rows != NOWHERE
        if not there.any():
            return image
        first, last = int(rows[there].min()), int(rows[there].max()) + 1
        window, everywhere = slice(first, last), slice(0, self.image.shape[1])
        stored = self.image.read(window, everywhere).astype(np.float32, copy=False)
        if self.valid is not None:
            stored[~self.valid.read(window, everywhere).astype(np.bool_, copy=False)] = np.nan
        image[there] = stored[rows[there] - first]
        return image


@dataclass(frozen=True, eq=False)
class LabelLayer:
    """An image of whole numbers, uint16 on a source's grid: ids of cells, or 1 where something is so and else 0."""

    name: str
    side: str
    read: Callable[[], Ids]


def even_rows(grid: SurfaceGrid) -> tuple[SurfaceGrid, NDArray[np.intp]]:
    """Return ``grid`` with rows at even steps, and which of its own rows each of them is nearest to.

    :data:`NOWHERE` where none is near. Files that know one step only hold such rows; nothing is interpolated.
    """
    z_mm = grid.z_mm
    n_z = max(1, round(float(z_mm[-1] - z_mm[0]) / grid.dz_mm) + 1)
    even = SurfaceGrid.full_circle(
        n_z,
        grid.n_theta,
        z0_mm=float(z_mm[0]),
        dz_mm=grid.dz_mm,
        radius_mm=grid.radius_mm,
        theta0_rad=grid.theta0_rad,
    )
    if lies_evenly(grid):
        return even, np.arange(n_z)
    nearest = np.clip(np.rint(grid.row_of(even.z_mm)).astype(np.intp), 0, grid.n_z - 1)
    near = np.abs(z_mm[nearest] - even.z_mm) <= FARTHEST_ROW * grid.dz_mm
    return even, np.where(near, nearest, NOWHERE)


def lies_evenly(grid: SurfaceGrid) -> bool:
    """Say whether the rows of ``grid`` lie at even steps, but for what rounding left."""
    even_mm = grid.z_mm[0] + grid.dz_mm * np.arange(grid.n_z)
    return bool(np.abs(grid.z_mm - even_mm).max() <= _EVEN * grid.dz_mm)
