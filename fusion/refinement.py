"""The last fraction of a sample of an alignment: robust Gauss–Newton, coarse to fine, over what both sides have."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from endoct.fusion.evidence import Evidence, blurred, on_grid
from endoct.fusion.pose import Alignment, as_covariance
from endoct.fusion.resample import column_weights, resample
from endoct.stitching.arrays import Coordinates, Image, Mask

BLURS_MM = (0.12, 0.06, 0.03)
FINER_MM = (0.015, 0.0075)
"""Blurs, too, for two sides that are both sampled no wider than that."""
SAMPLES_A_BLUR = (4, 1)
"""In one sigma of a blur, of the side that is interpolated and of the one that is not."""
ROUNDS = 12
WAVES = 2
"""Harmonics of θ by which the two sides may depart from a rigid turn while it is sought."""
BEND_RAD = 0.02
"""How large such a departure typically is, and a twist over half the overlap."""
FARTHEST_MM = 0.5
"""A refinement that leaves the search's peak by more has lost it."""
PATCH_MM = 0.6
"""Residuals farther apart than this err independently: cells are about as large."""

MOVES = 3
"""Unknowns before the bends: turn, shift, scale. After the bends come the coefficients of the tone."""
TONE, FINE_TONE = 1, 3
"""Degree of the polynomial by which the values of one side depend on the other's. What bends it, gamma, saturation or
a logarithm, moves fine edges; where edges are wide anyway it would rather follow what the light's fit leaves."""
STILL = 1e-3
"""A step below this share of the blur ends all levels but the last, of which it may be at most ``STILL**2``."""


@dataclass(frozen=True)
class _Fit:
    """An alignment, and beside it how θ bends: a twist, rad per mm of z, and the coefficients of the waves, rad."""

    alignment: Alignment
    bends: Coordinates


@dataclass(frozen=True)
class _Equations:
    """Normal equations of one step: ``normal`` (k, k), ``slope`` (k,), for turn, shift, scale, bends and tone.

    The scale changes about ``middle_mm``; ``correlation`` is that before the step. ``effects`` (k, n) and ``pulls``
    (n,), weighted residuals, are those of the samples ``used``, bool (n_z, n_theta), that the equations come from.
    """

    normal: Coordinates
    slope: Coordinates
    middle_mm: float
    correlation: float
    effects: Coordinates
    pulls: Coordinates
    used: Mask


def refine(a: Evidence, b: Evidence, start: Alignment, z_scale_range: tuple[float, float]) -> Alignment:
    """Return ``start`` with turn, shift and scale refined, their covariance, and the correlation there.

    The side with the coarser rows is compared at its own rows, where the other is interpolated: nothing is
    interpolated across wide rows. The values of one are a polynomial of the other's, rising or falling; samples that
    fit badly count little. Where it does not converge near ``start``, the search's answer stands.

    Uneven rotation of a catheter and a probe off the axis bend θ by waves, a slow drift twists it. Where cells lie on
    one side only, a rigid turn would follow that there; so the first harmonics and a twist are sought too and then
    left out of the alignment, but for their size, ``uneven_rad`` and ``twist_rad_per_mm``.
    """
    if a.dz_mm > b.dz_mm:
        low, high = z_scale_range
        return refine(b, a, start.inverse(), (1 / high, 1 / low)).inverse()
    fit = _Fit(start, np.zeros(1 + 2 * WAVES))
    coarsest_mm = max(b.dz_mm, b.column_mm, a.column_mm)
    blurs_mm = *BLURS_MM, *(finer for finer in FINER_MM if coarsest_mm <= finer)
    for sigma_mm in blurs_mm:
        fine, coarse = (
            blurred(_sampled(side, sigma_mm / samples), sigma_mm)
            for side, samples in zip((a, b), SAMPLES_A_BLUR, strict=True)
        )
        still_mm = sigma_mm * (STILL**2 if sigma_mm == blurs_mm[-1] else STILL)
        fit = _gauss_newton(fine, coarse, fit, z_scale_range, sigma_mm, still_mm)
    found = fit.alignment
    middle_mm = b.z_mm[[0, -1]].mean()
    moved_mm = abs(float(found.z_to_a(middle_mm) - start.z_to_a(middle_mm)))
    turned_rad = abs(float(np.angle(np.exp(1j * (found.theta_shift_rad - start.theta_shift_rad)))))
    if not (moved_mm < FARTHEST_MM and turned_rad * a.radius_mm < FARTHEST_MM):
        return start
    return replace(
        found,
        theta_shift_rad=float(np.mod(found.theta_shift_rad, 2 * np.pi)),
        uneven_rad=float(np.abs(fit.bends[1:] @ _waves(np.linspace(0, 2 * np.pi, 360))).max()),
        twist_rad_per_mm=float(fit.bends[0]),
    )


def _sampled(evidence: Evidence, spacing_mm: float) -> Evidence:
    """Return ``evidence`` on samples up to ``spacing_mm`` apart where its own lie closer, on its own elsewhere.

    Columns become one of a whole number of old ones, so that they meet the same samples wherever θ starts.
    """
    n_theta = evidence.values.shape[1]
    most = max(1, int(spacing_mm / evidence.column_mm + 1e-9))
    wanted = n_theta // max(each for each in range(1, most + 1) if n_theta % each == 0)
    if evidence.dz_mm < spacing_mm:
        n = int(np.ptp(evidence.z_mm) / spacing_mm) + 1
        from_zero = replace(evidence, theta0_rad=0.0)
        even = on_grid(from_zero, evidence.z_mm[0] + spacing_mm * np.arange(n), wanted)
        return replace(even, theta0_rad=evidence.theta0_rad)
    if wanted == n_theta:
        return evidence
    columns = n_theta / wanted * np.arange(wanted)
    rows = sparse.eye_array(evidence.z_mm.size, dtype=np.float32, format="csr")
    values, valid = resample(evidence.values, evidence.valid, rows, column_weights(n_theta, columns, n_theta / wanted))
    return replace(evidence, values=values, valid=valid)


def _gauss_newton(
    fine: Evidence,
    coarse: Evidence,
    start: _Fit,
    z_scale_range: tuple[float, float],
    sigma_mm: float,
    still_mm: float,
) -> _Fit:
    """Return ``start`` improved until it moves by less; ``start`` itself where too little is left to go by."""
    slopes = _slopes(fine)
    fit = start
    for last in (*[False] * (ROUNDS - 1), True):
        equations = _equations(fine, coarse, slopes, fit, sigma_mm)
        if equations is None:
            return start
        try:
            step = np.linalg.solve(equations.normal, equations.slope)
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
            z_shift_mm=found.z_shift_mm + float(shift_mm) - (scale - found.z_scale) * equations.middle_mm,
            correlation=equations.correlation,
        )
        fit = _Fit(found, fit.bends + np.clip(step[MOVES : MOVES + fit.bends.size], -0.05, 0.05))
        ends_mm = np.abs(step[:MOVES]) * (coarse.radius_mm, 1.0, float(np.ptp(coarse.z_mm)))
        if last or ends_mm.max() < still_mm:
            covariance = as_covariance(_covariance(equations, coarse))
            return replace(fit, alignment=replace(found, covariance=covariance))
    return fit


def _equations(
    fine: Evidence, coarse: Evidence, slopes: tuple[Image, Image], fit: _Fit, sigma_mm: float
) -> _Equations | None:
    """Return the equations of a step; None where the two hardly overlap or one is constant there."""
    found, n_theta = fit.alignment, fine.values.shape[1]
    theta_rad = coarse.theta0_rad + 2 * np.pi / coarse.values.shape[1] * np.arange(coarse.values.shape[1])
    waves = _waves(theta_rad)
    along_mm = (-1.0 if found.z_reversed else 1.0) * coarse.z_mm
    rows = np.interp(found.z_to_a(coarse.z_mm), fine.z_mm, np.arange(fine.z_mm.size), left=-1, right=-1)
    met = rows >= 0
    if not met.any():
        return None
    middle_mm = float(along_mm[met].mean())
    from_middle_mm = (along_mm - middle_mm)[:, np.newaxis]
    turn_rad = found.theta_to_a(theta_rad) + fit.bends[1:] @ waves + fit.bends[0] * from_middle_mm
    columns = (turn_rad - fine.theta0_rad) * n_theta / (2 * np.pi)
    use = coarse.valid & (_bilinear(fine.valid.astype(np.float32), rows, columns) > 0.999)
    if use.sum() < 100:
        return None
    value, dz, dtheta = (_bilinear(image, rows, columns)[use] for image in (fine.values, *slopes))
    target = coarse.values[use].astype(np.float64)
    (of_value, common), (_, of_target) = np.cov(value, target)
    if not (of_value > 0 and of_target > 0):
        return None
    degree = FINE_TONE if sigma_mm in FINER_MM else TONE
    powers = ((value - value.mean()) / np.sqrt(of_value)) ** np.arange(degree + 1)[:, np.newaxis]
    tone = np.linalg.solve(powers @ powers.T + 1e-6 * value.size * np.eye(degree + 1), powers @ target)
    gain = (tone[1:] * np.arange(1, degree + 1) / np.sqrt(of_value)) @ powers[:-1]
    residual = target - tone @ powers
    size = 1.4826 * float(np.median(np.abs(residual))) + 1e-6
    weight = 1 / np.maximum(1, np.abs(residual) / (2 * size))
    off_mm = np.broadcast_to(from_middle_mm, use.shape)[use]
    turn, shift = gain * dtheta, gain * dz
    turns = [turn * np.broadcast_to(wave, use.shape)[use] for wave in waves]
    effects = np.stack([turn, shift, shift * off_mm, turn * off_mm, *turns, *powers])
    pulls = weight * residual
    normal = (effects * weight) @ effects.T
    slope = effects @ pulls
    # BEND_RAD as a prior, against residuals of which all within one blur count as one
    one_px = 4 * np.pi * sigma_mm**2 / (coarse.dz_mm * coarse.column_mm)
    half_mm = max(float(np.ptp(along_mm[met])) / 2, 1e-3)
    typical = BEND_RAD * np.r_[1 / half_mm, np.ones(len(waves))]
    stiffness = max(1.0, one_px) * float((pulls * residual).mean()) / typical**2
    bends = np.arange(MOVES, MOVES + typical.size)
    normal[np.diag_indices(len(normal))] *= 1 + 1e-9
    normal[bends, bends] += stiffness
    slope[bends] -= stiffness * fit.bends
    correlation = float(common / np.sqrt(of_value * of_target))
    return _Equations(normal, slope, middle_mm, correlation, effects, pulls, use)


def _covariance(equations: _Equations, coarse: Evidence) -> Coordinates:
    """Return the covariance (3, 3) of turn (rad), shift (mm) and scale, from how residuals pull patch by patch.

    Neighbouring residuals err alike: blurs and whole cells that only one side shows. So they are summed over patches
    of ``PATCH_MM`` and only these count as independent (the sandwich estimate for clustered data; Liang and Zeger
    1986, Longitudinal data analysis using generalized linear models).
    """
    row, column = np.nonzero(equations.used)
    n_around = max(3, round(2 * np.pi * coarse.radius_mm / PATCH_MM))
    around = column * n_around // coarse.values.shape[1]
    along = ((coarse.z_mm - coarse.z_mm[0]) / PATCH_MM).astype(np.intp)[row]
    patch = along * n_around + around
    pulls = np.stack([np.bincount(patch, effect * equations.pulls) for effect in equations.effects])
    n_patches = int(np.count_nonzero(np.bincount(patch)))
    inverse = np.linalg.pinv(equations.normal, hermitian=True)
    spread = inverse @ (pulls @ pulls.T) @ inverse * (n_patches / max(1, n_patches - len(pulls)))
    to_origin = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -equations.middle_mm], [0.0, 0.0, 1.0]])
    return np.asarray(to_origin @ spread[:3, :3] @ to_origin.T, dtype=np.float64)


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
    """Return ``image`` at every row (m,) and its columns (m, k), fractional and cyclic; 0 for rows outside."""
    n_z, n_theta = image.shape
    inside = (rows >= 0) & (rows <= n_z - 1)
    first = np.clip(np.floor(rows).astype(np.intp), 0, max(n_z - 2, 0))
    second = np.minimum(first + 1, n_z - 1)
    down = (rows - first)[:, np.newaxis]
    left = np.floor(columns).astype(np.intp)
    along = columns - left
    lines = image[first] * (1 - down) + image[second] * down
    before, after = (np.take_along_axis(lines, np.mod(left + k, n_theta), axis=1) for k in (0, 1))
    return np.asarray(np.where(inside[:, np.newaxis], before * (1 - along) + after * along, 0.0), dtype=np.float64)
