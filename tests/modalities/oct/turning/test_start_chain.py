"""Starts of turns from a landmark that creeps."""

import numpy as np
import pytest
from tolerances import COORDINATE_ATOL

from endoct.modalities.oct.turning import start_angle


def by_matrix(moved: np.ndarray, sigma: np.ndarray, usual: float, creep: float) -> tuple[np.ndarray, np.ndarray]:
    """The least squares for starts as written down: all unknowns, the landmark's directions too, by all rows."""
    n, seen = moved.size, np.flatnonzero(np.isfinite(sigma))
    creeping = (np.eye(n, k=1) - np.eye(n)) / creep
    creeping[-1] = start_angle.MEAN_WEIGHT / n
    sights = (np.eye(n)[seen], -np.eye(n)[seen])  # the landmark is seen at its direction less the start
    matrix = np.block([[np.zeros((n, n)), creeping], [np.eye(n) / usual, np.zeros((n, n))]])
    matrix = np.vstack([matrix, np.hstack(sights[::-1]) / sigma[seen, None]])
    values = np.concatenate([np.zeros(2 * n), moved[seen] / sigma[seen]])
    weight = np.ones(values.size)
    for _ in range(start_angle.ROBUST_STEPS):
        weighted = matrix * weight[:, None]
        covariance = np.linalg.inv(weighted.T @ weighted)
        solution = covariance @ (weighted.T @ (weight * values))
        weight[n:] = 1 / np.sqrt(1 + ((matrix @ solution - values)[n:] / 2) ** 2)
    return solution[:n], np.sqrt(np.diag(covariance)[:n])


@pytest.mark.parametrize("n", [2, 3, 120])
def test_starts_are_those_of_least_squares_over_everything(n: int) -> None:
    rng = np.random.default_rng(3)
    seen = (rng.random(n) < 0.9) | (np.arange(n) < 2)
    moved = np.where(seen, 0.005 * rng.normal(size=n) + np.cumsum(0.0017 * rng.normal(size=n)), 0.0)
    moved[np.flatnonzero(seen)[n // 6]] += 0.2
    sigma = np.where(seen, rng.uniform(0.001, 0.004, n), np.inf)
    for estimate, expected in zip(
        start_angle.separated(moved, sigma, 0.005, 0.0017), by_matrix(moved, sigma, 0.005, 0.0017), strict=True
    ):
        np.testing.assert_allclose(estimate, expected, rtol=0, atol=COORDINATE_ATOL)
