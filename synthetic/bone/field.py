"""Air in three-dimensional bone: how far each place is from the nearest surface, and which cell it belongs to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.lattice import trilinear
from endoct.synthetic.elementary import Numbers

STEEPEST = 1.25  # of the clearance between nodes: 1 for a distance, more for what detail is added
Vectors = tuple[Numbers, Numbers, Numbers]
"""x, y and z, (n,) each."""
EDGE_MM = 0.012  # over which the rim of an opening is rounded, as those of planted cells are


@dataclass(frozen=True, eq=False)
class Field:
    """Nodes (z, y, x) of the bore frame, ``step_mm`` apart, the first at ``origin_mm`` (x, y, z).

    ``clearance_mm`` float32: distance to the nearest surface of the bone as it was before drilling, > 0 in air;
    ``cell`` int32: the cell that a place belongs to, in air and in the bone near by, 0 for none. ``level_mm`` and
    ``dust_mm`` float32 (n + 1,): how far along ``down`` (3,), a unit vector, the surface of the fluid and of the dust
    in each cell lies, ∞ without. ``detail`` float32 (k, k, k), repeated ``detail_step_mm`` apart: added to the
    clearance, of an rms that is part of it; of shape (0, 0, 0) for none.
    """

    clearance_mm: Image
    cell: NDArray[np.int32]
    origin_mm: Coordinates
    step_mm: float
    down: Coordinates
    level_mm: Image
    dust_mm: Image
    detail: Image
    detail_step_mm: float

    def air_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the clearance of places (n,) whatever fills the cells, trilinear, as beyond the border at it."""
        at = self._index(x, y, z)
        air = trilinear(self.clearance_mm, at, wrap=False)
        if self.detail.size:
            near = np.flatnonzero(np.abs(air) < 8 * self.detail_step_mm)
            fine = [values.take(near) * (1 / self.detail_step_mm) for values in (z, y, x)]
            air[near] += trilinear(self.detail, fine, wrap=True)
        return air

    def clear_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the clearance of places (n,), to bone or to the dust in a cell."""
        air = self.air_mm(x, y, z)
        return np.minimum(air, self.above_dust_mm(x, y, z)) if self.dusty else air

    @property
    def dusty(self) -> bool:
        """Whether there is dust in any cell."""
        return bool(np.isfinite(self.dust_mm).any())

    def above_dust_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return how far places (n,) are above the dust in their cell, ∞ where there is none."""
        return np.asarray(self.dust_mm[self.cell_at(x, y, z)] - self.depth_mm(x, y, z))

    def fluid_mm(self, cell: NDArray[np.int32], origin: Vectors, heading: Vectors, end: Numbers) -> Numbers:
        """Return where rays that end at ``end`` (n,) below the fluid of their ``cell`` (n,) enter it, else NaN.

        ``origin`` and ``heading``: three of (n,). A ray that goes up through a fluid counts as one that meets none.
        """
        level = self.level_mm[cell]
        start, sinks = self.depth_mm(*origin), self.depth_mm(*heading)
        below = (sinks > 1e-6) & (start + end * sinks > level) & (start < level)
        return np.where(below, (level - start) / np.maximum(sinks, 1e-6), np.float32(np.nan))

    def depth_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return how far down places (n,) are."""
        down = self.down.astype(x.dtype)
        return np.asarray(x * down[0] + y * down[1] + z * down[2])

    def cell_at(self, x: Numbers, y: Numbers, z: Numbers) -> NDArray[np.int32]:
        """Return the cell that places (n,) belong to, that of the nearest node."""
        index = [
            np.clip(np.rint(at), 0, n - 1).astype(np.intp)
            for at, n in zip(self._index(x, y, z), self.cell.shape, strict=True)
        ]
        return np.asarray(self.cell[index[0], index[1], index[2]])

    def _index(self, x: Numbers, y: Numbers, z: Numbers) -> list[Numbers]:
        per_mm, (x0, y0, z0) = 1 / self.step_mm, (float(one) for one in self.origin_mm)
        return [(values - first) * per_mm for values, first in ((z, z0), (y, y0), (x, x0))]


def joined_with_bore(bore_mm: Numbers, field_mm: Numbers) -> Numbers:
    """Return the clearance of the bore and of the air in bone together, rounded where both surfaces meet."""
    blend = np.maximum(EDGE_MM - np.abs(bore_mm - field_mm), 0)
    return np.asarray(np.maximum(bore_mm, field_mm) + blend * blend / (4 * EDGE_MM))
