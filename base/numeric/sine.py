"""The paper's sine f(x) = A sin(ωx + φ) + D of a turn about an axis that a probe is off, found among outliers.

Laves 2019, Image undistortion.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve

GAUSS_NEWTON_STEPS = 12
LEAST_DETERMINANT = 0.1  # three points less far apart say little


@dataclass(frozen=True)
class Sine:
    """f(x) = A sin(ωx + φ) + D with A ≥ 0 and φ in [0, 2π); x in rad, f, A and D in mm."""

    amplitude_mm: float
    omega: float
    phase_rad: float
    offset_mm: float

    def __call__(self, x_rad: ArrayLike) -> Coordinates:
        """Return f(x), float64 of the shape of ``x_rad``, mm."""
        x = np.asarray(x_rad, dtype=np.float64)
        return self.amplitude_mm * np.sin(self.omega * x + self.phase_rad) + self.offset_mm


def ransac_sine(
    x_rad: Coordinates, y_mm: Coordinates, *, tolerance_mm: float, trials: int, rng: Generator, start: Sine
) -> tuple[Sine, Mask]:
    """Fit a sine to the points (x, y) by random sample consensus; return it and the inliers, bool (n,).

    Each trial takes the sine with ω = 1 through three points. The trial (or ``start``) with the most points within
    ``tolerance_mm`` is then refined over its inliers, ω free, by Gauss-Newton. Raises ``ValueError`` for fewer than
    four points.
    """
    if x_rad.size < 4:
        raise ValueError("four parameters need four points")
    triples = rng.integers(0, x_rad.size, (trials, 3))
    some = rng.permutation(x_rad.size)[:256]
    begin = start.amplitude_mm * np.cos(start.phase_rad), start.amplitude_mm * np.sin(start.phase_rad), start.offset_mm
    p, q, d = _best_trial(np.sin(x_rad), np.cos(x_rad), y_mm, triples, some, tolerance_mm, np.array(begin))
    best = Sine(float(np.hypot(p, q)), 1.0, float(np.mod(np.arctan2(q, p), 2 * np.pi)), float(d))
    for _ in range(3):
        inliers = np.abs(best(x_rad) - y_mm) < tolerance_mm
        if np.count_nonzero(inliers) < 4:
            break
        best = _refine(best, x_rad[inliers], y_mm[inliers])
    return best, np.abs(best(x_rad) - y_mm) < tolerance_mm


@compiled
def _best_trial(
    sine: Coordinates,
    cosine: Coordinates,
    y_mm: Coordinates,
    triples: NDArray[np.int64],
    some: NDArray[np.int64],
    tolerance_mm: float,
    begin: Coordinates,
) -> Coordinates:
    """The factors of sine, cosine and 1 through one of ``triples``, or ``begin``, that most of ``some`` are near."""
    best, most = begin.copy(), -1
    matrix, factors = np.empty((3, 3)), begin.copy()
    for trial in range(-1, len(triples)):
        if trial >= 0:
            for k in range(3):
                at = triples[trial, k]
                matrix[k, 0], matrix[k, 1], matrix[k, 2], factors[k] = sine[at], cosine[at], 1, y_mm[at]
            determinant = 0.0
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                determinant += matrix[m, 0] * matrix[n, 1] - matrix[n, 0] * matrix[m, 1]
            if abs(determinant) <= LEAST_DETERMINANT:
                continue
            solve(matrix, factors)
        count = 0
        for i in range(some.size):
            at = some[i]
            away = factors[0] * sine[at] + factors[1] * cosine[at] + factors[2] - y_mm[at]
            count += abs(away) < tolerance_mm
        if count > most:
            most = count
            for k in range(3):
                best[k] = factors[k]
    return best


def _refine(sine: Sine, x: Coordinates, y: Coordinates) -> Sine:
    begin = np.array([sine.amplitude_mm, sine.omega, sine.phase_rad, sine.offset_mm])
    a, omega, phi, d = _gauss_newton(begin, x, y)
    if a < 0:
        a, phi = -a, phi + np.pi
    return Sine(float(a), float(omega), float(np.mod(phi, 2 * np.pi)), float(d))


@compiled
def _gauss_newton(begin: Coordinates, x: Coordinates, y: Coordinates) -> Coordinates:
    """Amplitude, ω, phase and offset after some steps from ``begin``."""
    found = begin.copy()
    matrix, step, slopes = np.empty((4, 4)), np.empty(4), np.empty(4)
    for _ in range(GAUSS_NEWTON_STEPS):
        matrix[:] = 0
        step[:] = 0
        # a small ridge: ω and φ mean nothing where the amplitude vanishes
        matrix[1, 1], matrix[2, 2] = 1e-8 * x.size, 1e-10 * x.size
        for i in range(x.size):
            inner = found[1] * x[i] + found[2]
            sine, cosine = math.sin(inner), math.cos(inner)
            slopes[0], slopes[1], slopes[2], slopes[3] = sine, found[0] * cosine * x[i], found[0] * cosine, 1
            residual = y[i] - found[0] * sine - found[3]
            for k in range(4):
                step[k] += slopes[k] * residual
                for m in range(4):
                    matrix[k, m] += slopes[k] * slopes[m]
        solve(matrix, step)
        for k in range(4):
            found[k] += step[k]
        found[1] = min(max(found[1], 0.8), 1.2)
    return found
