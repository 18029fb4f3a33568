"""How far the surface lies behind the wall around it, by depth that was measured or that parallax tells.

The wall is fitted between the cells, slice by slice.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN, robust_sigmas
from endoct.stitching.panorama import Panorama

WALL_HARMONICS = 2
WALL_QUANTILE = 0.25
"""The quantile of depth that lies on the wall: up to three quarters of a neighbourhood may be cells."""
SECTORS = 16
REACHES_MM = (0.05, 0.05, 0.04, 0.03, 0.03, 0.03, 0.03)
"""How far behind the wall samples are still trusted a little, in the rounds of the fit; noise widens it."""
LEAST_TRUST = 0.15
"""Where less of a neighbourhood than this is trusted, the wall was missed: the reach is three times as far there."""
WALL_SCATTER_MM = (0.008, 0.05)
NEIGHBOURHOOD_MM = 1.2
STEADINESS_MM = (0.003, 0.02)
"""Bounds of how far a slice's wall departs from the course along z; slices that are mostly wall show how far."""
SAMPLES_A_SPECKLE = 8.0
LEAST_KNOWN = 0.2
"""Where depth by parallax is known on less of a panorama than this, it does not show where the wall is."""


def relief(depth_mm: Image, valid: Mask, z_mm: Coordinates) -> Image:
    """Return how far every sample lies behind its slice's wall, float32 (n_z, n_theta), mm, 0 where invalid.

    The wall of a slice is an offset and the first two harmonics of θ, since a bore that wanders is off the
    capillary's axis. It changes slowly along z, and nothing lies in front of it. So a slice that is mostly cells
    finds its wall where its neighbours have theirs.

    The wall starts as a low quantile over sectors of θ and ``NEIGHBOURHOOD_MM`` of z. It is then fitted slice by
    slice, by reweighted least squares. These trust what lies near the wall or in front of it, not what lies behind.
    Each slice is drawn towards the course along z, more strongly where slices that are mostly wall are steady.
    """
    n_theta = depth_mm.shape[1]
    step = max(1, n_theta // 512)
    observed = valid[:, ::step]
    basis = _basis(2 * np.pi / n_theta * np.arange(n_theta))
    depth = np.where(observed, depth_mm[:, ::step], 0.0).astype(np.float64)
    # how much each row counts for the course of the wall at each row
    near: Coordinates = np.exp(-0.5 * ((z_mm[:, np.newaxis] - z_mm) / NEIGHBOURHOOD_MM) ** 2)
    wall = _first_wall(depth, observed, basis[::step], z_mm)
    products = basis[::step, :, np.newaxis] * basis[::step, np.newaxis, :]
    for least_mm in REACHES_MM:
        residual = depth - wall @ basis[::step].T
        scatter = np.clip(SIGMA_PER_MEDIAN * _median_size(residual, observed & (residual < 0)), *WALL_SCATTER_MM)
        reach = np.maximum(2.5 * scatter, least_mm)[:, np.newaxis]
        weight = observed * trust_in(residual, reach)
        missed = near @ weight.sum(axis=1) < LEAST_TRUST * (near @ observed.sum(axis=1))
        weight[missed] = (observed * trust_in(residual, 3 * reach))[missed]
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


def _basis(theta_rad: Coordinates) -> Coordinates:
    """Return an offset and the harmonics of θ, float64 (n, k)."""
    return np.column_stack([np.ones_like(theta_rad), harmonics(theta_rad, range(1, WALL_HARMONICS + 1))])


def _steadiness(departures_mm: Coordinates, trusted: Coordinates) -> Coordinates:
    """Return how far walls fitted alone depart from the course along z, by coefficient.

    Only slices that are mostly wall are asked.
    """
    mostly_wall = trusted > 0.5
    if mostly_wall.sum() < 5:
        return np.full(departures_mm.shape[1], STEADINESS_MM[0])
    return np.clip(robust_sigmas(departures_mm[mostly_wall]), *STEADINESS_MM)


def _first_wall(depth_mm: Coordinates, observed: Mask, basis: Coordinates, z_mm: Coordinates) -> Coordinates:
    """Return coefficients (n_z, k) of a wall through low quantiles of the neighbourhood, by sectors of θ."""
    depth = np.where(observed, depth_mm, np.nan)
    overall = np.nanquantile(depth, WALL_QUANTILE)
    sectors = np.array_split(np.arange(depth.shape[1]), SECTORS)
    middles = np.stack([basis[sector].mean(axis=0) for sector in sectors])
    walls = []
    places = np.linspace(z_mm[0], z_mm[-1], 1 + int(np.ceil(2 * np.ptp(z_mm) / NEIGHBOURHOOD_MM)))
    for place in places:
        rows = np.abs(z_mm - place) <= max(1.5 * NEIGHBOURHOOD_MM, float(np.abs(z_mm - place).min()))
        blocks = [depth[rows][:, sector] for sector in sectors]
        known = np.array([np.isfinite(block).mean() > 0.2 for block in blocks])
        levels = np.array(
            [np.nanquantile(b, WALL_QUANTILE) if k else overall for b, k in zip(blocks, known, strict=True)]
        )
        walls.append(_robust_fit(middles, levels, known))
    return np.stack([np.interp(z_mm, places, coefficient) for coefficient in np.stack(walls, axis=1)], axis=1)


def _robust_fit(basis: Coordinates, levels: Coordinates, known: Mask) -> Coordinates:
    """Return the fit to ``levels``, some of which lie too far behind because their sector is all cells."""
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


def trust_in(residual: Coordinates | Image, reach: Coordinates | float) -> Coordinates:
    """Return Tukey's weight, which falls to 0 at ``reach`` behind the wall and at three times that before it."""
    relative = np.where(residual > 0, residual / reach, residual / (3 * reach))
    return np.asarray(np.clip(1 - relative**2, 0, None) ** 2, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ParallaxRelief:
    """Relief by parallax on a panorama's own samples.

    ``relief_mm`` and its standard error ``error_mm``, float32 (n_z, n_theta), NaN where the depth is not known.
    """

    relief_mm: Image
    error_mm: Image

    @cached_property
    def known(self) -> Mask:
        """Where it is known, bool (n_z, n_theta)."""
        return np.isfinite(self.relief_mm)


def parallax_relief(panorama: Panorama) -> ParallaxRelief | None:
    """Return the relief of ``panorama`` by parallax; None where it has no such depth, or too little of it."""
    depth_mm, error_mm = panorama.parallax_depth_mm, panorama.parallax_error_mm
    if depth_mm is None or error_mm is None:
        return None
    known = panorama.valid & np.isfinite(depth_mm) & np.isfinite(error_mm)
    if known.mean() < LEAST_KNOWN:
        return None
    behind_mm = relief(np.where(known, depth_mm, np.float32(0)), known, panorama.z_mm)
    unknown = np.float32(np.nan)
    return ParallaxRelief(np.where(known, behind_mm, unknown), np.where(known, error_mm, unknown))
