"""The last fraction of a sample of an alignment: robust Gauss–Newton over the samples both sides have."""

from dataclasses import dataclass, replace

import numpy as np

from endoct.fusion.evidence import Evidence, blurred, on_grid
from endoct.fusion.pose import Alignment
from endoct.stitching.arrays import Coordinates, Image

FINEST_DZ_MM = 0.03
MOST_COLUMNS = 1024
BLURS_MM = (0.12, 0.06, 0.03)
ROUNDS = 12
WAVES = 2
"""Harmonics of θ by which the two sides may depart from a rigid turn while it is sought."""
WAVE_RAD = 0.02
"""How large such a departure typically is."""
FARTHEST_MM = 0.5
"""A refinement that leaves the search's peak by more has lost it."""

RIGID = 5
"""Unknowns before the waves: turn, shift, scale, gain and level."""


@dataclass(frozen=True)
class _Fit:
    """An alignment, and the coefficients of the waves in θ beside it."""

    alignment: Alignment
    wave_rad: Coordinates


def refine(a: Evidence, b: Evidence, start: Alignment, z_scale_range: tuple[float, float]) -> Alignment:
    """Return ``start`` with turn, shift and scale refined, and the correlation there.

    The side with the coarser rows is compared at its own samples, where the other is interpolated: nothing is
    interpolated across wide rows. The relation of the two is linear with a free gain of either sign; samples
    that fit badly count little. Where it does not converge near ``start``, the search's answer stands.

    Uneven rotation of a catheter and a probe off the axis bend θ by waves. Where cells lie on one side only, a rigid
    turn would follow the wave there; so the first harmonics are sought too and then left out of the alignment, but
    for their size, ``uneven_rad``.
    """
    if a.dz_mm > b.dz_mm:
        low, high = z_scale_range
        return refine(b, a, start.inverse(), (1 / high, 1 / low)).inverse()
    fine, coarse = _handy(a), _handy(b)
    fit = _Fit(start, np.zeros(2 * WAVES))
    for sigma_mm in BLURS_MM:
        fit = _gauss_newton(blurred(fine, sigma_mm), blurred(coarse, sigma_mm), fit, z_scale_range, sigma_mm)
    found = fit.alignment
    middle_mm = coarse.z_mm[[0, -1]].mean()
    moved_mm = abs(float(found.z_to_a(middle_mm) - start.z_to_a(middle_mm)))
    turned_rad = abs(float(np.angle(np.exp(1j * (found.theta_shift_rad - start.theta_shift_rad)))))
    if not (moved_mm < FARTHEST_MM and turned_rad * a.radius_mm < FARTHEST_MM):
        return start
    return replace(
        found,
        theta_shift_rad=float(np.mod(found.theta_shift_rad, 2 * np.pi)),
        uneven_rad=float(np.abs(fit.wave_rad @ _waves(np.linspace(0, 2 * np.pi, 360))).max()),
    )


def _handy(evidence: Evidence) -> Evidence:
    """Return ``evidence`` with no more rows and columns than refinement gains from."""
    n_theta = min(evidence.values.shape[1], MOST_COLUMNS)
    z_mm = evidence.z_mm
    if evidence.dz_mm < FINEST_DZ_MM:
        n = int(np.ptp(z_mm) / FINEST_DZ_MM) + 1
        z_mm = z_mm[0] + FINEST_DZ_MM * np.arange(n)
    elif n_theta == evidence.values.shape[1] and evidence.theta0_rad == 0:
        return evidence
    on_new = on_grid(evidence, z_mm, n_theta)
    return on_new if evidence.dz_mm < FINEST_DZ_MM else replace(on_new, dz_mm=evidence.dz_mm)


def _gauss_newton(
    fine: Evidence, coarse: Evidence, start: _Fit, z_scale_range: tuple[float, float], sigma_mm: float
) -> _Fit:
    """Return ``start`` improved until it stands still; ``start`` itself where too little is left to go by."""
    slopes = _slopes(fine)
    fit = start
    for _ in range(ROUNDS):
        equations = _equations(fine, coarse, slopes, fit, sigma_mm)
        if equations is None:
            return start
        normal, slope, middle_mm, correlation = equations
        try:
            step = np.linalg.solve(normal, slope)
        except np.linalg.LinAlgError:
            return start
        if not np.isfinite(step).all():
            return start
        turn_rad, shift_mm = np.clip(step[:2], -0.1, 0.1)
        found = fit.alignment
        scale = float(np.clip(found.z_scale + step[2], *z_scale_range))
        found = replace(
            found,
            theta_shift_rad=found.theta_shift_rad + float(turn_rad),
            z_scale=scale,
            z_shift_mm=found.z_shift_mm + float(shift_mm) - (scale - found.z_scale) * middle_mm,
            correlation=correlation,
        )
        fit = _Fit(found, fit.wave_rad + np.clip(step[RIGID:], -0.05, 0.05))
        if abs(step[0]) < 1e-5 and abs(step[1]) < 1e-5 and abs(step[2]) < 1e-6:
            break
    return fit


def _equations(
    fine: Evidence, coarse: Evidence, slopes: tuple[Image, Image], fit: _Fit, sigma_mm: float
) -> tuple[Coordinates, Coordinates, float, float] | None:
    """Return normal matrix and slope for a step in turn, shift, scale, gain, level and waves.

    With them the middle of the overlap along z, about which the scale changes, and the correlation. None where
    the two hardly overlap or one is constant there.
    """
    found, n_theta = fit.alignment, fine.values.shape[1]
    theta_rad = coarse.theta0_rad + 2 * np.pi / coarse.values.shape[1] * np.arange(coarse.values.shape[1])
    waves = _waves(theta_rad)
    rows = np.interp(found.z_to_a(coarse.z_mm), fine.z_mm, np.arange(fine.z_mm.size), left=-1, right=-1)
    columns = (found.theta_to_a(theta_rad) + fit.wave_rad @ waves - fine.theta0_rad) * n_theta / (2 * np.pi)
    use = coarse.valid & (_bilinear(fine.valid.astype(np.float32), rows, columns) > 0.999)
    if use.sum() < 100:
        return None
    value, dz, dtheta = (_bilinear(image, rows, columns)[use] for image in (fine.values, *slopes))
    target = coarse.values[use].astype(np.float64)
    (of_value, common), (_, of_target) = np.cov(value, target)
    if not (of_value > 0 and of_target > 0):
        return None
    gain = common / of_value
    residual = target - target.mean() - gain * (value - value.mean())
    size = 1.4826 * float(np.median(np.abs(residual))) + 1e-6
    weight = 1 / np.maximum(1, np.abs(residual) / (2 * size))
    along_mm = np.broadcast_to((-1.0 if found.z_reversed else 1.0) * coarse.z_mm[:, np.newaxis], use.shape)[use]
    middle_mm = float(along_mm.mean())
    turns = [gain * dtheta * np.broadcast_to(wave, use.shape)[use] for wave in waves]
    effects = np.stack(
        [gain * dtheta, gain * dz, gain * dz * (along_mm - middle_mm), value, np.ones_like(value), *turns]
    )
    normal = (effects * weight) @ effects.T
    # WAVE_RAD as a prior, against residuals of which all within one blur count as one
    one_px = 4 * np.pi * sigma_mm**2 / (coarse.dz_mm * coarse.column_mm)
    stiffness = max(1.0, one_px) * float((weight * residual**2).mean()) / WAVE_RAD**2
    diagonal = np.diag_indices(len(normal))
    normal[diagonal] = normal[diagonal] * (1 + 1e-6) + np.r_[np.zeros(RIGID), np.full(len(waves), stiffness)]
    slope = (effects * weight) @ residual - np.r_[np.zeros(RIGID), stiffness * fit.wave_rad]
    return normal, slope, middle_mm, float(common / np.sqrt(of_value * of_target))


def _waves(theta_rad: Coordinates) -> Coordinates:
    return np.stack([f(k * theta_rad) for k in range(1, WAVES + 1) for f in (np.cos, np.sin)])


def _slopes(fine: Evidence) -> tuple[Image, Image]:
    """Return d/dz per mm and d/dθ per rad of the values, which stay 0 where they are not valid."""
    dtheta_rad = 2 * np.pi / fine.values.shape[1]
    dtheta = (np.roll(fine.values, -1, axis=1) - np.roll(fine.values, 1, axis=1)) / (2 * dtheta_rad)
    if fine.z_mm.size < 2:
        return np.zeros_like(fine.values), dtheta.astype(np.float32)
    return np.gradient(fine.values, fine.z_mm, axis=0).astype(np.float32), dtheta.astype(np.float32)


def _bilinear(image: Image, rows: Coordinates, columns: Coordinates) -> Coordinates:
    """Return ``image`` at every row × column (fractional, columns cyclic); 0 for rows outside."""
    n_z, n_theta = image.shape
    inside = (rows >= 0) & (rows <= n_z - 1)
    first = np.clip(np.floor(rows).astype(np.intp), 0, max(n_z - 2, 0))
    second = np.minimum(first + 1, n_z - 1)
    down = (rows - first)[:, np.newaxis]
    left = np.floor(columns).astype(np.intp)
    along = columns - left
    lines = image[first] * (1 - down) + image[second] * down
    values = lines[:, left % n_theta] * (1 - along) + lines[:, (left + 1) % n_theta] * along
    return np.asarray(np.where(inside[:, np.newaxis], values, 0.0), dtype=np.float64)
