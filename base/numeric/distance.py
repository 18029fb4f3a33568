"""Distances on the bore wall to where a mask ends, exact, around the circle of θ."""

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.compute.compiled import compiled


def signed_distance(mask: Mask, sample_mm: tuple[float, float], farthest_mm: float) -> Image:
    """Return the distance from each sample to the nearest one on the other side of the outline of ``mask``, in mm.

    It is positive inside, float32 (n_z, n_theta), and at most ``farthest_mm`` in size. ``mask`` is bool (n_z, n_theta)
    over the full circle; ``sample_mm``: distance of two rows, and of two columns. After Felzenszwalb and Huttenlocher
    2012, "Distance Transforms of Sampled Functions".
    """
    distance = np.empty(mask.shape, np.float32)
    _signed_distance(np.ascontiguousarray(mask), *sample_mm, farthest_mm, distance)
    return distance


@compiled
def _signed_distance(
    mask: Mask, row_mm: float, column_mm: float, farthest_mm: float, distance: Image
) -> None:  # pragma: no cover - compiled
    n_z, n_theta = mask.shape
    along = np.empty((n_z, n_theta), np.float32)
    _steps_around(mask, along)
    squared, lowest, start = np.empty(n_z), np.empty(n_z, np.int64), np.empty(n_z)
    for column in range(n_theta):
        for inside in (False, True):
            # of each row, the parabola over the nearest sample of the other kind in it, if it is lowest anywhere
            n = 0
            for row in range(n_z):
                steps = 0.0 if mask[row, column] != inside else along[row, column]
                squared[row] = (steps * column_mm) ** 2
                if steps == np.inf:
                    continue
                while n:
                    last = lowest[n - 1]
                    rise = (squared[row] - squared[last]) / ((row - last) * row_mm**2)
                    meets = (row + last + rise) / 2
                    if meets > start[n - 1]:
                        break
                    n -= 1
                start[n] = meets if n else -np.inf
                lowest[n] = row
                n += 1
            k = 0
            for row in range(n_z):
                while k + 1 < n and start[k + 1] < row:
                    k += 1
                if mask[row, column] == inside:
                    away = row - lowest[k]
                    nearest = np.sqrt((away * row_mm) ** 2 + squared[lowest[k]]) if n else np.inf
                    nearest = min(nearest, farthest_mm)
                    distance[row, column] = nearest if inside else -nearest


@compiled
def _steps_around(mask: NDArray[np.bool_], steps: Image) -> None:  # pragma: no cover - compiled
    """Write how many columns each sample lies from the nearest of the other kind in its row; ∞ where there is none."""
    n_z, n_theta = mask.shape
    for row in range(n_z):
        here = np.inf
        for twice in range(2 * n_theta):  # so that a step over the seam is known
            column = twice % n_theta
            here = 1.0 if mask[row, column] != mask[row, column - 1] else here + 1.0
            steps[row, column] = here
        here = np.inf
        for twice in range(2 * n_theta - 1, -1, -1):
            column = twice % n_theta
            here = 1.0 if mask[row, column] != mask[row, (column + 1) % n_theta] else here + 1.0
            steps[row, column] = min(steps[row, column], here)
