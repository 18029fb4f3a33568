"""Cell evidence: what is thresholded and correlated, made of whatever a panorama provides.

From depth, the relief: how far the surface lies behind the wall around it. From intensity alone, the darkness:
−log of the intensity over that of the wall around it. The wall is fitted robustly, cells left out.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.ndimage import median_filter

from endoct.fusion.resample import column_weights, resample, row_weights
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.circle import gaussian
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama

Kind = Literal["relief", "darkness", "mask"]

MASK_MODALITY = "mask"
WALL_HARMONICS = 2
WALL_QUANTILE = 0.3
"""Up to 70 % of a slice may be cells before its neighbours must say where the wall is."""
WALL_SCATTER_MM = (0.008, 0.05)
NEIGHBOURHOOD_MM = 0.7
LIGHT_SIGMA_MM = 0.7
LIGHT_GRID_MM = 0.05
FAINTEST = 0.02
"""Intensity below this share of the median counts as this: the logarithm of dark noise says nothing."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for cells on a panorama's own samples: float32 ``values`` (n_z, n_theta), 0 where not ``valid``.

    ``unit`` is "mm" for relief, "1" else. Higher means rather cell for relief and masks; for darkness the sign is
    open until something else says whether cells are dark or bright.
    """

    values: Image
    valid: Mask
    z_mm: Coordinates
    dz_mm: float
    theta0_rad: float
    radius_mm: float
    kind: Kind

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return "mm" if self.kind == "relief" else "1"

    @property
    def column_mm(self) -> float:
        """Arc length of one column, mm."""
        return 2 * np.pi * self.radius_mm / self.values.shape[1]


def prepare(panorama: Panorama, *, prefer: Literal["relief", "intensity"] = "relief") -> Evidence:
    """Return the cell evidence of ``panorama``: relief where it has depth, else darkness; a mask as it is.

    ``prefer`` = "intensity" ignores depth. The relief is in mm, not floored or capped; the darkness in units of
    the natural logarithm. Raises :class:`EndoctError` where no sample is valid.
    """
    valid = panorama.valid & np.isfinite(panorama.intensity)
    if panorama.modality == MASK_MODALITY:
        kind: Kind = "mask"
        values = panorama.intensity
    elif panorama.depth_mm is not None and prefer == "relief":
        kind = "relief"
        valid = panorama.valid & np.isfinite(panorama.depth_mm)
        values = relief(panorama.depth_mm, valid, panorama.z_mm) if valid.any() else panorama.depth_mm
    else:
        kind = "darkness"
        values = panorama.intensity
    if not valid.any():
        raise EndoctError(
            f"nothing of the wall is valid in the {panorama.modality} panorama", remedy="look at how it was unrolled"
        )
    evidence = Evidence(
        np.where(valid, values, np.float32(0)).astype(np.float32, copy=False),
        valid,
        panorama.z_mm,
        panorama.grid.dz_mm,
        panorama.grid.theta0_rad,
        panorama.grid.radius_mm,
        kind,
    )
    return evidence if kind != "darkness" else replace(evidence, values=darkness(evidence))


def on_grid(evidence: Evidence, z_mm: Coordinates, n_theta: int) -> Evidence:
    """Return ``evidence`` on evenly spaced rows at ``z_mm`` and ``n_theta`` columns from θ = 0."""
    dz_mm = float(z_mm[1] - z_mm[0]) if z_mm.size > 1 else evidence.dz_mm
    rows = row_weights(evidence.z_mm, evidence.dz_mm, z_mm, dz_mm)
    columns = column_weights(*_columns_from_zero(evidence, n_theta))
    values, valid = resample(evidence.values, evidence.valid, rows, columns)
    return replace(evidence, values=values, valid=valid, z_mm=z_mm, dz_mm=dz_mm, theta0_rad=0.0)


def _columns_from_zero(evidence: Evidence, n_theta: int) -> tuple[int, Coordinates, float]:
    n_from = evidence.values.shape[1]
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)
    return n_from, (theta_rad - evidence.theta0_rad) * n_from / (2 * np.pi), n_from / n_theta


def relief(depth_mm: Image, valid: Mask, z_mm: Coordinates) -> Image:
    """Return how far every sample lies behind its slice's wall, float32 (n_z, n_theta), mm, 0 where invalid.

    The wall of a slice is an offset and the first two harmonics of θ: a bore that wanders is off the capillary's
    axis. It is fitted by reweighted least squares that trust what lies near or in front of the wall and not what
    lies behind it; a second fit starts from the median of the slices within ``NEIGHBOURHOOD_MM``, so that a slice
    that is mostly cells finds its wall where its neighbours have theirs.
    """
    n_z, n_theta = depth_mm.shape
    coarse = max(1, n_theta // 512)
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)
    basis = _harmonics(theta_rad)
    seen = valid[:, ::coarse]
    depth = np.where(seen, depth_mm[:, ::coarse], np.nan).astype(np.float64)
    start = np.zeros((n_z, basis.shape[1]))
    enough = seen.sum(axis=1) >= 3 * basis.shape[1]
    if enough.any():
        start[enough, 0] = np.nanquantile(depth[enough], WALL_QUANTILE, axis=1)
    first, trusted = _fit_wall(depth, basis[::coarse], start, widest_mm=0.4)
    dz_mm = float(np.median(np.diff(z_mm))) if n_z > 1 else NEIGHBOURHOOD_MM
    reach = max(1, round(NEIGHBOURHOOD_MM / dz_mm))
    neighbours = median_filter(first, size=(2 * reach + 1, 1), mode="nearest")
    second, trusted = _fit_wall(depth, basis[::coarse], neighbours, widest_mm=0.12)
    wall = np.where((trusted > 0.15)[:, np.newaxis], second, neighbours) @ basis.T
    return np.where(valid, depth_mm - wall, 0.0).astype(np.float32)


def _harmonics(theta_rad: Coordinates) -> Coordinates:
    waves = [f(k * theta_rad) for k in range(1, WALL_HARMONICS + 1) for f in (np.cos, np.sin)]
    return np.stack([np.ones_like(theta_rad), *waves], axis=1)


def _fit_wall(
    depth_mm: Coordinates, basis: Coordinates, start: Coordinates, *, widest_mm: float
) -> tuple[Coordinates, Coordinates]:
    """Return (coefficients (n_z, k), share of samples trusted (n_z,)) of each slice's wall."""
    seen = np.isfinite(depth_mm)
    depth = np.where(seen, depth_mm, 0.0)
    products = basis[:, :, np.newaxis] * basis[:, np.newaxis, :]
    coefficients, width = start.copy(), widest_mm
    weight = seen.astype(np.float64)
    ridge = 1e-3 * np.eye(basis.shape[1])
    for _ in range(10):
        residual = depth - coefficients @ basis.T
        near = np.where(seen & (residual < 0), residual, np.nan)
        scatter = np.clip(1.4826 * _median_size(near), *WALL_SCATTER_MM)
        reach = np.maximum(3 * scatter, width)[:, np.newaxis]
        weight = np.where(seen, np.clip(1 - (residual / reach) ** 2, 0, None) ** 2, 0.0)
        normal = np.tensordot(weight, products, axes=1) + ridge
        # the ridge pulls towards the previous fit, which decides where samples do not
        change = (weight * residual) @ basis
        coefficients = coefficients + np.linalg.solve(normal, change[:, :, np.newaxis])[:, :, 0]
        width *= 0.65
    return coefficients, (weight > 0.25).sum(axis=1) / depth.shape[1]


def _median_size(values: Coordinates) -> Coordinates:
    empty = ~np.isfinite(values).any(axis=1)
    filled = np.where(empty[:, np.newaxis], 0.0, values)
    return np.asarray(np.nanmedian(np.abs(filled), axis=1), dtype=np.float64)


def darkness(evidence: Evidence) -> Image:
    """Return −log(intensity / light on the wall), float32 (n_z, n_theta), for ``evidence`` that holds intensity.

    The light is the intensity's slow course over the wall, cells left out. Intensities that may be negative are
    first shifted so that one in a thousand lies below zero.
    """
    seen = evidence.values[evidence.valid]
    least = min(0.0, float(np.quantile(seen, 0.001)))
    median = float(np.median(seen)) - least
    if not median > 0:
        median = float(seen.max()) - least
    if not median > 0:
        raise EndoctError("the intensity of a panorama is constant", found=f"{seen[0]:g}", expected="a wall with cells")
    log = np.log(np.maximum((evidence.values - np.float32(least)) / np.float32(median), np.float32(FAINTEST)))
    light = _light(replace(evidence, values=log))
    return np.where(evidence.valid, light - log, np.float32(0)).astype(np.float32)


def _light(log: Evidence) -> Image:
    """Return the slow course of a logarithmic image over the wall, on its own samples."""
    n_theta = min(log.values.shape[1], max(64, round(2 * np.pi * log.radius_mm / LIGHT_GRID_MM)))
    n_rows = max(1, int((log.z_mm[-1] - log.z_mm[0]) / max(LIGHT_GRID_MM, log.dz_mm)) + 1)
    coarse = on_grid(log, np.linspace(log.z_mm[0], log.z_mm[-1], n_rows), n_theta)
    sigmas = LIGHT_SIGMA_MM / coarse.dz_mm, LIGHT_SIGMA_MM / coarse.column_mm
    level = np.full_like(coarse.values, np.median(coarse.values[coarse.valid]) if coarse.valid.any() else 0.0)
    for width in (1.0, 0.6, 0.4, 0.3, 0.3):
        residual = coarse.values - level
        weight = (coarse.valid * np.exp(-0.5 * (residual / width) ** 2)).astype(np.float32) + np.float32(1e-6)
        level = level + gaussian(weight * residual, *sigmas) / gaussian(weight, *sigmas)
    columns = column_weights(
        n_theta,
        (log.theta0_rad + 2 * np.pi / log.values.shape[1] * np.arange(log.values.shape[1])) * n_theta / (2 * np.pi),
        0.0,
    )
    rows = row_weights(coarse.z_mm, coarse.dz_mm, log.z_mm, 0.0)
    return resample(level, np.ones(level.shape, np.bool_), rows, columns)[0]
