"""Cell evidence: what is thresholded and correlated, made of whatever a panorama provides.

From depth, the relief: how far the surface lies behind the wall around it. From intensity alone, the darkness:
−log of the intensity over that of the wall around it. The wall is fitted robustly, cells left out.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.fusion.resample import column_weights, resample, row_weights
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.circle import gaussian
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama

Kind = Literal["relief", "darkness", "mask"]

MASK_MODALITY = "mask"
WALL_HARMONICS = 2
WALL_QUANTILE = 0.25
SECTORS = 16
WALL_SCATTER_MM = (0.008, 0.05)
NEIGHBOURHOOD_MM = 1.2
STEADINESS_MM = (0.003, 0.02)
"""Bounds of how far a slice's wall departs from the course along z; how far it does is seen in slices mostly wall."""
SAMPLES_A_SPECKLE = 8.0
LIGHT_SIGMA_MM = 1.2
LIGHT_WIDTHS = (1.0, 0.6, 0.4, 0.3, 0.2, 0.15, 0.15)
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
    axis. It changes slowly along z, and nothing lies in front of it, so that a slice that is mostly cells finds
    its wall where its neighbours have theirs: the wall starts as a low quantile over sectors of θ and
    ``NEIGHBOURHOOD_MM`` of z, and is then fitted slice by slice by reweighted least squares that trust what lies
    near or in front of it and not what lies behind, drawn towards the course along z the more
    the steadier the slices that are mostly wall are.
    """
    n_theta = depth_mm.shape[1]
    step = max(1, n_theta // 512)
    seen = valid[:, ::step]
    basis = _harmonics(2 * np.pi / n_theta * np.arange(n_theta))
    depth = np.where(seen, depth_mm[:, ::step], 0.0).astype(np.float64)
    near = _nearness(z_mm)
    wall = _first_wall(depth, seen, basis[::step], z_mm)
    products = basis[::step, :, np.newaxis] * basis[::step, np.newaxis, :]
    for width_mm in (0.15, 0.1, 0.07, 0.05, 0.04, 0.03, 0.03, 0.03):
        residual = depth - wall @ basis[::step].T
        scatter = np.clip(1.4826 * _median_size(residual, seen & (residual < 0)), *WALL_SCATTER_MM)
        reach = np.maximum(2.5 * scatter, width_mm)[:, np.newaxis]
        weight = seen * np.clip(1 - np.where(residual > 0, residual / reach, residual / (3 * reach)) ** 2, 0, None) ** 2
        trust = weight.sum(axis=1)
        course = (near * trust) @ wall / np.maximum((near * trust).sum(axis=1), 1e-9)[:, np.newaxis]
        normal = np.tensordot(weight, products, axes=1)
        target = ((weight * (depth - course @ basis[::step].T)) @ basis[::step])[:, :, np.newaxis]
        alone = np.linalg.solve(normal + 1e-3 * np.eye(basis.shape[1]), target)[:, :, 0]
        steadiness_mm = _steadiness(alone, trust / depth.shape[1])
        # neighbouring samples share their speckle: a slice holds few independent ones
        pull = (SAMPLES_A_SPECKLE * scatter**2)[:, np.newaxis, np.newaxis] * np.diag(1 / steadiness_mm**2)
        wall = course + np.linalg.solve(normal + pull, target)[:, :, 0]
    return np.where(valid, depth_mm - wall @ basis.T, 0.0).astype(np.float32)


def _harmonics(theta_rad: Coordinates) -> Coordinates:
    waves = [f(k * theta_rad) for k in range(1, WALL_HARMONICS + 1) for f in (np.cos, np.sin)]
    return np.stack([np.ones_like(theta_rad), *waves], axis=1)


def _steadiness(departures_mm: Coordinates, trusted: Coordinates) -> Coordinates:
    """Return how far walls fitted alone depart from the course along z, by coefficient, from slices mostly wall."""
    mostly_wall = trusted > 0.5
    if mostly_wall.sum() < 5:
        return np.full(departures_mm.shape[1], STEADINESS_MM[0])
    return np.clip(1.4826 * np.median(np.abs(departures_mm[mostly_wall]), axis=0), *STEADINESS_MM)


def _nearness(z_mm: Coordinates) -> Coordinates:
    """Return how much each row counts for the course of the wall at each row, (n_z, n_z)."""
    near: Coordinates = np.exp(-0.5 * ((z_mm[:, np.newaxis] - z_mm) / NEIGHBOURHOOD_MM) ** 2)
    return near


def _first_wall(depth_mm: Coordinates, seen: Mask, basis: Coordinates, z_mm: Coordinates) -> Coordinates:
    """Return coefficients (n_z, k) of a wall through low quantiles of the neighbourhood, by sectors of θ."""
    depth = np.where(seen, depth_mm, np.nan)
    overall = np.nanquantile(depth, WALL_QUANTILE)
    sectors = np.array_split(np.arange(depth.shape[1]), SECTORS)
    middles = np.stack([basis[sector].mean(axis=0) for sector in sectors])
    wall = np.zeros((z_mm.size, basis.shape[1]))
    for row, z in enumerate(z_mm):
        rows = np.abs(z_mm - z) <= 1.5 * NEIGHBOURHOOD_MM
        blocks = [depth[rows][:, sector] for sector in sectors]
        known = np.array([np.isfinite(block).mean() > 0.2 for block in blocks])
        levels = np.array([np.nanquantile(b, WALL_QUANTILE) if k else overall for b, k in zip(blocks, known, strict=True)])
        wall[row] = _robust_fit(middles, levels, known)
    return wall


def _robust_fit(basis: Coordinates, levels: Coordinates, known: Mask) -> Coordinates:
    """Fit ``levels``, of which some lie too far behind because their sector is all cells."""
    fit = np.zeros(basis.shape[1])
    fit[0] = np.quantile(levels[known], WALL_QUANTILE) if known.any() else levels[0]
    ridge = 0.05 * np.eye(basis.shape[1])
    for width_mm in (0.3, 0.2, 0.1, 0.06, 0.06):
        residual = levels - basis @ fit
        weight = known * np.where(residual > 0, np.clip(1 - (residual / width_mm) ** 2, 0, None) ** 2, 1.0)
        fit = fit + np.linalg.solve((basis.T * weight) @ basis + ridge, (basis.T * weight) @ residual)
    return fit


def _median_size(values: Coordinates, where: Mask) -> Coordinates:
    chosen = np.where(where, np.abs(values), np.nan)
    chosen[~where.any(axis=1)] = 0.0
    return np.asarray(np.nanmedian(chosen, axis=1), dtype=np.float64)


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
    seen = coarse.values[coarse.valid]
    level = np.full_like(coarse.values, np.quantile(seen, 1 - WALL_QUANTILE) if seen.size else 0.0)
    for width in LIGHT_WIDTHS:
        residual = level - coarse.values  # positive: darker than the wall
        lighter = -residual[coarse.valid & (residual < 0)]
        scatter = 1.4826 * float(np.median(lighter)) if lighter.size else 0.0
        reach = max(2.5 * scatter, width)
        share = np.clip(1 - np.where(residual > 0, residual / reach, residual / (3 * reach)) ** 2, 0, None) ** 2
        weight = (coarse.valid * share).astype(np.float32)
        # where there is no wall in reach, the level stays
        level = level - gaussian(weight * residual, *sigmas) / (gaussian(weight, *sigmas) + np.float32(1e-3))
    columns = column_weights(
        n_theta,
        (log.theta0_rad + 2 * np.pi / log.values.shape[1] * np.arange(log.values.shape[1])) * n_theta / (2 * np.pi),
        0.0,
    )
    rows = row_weights(coarse.z_mm, coarse.dz_mm, log.z_mm, 0.0)
    return resample(level, np.ones(level.shape, np.bool_), rows, columns)[0]
