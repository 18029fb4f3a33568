"""Evenly spaced places in space, as the voxels of a volume are."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.elementary import Numbers

Number = TypeVar("Number", np.float32, np.int32)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Places ``origin_mm`` (3,) + index · ``steps_mm``, float64; row a of ``steps_mm`` (3, 3): one step of axis a."""

    origin_mm: Coordinates
    steps_mm: Coordinates
    shape: tuple[int, int, int]

    @classmethod
    def around_bore(cls, length_mm: float, radius_mm: float, step_mm: float) -> Self:
        """Return places (z, y, x) of the bore frame within ``radius_mm`` of a bore's axis, a little beyond its ends."""
        n = 2 * int(np.ceil(radius_mm / step_mm)) + 1
        n_z = int(np.ceil(length_mm / step_mm)) + 5
        steps = step_mm * np.array([[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]])
        half = (n - 1) / 2 * step_mm
        return cls(np.array([-half, -half, -2 * step_mm]), steps, (n_z, n, n))

    @property
    def spacing_mm(self) -> Coordinates:
        """Distance of neighbours along each axis, (3,)."""
        return np.asarray(np.linalg.norm(self.steps_mm, axis=1))

    @cached_property
    def _index_per_mm(self) -> Coordinates:
        return np.asarray(np.linalg.inv(self.steps_mm))

    @property
    def centre_mm(self) -> Coordinates:
        """Middle of all places, (3,)."""
        return self.at((np.array(self.shape) - 1) / 2)

    def at(self, index: Coordinates) -> Coordinates:
        """Return the places (…, 3) at fractional indices (…, 3)."""
        return np.asarray(self.origin_mm + index @ self.steps_mm)

    def index_of(self, places_mm: Coordinates) -> Coordinates:
        """Return the fractional indices (…, 3) of places (…, 3)."""
        return np.asarray((places_mm - self.origin_mm) @ self._index_per_mm)

    def moved(self, to: Coordinates) -> "Lattice":
        """Return the same places in another frame, ``to`` (4, 4) from this one's coordinates to that one's."""
        return Lattice(to[:3, :3] @ self.origin_mm + to[:3, 3], self.steps_mm @ to[:3, :3].T, self.shape)

    def box(
        self, centre_mm: Coordinates, reach_mm: float, semi_mm: Coordinates | None = None
    ) -> tuple[slice, slice, slice]:
        """Return a box of indices that holds all places within ``reach_mm`` of ``centre_mm``.

        ``semi_mm`` (3, 3): rows are the semi-axes of an ellipsoid, from whose surface that reach counts.
        """
        middle = self.index_of(centre_mm)
        # how an index changes per mm, and at most within the ellipsoid
        apart = reach_mm * np.linalg.norm(self._index_per_mm, axis=0)
        if semi_mm is not None:
            apart += np.linalg.norm(semi_mm @ self._index_per_mm, axis=0)
        low = np.clip(np.ceil(middle - apart), 0, self.shape).astype(int)
        high = np.clip(np.floor(middle + apart) + 1, 0, self.shape).astype(int)
        first, second, third = (slice(int(a), int(max(a, b))) for a, b in zip(low, high, strict=True))
        return first, second, third

    def part(self, box: tuple[slice, slice, slice]) -> "Lattice":
        """Return the places in a box of indices."""
        first = np.array([one.start for one in box], np.float64)
        shape = tuple(one.stop - one.start for one in box)
        return Lattice(self.at(first), self.steps_mm, (shape[0], shape[1], shape[2]))

    def some_places(self, flat: NDArray[np.intp]) -> tuple[Image, Image, Image]:
        """Return x, y and z of places by their index (n,) into the flattened lattice, float32 (n,)."""
        k, j, i = (index.astype(np.float32) for index in np.unravel_index(flat, self.shape))
        first, steps = self.origin_mm.astype(np.float32), self.steps_mm.astype(np.float32)
        x, y, z = (first[of] + k * steps[0, of] + j * steps[1, of] + i * steps[2, of] for of in range(3))
        return x, y, z

    def places(self) -> tuple[Image, Image, Image]:
        """Return x, y and z of all places, float32, each of the lattice's shape."""
        axes = np.ogrid[tuple(slice(n) for n in self.shape)]
        x, y, z = (
            np.asarray(
                self.origin_mm[of] + sum(axes[a] * self.steps_mm[a, of] for a in range(3)) * np.ones((1, 1, 1)),
                dtype=np.float32,
            )
            for of in range(3)
        )
        return x, y, z


def trilinear(values: Image, index: list[Numbers], *, wrap: bool) -> Numbers:
    """Return values (k, j, i) at fractional indices, three of (n,), repeated or clamped beyond the border."""
    whole, part = [], []
    for at, n in zip(index, values.shape, strict=True):
        if not wrap:
            at = np.clip(at, 0, n - 1.001)
        low = np.floor(at)
        part.append((at - low).astype(np.float32))
        whole.append(low.astype(np.intp))
    n_k, n_j, n_i = values.shape
    k, j, i = whole
    if wrap:
        k, j, i = k % n_k, j % n_j, i % n_i
        rows = [[(row * n_j + column) * n_i for column in (j, (j + 1) % n_j)] for row in (k, (k + 1) % n_k)]
        columns = (i, (i + 1) % n_i)
    else:
        first = (k * n_j + j) * n_i
        rows = [[first, first + n_i], [first + n_j * n_i, first + (n_j + 1) * n_i]]
        columns = (i, i + 1)
    of_k, of_j, of_i = part
    planes = []
    for pair in rows:
        lines = []
        for row in pair:
            left = values.take(row + columns[0])
            lines.append(left + of_i * (values.take(row + columns[1]) - left))
        planes.append(lines[0] + of_j * (lines[1] - lines[0]))
    return np.asarray(planes[0] + of_k * (planes[1] - planes[0]), dtype=np.float32)


def resampled(values: NDArray[Number], at: Lattice, places: Lattice, order: int) -> NDArray[Number]:
    """Resample values from one lattice to another by splines of the given ``order``.

    Beyond the border they are as at the border; of order 0 they are 0 there.
    """
    matrix = (places.steps_mm @ np.linalg.inv(at.steps_mm)).T
    offset, mode = at.index_of(places.origin_mm), "nearest" if order else "constant"
    return np.asarray(
        ndimage.affine_transform(values, matrix, offset, places.shape, values.dtype, order=order, mode=mode)
    )
