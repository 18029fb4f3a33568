"""The maps of a bore's wall: all that the endoscope needs to know of it."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask

LOOKUP_COLUMNS = 1024


@dataclass(frozen=True, eq=False)
class WallMaps:
    """Maps of the wall on a grid (z, θ) of the bore frame.

    Row k is z = k·``dz_mm`` from the mouth, column j is θ = j·2π/n. ``relief_mm``: wall radius minus
    ``radius_mm``, the first solid surface along the radial ray. ``cell``: the surface at the nominal radius is
    missing; ``cell_id``: 1 + the index in the sample of the cell whose cavity is open there, of the deepest where
    several meet, 0 elsewhere; it is kept where dust fills the opening, which is not missing then. ``albedo``:
    relative reflectance; ``rim``: light added on bright rims of cells. ``slope_z``, ``slope_theta``: ∂r/∂z and
    ∂r/(r ∂θ). ``wet``: fluid lies over the place, 0 or 1.
    """

    radius_mm: float
    dz_mm: float
    relief_mm: Image
    cell: Mask
    cell_id: NDArray[np.int32]
    albedo: Image
    rim: Image
    slope_z: Image
    slope_theta: Image
    wet: Image

    @property
    def dtheta_rad(self) -> float:
        """Step of the columns, rad."""
        return 2 * math.pi / int(self.relief_mm.shape[1])

    @cached_property
    def relief_range_mm(self) -> tuple[float, float]:
        """The least and the largest relief."""
        return float(self.relief_mm.min()), float(self.relief_mm.max())

    def at(self, image: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Image:
        """Return one of the maps at scattered places (1-D arrays of one length), bilinear, cyclic in θ."""
        n = z_mm.size
        rows = np.zeros(-(-n // LOOKUP_COLUMNS) * LOOKUP_COLUMNS, np.float32)
        columns = np.zeros_like(rows)
        np.clip(z_mm / self.dz_mm, 0, image.shape[0] - 1, out=rows[:n], casting="same_kind")
        columns[:n] = np.mod(theta_rad, 2 * np.pi) / self.dtheta_rad
        shape = (-1, LOOKUP_COLUMNS)
        values = cv2.remap(
            image, columns.reshape(shape), rows.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        return np.asarray(values, dtype=np.float32).ravel()[:n]
