"""Where the bore's own wall runs in one B-scan, and that a surface is likelier there than elsewhere.

A drilled wall is round: between the capillary's outer face and it lies a gap that is an offset and two harmonics of
the angle. So it is known where it is too faint to be seen, between where it is seen; there only a surface deeper
makes a cell, or darkness where bone should be.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image

BLOCK_MM = 0.03
SEARCH_MM = 0.06
REACHES_MM = ((0.2, 1), (0.12, 1), (0.08, 2), (0.05, 2), (0.05, 2))
"""How far from the fit surfaces still count, and its harmonics, in the rounds of the fit."""
STRONGEST = 2.0  # times the median evidence: a bright side does not outvote the rest
LEAST_SEEN = 0.05
BAND_MM = 0.02
BONUS_PER_MM = 100.0  # of wall: what the bore's wall gains over any other depth
FRONT_PER_MM = 750.0  # of wall: what lies before the bore's wall loses; nothing but dirt can


def gap_rows(rows: NDArray[np.intp], first_row: NDArray[np.intp], evidence: Image, mm_per_px: float) -> Coordinates:
    """Return how many rows the bore's wall lies behind ``first_row``, float64 (n,), from surfaces at ``rows`` (n,).

    ``evidence`` is that for the rows, (n, n_depth + 1). All NaN where hardly any surface was found.
    """
    surface = rows < evidence.shape[1] - 1
    if np.count_nonzero(surface) < max(LEAST_SEEN * rows.size, 8):
        return np.full(rows.size, np.nan)
    gap = (rows - first_row).astype(np.float64)
    weight = np.where(surface, np.maximum(evidence[np.arange(rows.size), rows], 0), 0).astype(np.float64)
    weight = np.minimum(weight, STRONGEST * max(float(np.median(weight[surface])), 1e-9))
    density = np.bincount(np.maximum(rows - first_row, 0), weights=weight)
    wide = max(1, round(SEARCH_MM / mm_per_px))
    basis = _harmonics(rows.size)
    fit = np.zeros(basis.shape[1])
    fit[0] = np.argmax(np.convolve(density, np.ones(wide), "same"))
    for reach_mm, harmonics in REACHES_MM:
        used = basis[:, : 1 + 2 * harmonics]
        residual = gap - basis @ fit
        near = weight * np.clip(1 - (residual * mm_per_px / reach_mm) ** 2, 0, None) ** 2
        # damped, so that a wall seen in part does not swing where it is not
        damping = np.diag([1e-3] + [0.02 * weight.sum()] * (2 * harmonics))
        fit[: used.shape[1]] += np.linalg.solve((used.T * near) @ used + damping, (used.T * near) @ residual)
    return np.asarray(basis @ fit)


def favour_bore(evidence: Image, wall_row: Coordinates, mm_per_px: float, mm_per_column: float) -> None:
    """Raise ``evidence`` (n, n_depth + 1) within ``BAND_MM`` of ``wall_row`` (n,), and lower it before, in place."""
    n_depth = evidence.shape[1] - 1
    behind = (np.arange(n_depth, dtype=np.float32) - wall_row[:, None].astype(np.float32)) * np.float32(
        mm_per_px / BAND_MM
    )
    evidence[:, :n_depth] += np.float32(BONUS_PER_MM * mm_per_column) * np.clip(2 - np.abs(behind), 0, 1)
    evidence[:, :n_depth] -= np.float32(FRONT_PER_MM * mm_per_column) * np.clip(-2 - behind, 0, 1)


def _harmonics(n: int) -> Coordinates:
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([np.ones(n), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))], axis=1)
