"""The last fraction of a sample of an alignment: robust Gauss–Newton, coarse to fine, over the wall both sides have."""

from dataclasses import replace

import numpy as np
from scipy import sparse

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import largest_divisor
from endoct.fusion.evidence.evidence import Evidence, blurred, on_grid
from endoct.fusion.geometry.alignment import Alignment, as_covariance
from endoct.fusion.geometry.placement import column_weights, resample
from endoct.fusion.registration.equations import MOVES, WAVES, Bending, Equations, Level, equations, level, waves

BLURS_MM = (0.12, 0.06, 0.03)
FINER_MM = (0.015, 0.0075)
"""Further blurs, for two sides that are both sampled at least this finely."""
SAMPLES_A_BLUR = (4, 1)
"""Samples in one sigma of a blur, of the side that is interpolated and of the one that is not."""
ROUNDS = 12
FARTHEST_MM = 0.5
"""A refinement that leaves the search's peak by more has lost it."""
TONE, FINE_TONE = 1, 3
"""Degree of the polynomial that maps one side's values to the other's, coarse and fine. Gamma, saturation or a
logarithm bend it, which moves fine edges. Where edges are wide, a bent one would follow what the fit of the light
leaves."""
STILL, LAST_STILL = 1e-3, 1e-5
"""A step below this share of the blur ends a level; below the second, the last level. Below 1e-6 it is rounding."""
MEMORY = 3
"""Number of steps from whose course the next one is extrapolated."""
BOLDEST = 4.0
"""How many times as far as the plain step an extrapolated one may go."""


def refine(a: Evidence, b: Evidence, start: Alignment, z_scale_range: tuple[float, float]) -> Alignment:
    """Return ``start`` with turn, shift and scale refined, their covariance, and the correlation there.

    The side with the coarser rows is compared at its own rows, where the other is interpolated: nothing is
    interpolated across wide rows. The values of one are a polynomial of the other's, rising or falling; samples that
    fit badly count little. Where it does not converge near ``start``, the search's answer stands.

    Uneven rotation of a catheter and a probe off the axis bend θ by waves; a slow drift twists it. A rigid turn would
    follow that where cells lie on one side only. So the first harmonics and a twist are sought as well. They are then
    left out of the alignment, but for their size, ``uneven_rad`` and ``twist_rad_per_mm``.
    """
    if a.dz_mm > b.dz_mm:
        low, high = z_scale_range
        return refine(b, a, start.inverse(), (1 / high, 1 / low)).inverse()
    fit = Bending(start, np.zeros(1 + 2 * WAVES))
    coarsest_mm = max(b.dz_mm, b.column_mm, a.column_mm)
    blurs_mm = *BLURS_MM, *(finer for finer in FINER_MM if coarsest_mm <= finer)
    for sigma_mm in blurs_mm:
        still_mm = sigma_mm * (LAST_STILL if sigma_mm == blurs_mm[-1] else STILL)
        degree = FINE_TONE if sigma_mm in FINER_MM else TONE
        fit = _gauss_newton(blurred_level(a, b, degree, sigma_mm), fit, z_scale_range, still_mm)
    refined = fit.alignment
    middle_mm = b.z_mm[[0, -1]].mean()
    moved_mm = abs(float(refined.z_to_a(middle_mm) - start.z_to_a(middle_mm)))
    turned_rad = abs(float(np.angle(np.exp(1j * (refined.theta_shift_rad - start.theta_shift_rad)))))
    if not (moved_mm < FARTHEST_MM and turned_rad * a.radius_mm < FARTHEST_MM):
        return start
    return replace(
        refined,
        theta_shift_rad=float(np.mod(refined.theta_shift_rad, 2 * np.pi)),
        uneven_rad=float(np.abs(fit.bends[1:] @ waves(np.linspace(0, 2 * np.pi, 360))).max()),
        twist_rad_per_mm=float(fit.bends[0]),
    )


def blurred_level(a: Evidence, b: Evidence, degree: int, sigma_mm: float) -> Level:
    """Return both sides at one blur; ``a`` is interpolated at the samples of ``b``."""
    fine, coarse = (
        blurred(sampled(side, sigma_mm / samples), sigma_mm)
        for side, samples in zip((a, b), SAMPLES_A_BLUR, strict=True)
    )
    return level(fine, coarse, degree, sigma_mm)


def sampled(evidence: Evidence, spacing_mm: float) -> Evidence:
    """Return ``evidence`` on samples up to ``spacing_mm`` apart where its own lie closer, on its own elsewhere.

    A new column is made of a whole number of old ones, so that it meets the same samples wherever θ starts.
    """
    n_theta = evidence.values.shape[1]
    most = max(1, int(spacing_mm / evidence.column_mm + 1e-9))
    wanted = n_theta // largest_divisor(n_theta, most)
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


def _gauss_newton(of: Level, start: Bending, z_scale_range: tuple[float, float], still_mm: float) -> Bending:
    """Return ``start``, improved until it moves by less than ``still_mm``; unchanged where too little is known."""
    length_mm, radius_mm = float(np.ptp(of.coarse.z_mm)), of.coarse.radius_mm
    # how far a change by 1 of each unknown moves the wall
    reach_mm = np.r_[radius_mm, 1.0, length_mm, length_mm * radius_mm, np.full(2 * WAVES, radius_mm)]
    most = np.r_[0.1, 0.1, np.inf, np.full(1 + 2 * WAVES, 0.05)]
    fit, places, steps, middle_mm = start, list[Coordinates](), list[Coordinates](), 0.0
    for last in (*[False] * (ROUNDS - 1), True):
        system = equations(of, fit, z_scale_range)
        if system is None:
            return start
        try:
            step = np.linalg.solve(system.normal, system.slope)[: reach_mm.size]
        except np.linalg.LinAlgError:
            return start
        if not np.isfinite(step).all():
            return start
        middle_mm = middle_mm if steps else system.middle_mm
        step = np.clip(step, -most, most)
        step[1] += step[2] * (middle_mm - system.middle_mm)
        places.append(_unknowns(fit, middle_mm))
        steps.append(step)
        still = float((np.abs(step) * reach_mm)[:MOVES].max()) < still_mm
        there = places[-1] + (step if still or last else _extrapolated(places, steps, reach_mm))
        fit = _fit_at(there, fit, middle_mm, z_scale_range, system.correlation)
        if still or last:
            covariance = as_covariance(_covariance(system, radius_mm))
            return replace(fit, alignment=replace(fit.alignment, covariance=covariance))
    return fit


def _extrapolated(places: list[Coordinates], steps: list[Coordinates], reach_mm: Coordinates) -> Coordinates:
    """Return the step to where, by the course of the last ones, no step is left to make.

    Weights that depend on residuals make steps shrink by a constant share only. This spares half of the steps (Walker
    and Ni 2011, Anderson acceleration for fixed-point iterations).
    """
    step = steps[-1]
    if len(steps) == 1:
        return step
    moved = np.diff(places[-MEMORY - 1 :], axis=0)
    changed = np.diff(steps[-MEMORY - 1 :], axis=0)
    share = np.linalg.lstsq((changed * reach_mm).T, step * reach_mm, rcond=1e-10)[0]
    bold: Coordinates = step - share @ (moved + changed)
    farthest = BOLDEST * np.linalg.norm(step * reach_mm)
    return bold if np.linalg.norm(bold * reach_mm) <= farthest else step


def _unknowns(fit: Bending, middle_mm: float) -> Coordinates:
    alignment = fit.alignment
    shift_mm = alignment.z_shift_mm + alignment.z_scale * middle_mm
    return np.concatenate([[alignment.theta_shift_rad, shift_mm, alignment.z_scale], fit.bends])


def _fit_at(
    there: Coordinates, before: Bending, middle_mm: float, z_scale_range: tuple[float, float], correlation: float
) -> Bending:
    scale = float(np.clip(there[2], *z_scale_range))
    alignment = replace(
        before.alignment,
        theta_shift_rad=float(there[0]),
        z_shift_mm=float(there[1]) - scale * middle_mm,
        z_scale=scale,
        correlation=correlation,
    )
    return Bending(alignment, there[MOVES:])


def _covariance(of: Equations, radius_mm: float) -> Coordinates:
    """Return the covariance (3, 3) of turn (rad), shift (mm) and scale, from how residuals pull patch by patch.

    Neighbouring residuals err alike, by blurs and by whole cells that only one side shows. So they are summed over
    patches, and only these count as independent. This is the sandwich estimate for clustered data (Liang and Zeger
    1986, Longitudinal data analysis using generalized linear models).
    """
    pulls = of.pulls(radius_mm)
    unknowns, n_patches = pulls.shape
    inverse = np.linalg.pinv(of.normal, hermitian=True)
    spread = inverse @ (pulls @ pulls.T) @ inverse * (n_patches / max(1, n_patches - unknowns))
    to_origin = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -of.middle_mm], [0.0, 0.0, 1.0]])
    return np.asarray(to_origin @ spread[:3, :3] @ to_origin.T, dtype=np.float64)
