"""Where the facets of a wall are: samples of its relief on a coarse grid (z, θ), on the levels that it passes there."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.synthetic.bone.maps import WallMaps

FACET_MM = 0.07
LEVEL_MM = 0.1
FLAT_MM = 0.02
"""How far from the relief of its sample a place can be on the sample's own facet, where the wall there is steep."""

Indices = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class FacetGrid:
    """Samples of a wall's relief, and the facets that each has.

    ``relief_mm`` (n_z, n_theta) at the samples, which are ``dz_mm`` apart, the first at ``first_mm``, and in θ the
    first at ``first_rad``. Halfway to its neighbours and before, the wall lies between ``least_mm`` and ``most_mm``.
    The facets of a sample follow each other, from ``first`` on: its own, and where the wall passes several levels one
    for each from ``lowest`` to ``highest``. All (n_z, n_theta); those of a row follow those of the row before.
    """

    radius_mm: float
    dz_mm: float
    first_mm: float
    first_rad: float
    relief_mm: Image
    least_mm: Image
    most_mm: Image
    lowest: Indices
    highest: Indices
    first: Indices

    @property
    def dtheta_rad(self) -> float:
        """Step of the samples in θ, rad."""
        return 2 * math.pi / int(self.relief_mm.shape[1])

    def __len__(self) -> int:
        return int(self.first[-1, -1]) + int(_count(self.lowest[-1, -1], self.highest[-1, -1]))

    def of_rows(self, first: int, stop: int) -> slice:
        """Return the facets of some rows of samples."""
        ends = self.first[stop, 0] if stop < self.first.shape[0] else len(self)
        return slice(int(self.first[first, 0]), int(ends))

    def row(self, z_mm: Image) -> Image:
        """Return the rows, fractional, of places along the bore."""
        return np.asarray((z_mm - self.first_mm) / self.dz_mm, dtype=np.float32)

    def column(self, theta_rad: Image) -> Image:
        """Return the columns, fractional, of angles."""
        return np.asarray((theta_rad - self.first_rad) / self.dtheta_rad, dtype=np.float32)

    def facets_at(self, sample: NDArray[np.intp], relief_mm: Image) -> Indices:
        """Return the facets of some samples, indices into the flattened grid, on which the wall has ``relief_mm``."""
        own, lowest, highest = (one.ravel()[sample] for one in (self.relief_mm, self.lowest, self.highest))
        aside = 1 + np.clip(level_of(relief_mm), lowest, highest) - lowest
        flat = (lowest == highest) | (np.abs(relief_mm - own) < FLAT_MM)
        return np.asarray(self.first.ravel()[sample] + np.where(flat, 0, aside), dtype=np.int32)


def facet_grid(wall: WallMaps) -> FacetGrid:
    """Return where the facets of a wall are."""
    n_z, n_theta = wall.relief_mm.shape
    rows = max(1, round(FACET_MM / wall.dz_mm))
    columns = math.gcd(n_theta, 2 ** max(0, round(math.log2(FACET_MM / (wall.dtheta_rad * wall.radius_mm)))))
    relief = np.ascontiguousarray(wall.relief_mm[min(rows // 2, n_z - 1) :: rows, columns // 2 :: columns])
    around = np.stack([relief, *((relief + one) / 2 for one in neighbours(relief))])
    least, most = around.min(axis=0), around.max(axis=0)
    lowest, highest = level_of(least), level_of(most)
    count = _count(lowest, highest).ravel()
    return FacetGrid(
        radius_mm=wall.radius_mm,
        dz_mm=rows * wall.dz_mm,
        first_mm=min(rows // 2, n_z - 1) * wall.dz_mm,
        first_rad=(columns // 2) * wall.dtheta_rad,
        relief_mm=relief,
        least_mm=least,
        most_mm=most,
        lowest=lowest,
        highest=highest,
        first=(np.cumsum(count) - count).reshape(relief.shape).astype(np.int32),
    )


def _count(lowest: Indices, highest: Indices) -> Indices:
    """Return how many facets samples have."""
    return np.asarray(1 + np.where(highest > lowest, highest - lowest + 1, 0), dtype=np.int32)


def level_of(relief_mm: Image) -> Indices:
    """Return the levels that depths below the nominal wall are on."""
    return np.asarray(np.maximum(np.rint(relief_mm * np.float32(1 / LEVEL_MM)), 0), dtype=np.int32)


def neighbours(relief: Image) -> tuple[Image, Image, Image, Image]:
    """Return the relief at smaller and larger z, at smaller and larger θ."""
    wide = np.pad(relief, ((1, 1), (0, 0)), mode="edge")
    return wide[:-2], wide[2:], np.roll(relief, 1, axis=1), np.roll(relief, -1, axis=1)
