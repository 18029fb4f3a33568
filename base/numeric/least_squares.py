"""What fits are made of: the vertex of a parabola, harmonics of angles as columns, small systems of equations."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled


def vertex(before: Any, here: Any, after: Any) -> NDArray[Any]:
    """Return where parabolas through three even samples, numbers or arrays, have their top, in steps; 0 without one."""
    bend = np.asarray(before - 2 * here + after)
    return np.asarray(np.divide(0.5 * (before - after), bend, out=np.zeros_like(bend), where=bend < 0))


@compiled
def vertex_in_loops(before: float, here: float, after: float) -> float:
    """Return :func:`vertex` of numbers inside compiled loops."""
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def harmonics(angle_rad: ArrayLike, orders: Sequence[int]) -> Coordinates:
    """Return cosine and sine of multiples of the angles (n,), float64 (n, 2·len(orders)): cos k, sin k, for each k.

    ``orders`` are 0 or larger. Multiples are products, which takes a fifth of the time of as many cosines.
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    return _multiples(np.cos(angle), np.sin(angle), np.asarray(orders, np.intp), max(orders))


@compiled
def _multiples(cos: Coordinates, sin: Coordinates, orders: NDArray[np.intp], highest: int) -> Coordinates:
    waves = np.empty((cos.size, 2 * orders.size))
    re, im = np.empty(highest + 1), np.empty(highest + 1)
    re[0], im[0] = 1, 0
    for i in range(cos.size):
        for k in range(highest):
            re[k + 1] = re[k] * cos[i] - im[k] * sin[i]
            im[k + 1] = re[k] * sin[i] + im[k] * cos[i]
        for j in range(orders.size):
            waves[i, 2 * j] = re[orders[j]]
            waves[i, 2 * j + 1] = im[orders[j]]
    return waves


@compiled
def solve(matrix: Coordinates, vector: Coordinates) -> None:
    """Replace ``vector`` (n,) by the solution of ``matrix`` (n, n) · solution = ``vector``; both are overwritten.

    Gaussian elimination, the largest of a column's coefficients first. Not finite where the matrix is singular.
    """
    n = vector.size
    for k in range(n):
        pivot = k
        for row in range(k + 1, n):
            if abs(matrix[row, k]) > abs(matrix[pivot, k]):
                pivot = row
        if pivot != k:
            for column in range(k, n):
                matrix[k, column], matrix[pivot, column] = matrix[pivot, column], matrix[k, column]
            vector[k], vector[pivot] = vector[pivot], vector[k]
        for row in range(k + 1, n):
            factor = matrix[row, k] / matrix[k, k]
            for column in range(k + 1, n):
                matrix[row, column] -= factor * matrix[k, column]
            vector[row] -= factor * vector[k]
    for k in range(n - 1, -1, -1):
        for column in range(k + 1, n):
            vector[k] -= matrix[k, column] * vector[column]
        vector[k] /= matrix[k, k]
