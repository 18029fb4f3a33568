"""Where the bore's own wall runs in one B-scan; a surface is likelier there than elsewhere.

A drilled wall is round: the gap between it and the capillary's outer face is an offset and two harmonics of the angle.
A fit of these gives the wall's place where it is too faint to be seen as well. A cell is then either a deeper surface,
or darkness where bone should be.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.bscan import Spacing
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.compiled import compiled
from endoct.stitching.harmonics import harmonics

BLOCK_MM = 0.03
SEARCH_MM = 0.06
REACHES_MM = ((0.2, 1), (0.12, 1), (0.08, 2), (0.05, 2), (0.05, 2))
"""In every round of the fit: how far from it surfaces still count, and its number of harmonics."""
STRONGEST = 2.0  # times the median evidence: a bright side does not outvote the rest
LEAST_SEEN = 0.05
BAND_MM = 0.02
BONUS_PER_MM = 100.0  # of wall: evidence gained where the bore's wall runs
FRONT_PER_MM = 750.0  # of wall: evidence lost before the bore's wall, where there can only be dirt


def gap_rows(rows: NDArray[np.intp], first_row: NDArray[np.intp], evidence: Image, mm_per_px: float) -> Coordinates:
    """Return how many rows the bore's wall lies behind ``first_row``, float64 (n,), from surfaces at ``rows`` (n,).

    ``evidence`` is that for the rows, (n, n_depth + 1). All NaN where there is hardly any surface, or no evidence.
    """
    surface = rows < evidence.shape[1] - 1
    if np.count_nonzero(surface) < max(LEAST_SEEN * rows.size, 8):
        return np.full(rows.size, np.nan)
    gap = (rows - first_row).astype(np.float64)
    weight = np.where(surface, np.maximum(evidence[np.arange(rows.size), rows], 0), 0).astype(np.float64)
    if not weight.any():  # as in a B-scan that is upside down: nothing brightens with depth
        return np.full(rows.size, np.nan)
    weight = np.minimum(weight, STRONGEST * max(float(np.median(weight[surface])), 1e-9))
    density = np.bincount(np.maximum(rows - first_row, 0), weights=weight)
    wide = max(1, round(SEARCH_MM / mm_per_px))
    basis = _basis(rows.size)
    fit = np.zeros(basis.shape[1])
    fit[0] = np.argmax(np.convolve(density, np.ones(wide), "same"))
    for reach_mm, n_harmonics in REACHES_MM:
        used = basis[:, : 1 + 2 * n_harmonics]
        residual = gap - basis @ fit
        near = weight * np.clip(1 - (residual * mm_per_px / reach_mm) ** 2, 0, None) ** 2
        # damped, so that a wall seen in part does not swing where it is not seen
        damping = np.diag([1e-3] + [0.02 * weight.sum()] * (2 * n_harmonics))
        fit[: used.shape[1]] += np.linalg.solve((used.T * near) @ used + damping, (used.T * near) @ residual)
    return np.asarray(basis @ fit)


def favour_bore(evidence: Image, wall_row: Coordinates, spacing: Spacing) -> None:
    """Raise ``evidence`` (n, n_depth + 1) within ``BAND_MM`` of ``wall_row`` (n,), and lower it before, in place."""
    bonus, front = BONUS_PER_MM * spacing.column_mm, FRONT_PER_MM * spacing.column_mm
    bands_per_row = np.float32(spacing.depth_mm / BAND_MM)
    _favour(evidence, wall_row.astype(np.float32), bands_per_row, np.float32(bonus), np.float32(front))


@compiled
def _favour(evidence: Image, wall_row: Image, bands_per_row: np.float32, bonus: np.float32, front: np.float32) -> None:
    none, one, two = np.float32(0), np.float32(1), np.float32(2)
    n_depth = evidence.shape[1] - 1
    for column in range(len(evidence)):
        wall = wall_row[column]
        first = min(max(int(wall - 3 / bands_per_row) - 1, 0), n_depth)
        evidence[column, :first] -= front
        for row in range(first, min(max(int(wall + 2 / bands_per_row) + 2, 0), n_depth)):
            behind = (np.float32(row) - wall) * bands_per_row
            evidence[column, row] += bonus * min(max(two - abs(behind), none), one)
            evidence[column, row] -= front * min(max(-two - behind, none), one)


def _basis(n: int) -> Coordinates:
    """An offset and two harmonics of the angle of ``n`` even columns, float64 (n, 5)."""
    return np.concatenate([np.ones((n, 1)), harmonics(2 * np.pi * np.arange(n) / n, (1, 2))], axis=1)
