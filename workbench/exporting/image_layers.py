"""What there is to export, image by image, read in blocks of rows: no image need fit into memory.

Coarser levels are for viewers that zoom: averages of what was observed, around the circle.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.base.zarr.window import StoredImage
from endoct.stitching.grid import SurfaceGrid

Quantity = Literal["intensity", "relief"]
Ids = NDArray[np.uint16]
NOWHERE = -1
FARTHEST_ROW = 0.75
"""A place shows what the nearest row observed up to this distance, in row spacings."""
_EVEN = 1e-3
"""Rows lie evenly that are no farther than this from even steps, in row spacings."""
COARSEST_PX = 512
"""Largest size of the last level in either direction."""
_BLOCK_ROWS = 256
_UNEVEN = 1.5
"""An axis is left as it is while its samples are this many times as long as those of the other."""


@dataclass(frozen=True, eq=False)
class ImageLayer:
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

    @property
    def title(self) -> str:
        """Its name, with the unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

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
    kept = {"dz_mm": grid.dz_mm, "radius_mm": grid.radius_mm, "theta0_rad": grid.theta0_rad}
    even = SurfaceGrid.full_circle(n_z, grid.n_theta, z0_mm=float(z_mm[0]), **kept)
    if lies_evenly(grid):
        return even, np.arange(n_z)
    nearest = np.clip(np.rint(grid.row_of(even.z_mm)).astype(np.intp), 0, grid.n_z - 1)
    near = np.abs(z_mm[nearest] - even.z_mm) <= FARTHEST_ROW * grid.dz_mm
    return even, np.where(near, nearest, NOWHERE)


def lies_evenly(grid: SurfaceGrid) -> bool:
    """Say whether the rows of ``grid`` lie at even steps, but for what rounding left."""
    even_mm = grid.z_mm[0] + grid.dz_mm * np.arange(grid.n_z)
    return bool(np.abs(grid.z_mm - even_mm).max() <= _EVEN * grid.dz_mm)


@dataclass(frozen=True)
class PyramidLevel:
    """A level: how many rows and columns of the finest each of its samples averages; its shape, (n_z, n_theta)."""

    rows: int
    columns: int
    shape: tuple[int, int]

    def step_mm(self, grid: SurfaceGrid) -> tuple[float, float]:
        """Return the distance of its samples along z and, on the nominal wall, along θ."""
        return self.rows * grid.dz_mm, self.columns * grid.dtheta_mm

    def origin_mm(self, grid: SurfaceGrid) -> tuple[float, float]:
        """Return where the centre of its first sample lies: z, and the arc from θ = 0 on the nominal wall."""
        return (
            grid.z0_mm + (self.rows - 1) / 2 * grid.dz_mm,
            grid.theta0_rad * grid.radius_mm + (self.columns - 1) / 2 * grid.dtheta_mm,
        )


def levels_of(grid: SurfaceGrid) -> tuple[PyramidLevel, ...]:
    """Return the levels of images on ``grid``, the finest first; samples that are not square become so on the way."""
    levels = [PyramidLevel(1, 1, grid.shape)]
    while max(levels[-1].shape) > COARSEST_PX:
        last = levels[-1]
        z_mm, theta_mm = last.step_mm(grid)
        n_z, n_theta = last.shape
        halve_rows, halve_columns = z_mm < _UNEVEN * theta_mm and n_z > 1, theta_mm < _UNEVEN * z_mm and n_theta > 1
        if not (halve_rows or halve_columns):  # the long samples are the few ones
            halve_rows, halve_columns = n_z > n_theta, n_theta >= n_z
        rows, columns = last.rows << halve_rows, last.columns << halve_columns
        levels.append(PyramidLevel(rows, columns, (-(-grid.n_z // rows), -(-grid.n_theta // columns))))
    return tuple(levels)


def read_level(layer: ImageLayer, level: PyramidLevel, start: int, stop: int) -> Image:
    """Return rows of a level, float32 (rows, columns), NaN where less than half was observed."""
    n_rows = layer.rows.size
    parts = []
    for first, last in blocks(start, stop, max(1, _BLOCK_ROWS // level.rows)):
        fine = layer.read(first * level.rows, min(last * level.rows, n_rows))
        parts.append(averaged(fine, level.rows, level.columns))
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def averaged(image: Image, rows: int, columns: int) -> Image:
    """Return means over ``rows`` × ``columns`` samples, NaN where less than half of them was observed.

    A last sample that reaches beyond the circle goes on from its beginning, one beyond the end of z has what is there.
    """
    if rows == columns == 1:
        return image
    n_z, n_theta = image.shape
    beyond = -n_theta % columns
    if beyond:
        image = np.concatenate([image, image[:, np.arange(beyond) % n_theta]], axis=1)
    known = np.isfinite(image)
    starts = np.arange(0, n_z, rows)
    total, count = (
        np.add.reduceat(a.reshape(n_z, -1, columns).sum(axis=2, dtype=kind), starts, axis=0)
        for a, kind in ((np.where(known, image, np.float32(0)), np.float32), (known, np.int32))
    )
    there = np.diff(np.append(starts, n_z))[:, np.newaxis] * columns
    return np.divide(total, count, out=np.full(total.shape, np.nan, np.float32), where=2 * count >= there)


def thinned(ids: Ids, level: PyramidLevel) -> Ids:
    """Return ids on a level: of every sample that of the place nearest to its centre."""
    rows = np.minimum(np.arange(level.shape[0]) * level.rows + level.rows // 2, ids.shape[0] - 1)
    columns = (np.arange(level.shape[1]) * level.columns + level.columns // 2) % ids.shape[1]
    return ids[np.ix_(rows, columns)]


def blocks(start: int, stop: int, length: int) -> Iterator[tuple[int, int]]:
    """Yield (first, one after the last) of consecutive blocks of at most ``length``."""
    for first in range(start, stop, length):
        yield first, min(first + length, stop)


def contrast_of(layer: ImageLayer) -> tuple[float, float]:
    """Return between which values a layer is displayed well: its 0.5th and 99.5th percentile over some of its rows."""
    n_rows = layer.rows.size
    some = [layer.read(row, row + 1) for row in np.unique(np.linspace(0, n_rows - 1, min(n_rows, 64)).astype(int))]
    values = np.concatenate(some)
    known = values[np.isfinite(values)]
    if known.size == 0:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(known, (0.5, 99.5)))
    return low, high if high > low else low + 1.0
