"""Small systems of linear equations, solved inside compiled loops."""

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled


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
