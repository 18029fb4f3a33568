"""The paper's sine f(x) = A sin(ωx + φ) + D for the depth of the capillary's outer face.

Laves 2019, Image undistortion. With ω = 1, A = e and φ = −β − π/2 it is the first order of the circle that a catheter
sees which lies off the axis by e in the direction β (:mod:`endoct.modalities.oct.face.circle`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Coordinates, Mask

GAUSS_NEWTON_STEPS = 12


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


def slice_sine(points: Points, circle: Circle, index: int, parameters: OctParameters) -> Sine:
    """Return the sine of one slice through its ``points`` near ``circle``; fewer than four leave the start value.

    That is what ``parameters`` give, and the first order of the circle for the rest.
    """
    # by how much the circle's mean depth falls short of that of a catheter on the axis
    second_order_mm = circle.offset_mm**2 / (4 * circle.radius_mm)
    amplitude_mm, phase_rad = parameters.start_amplitude_mm, parameters.start_phase_rad
    phase_rad = -circle.direction_rad - np.pi / 2 if phase_rad is None else phase_rad
    start = Sine(
        amplitude_mm=circle.offset_mm if amplitude_mm is None else amplitude_mm,
        omega=1.0,
        phase_rad=float(np.mod(phase_rad, 2 * np.pi)),
        offset_mm=circle.axis_depth_mm + circle.radius_mm - second_order_mm,
    )
    near = points.where(np.abs(points.beyond_mm(circle)) < 2 * parameters.face_tolerance_mm)
    if len(near) < 4:
        return start
    sine, _ = ransac_sine(
        near.angle_rad,
        near.depth_mm,
        tolerance_mm=parameters.face_tolerance_mm + second_order_mm,
        trials=parameters.ransac_trials,
        rng=np.random.default_rng((parameters.seed, index)),
        start=start,
    )
    return sine


def ransac_sine(
    x_rad: Coordinates, y_mm: Coordinates, *, tolerance_mm: float, trials: int, rng: Generator, start: Sine
) -> tuple[Sine, Mask]:
    """Fit a sine to the points (x, y) by random sample consensus; return it and the inliers, bool (n,).

    Each trial takes the sine with ω = 1 through three points; the trial (or ``start``) with the most points
    within ``tolerance_mm`` is then refined over its inliers, ω free, by Gauss-Newton. Raises ``ValueError``
    for fewer than four points.
    """
    if x_rad.size < 4:
        raise ValueError("four parameters need four points")
    triples = rng.integers(0, x_rad.size, (trials, 3))
    matrix = np.stack([np.sin(x_rad[triples]), np.cos(x_rad[triples]), np.ones(triples.shape)], axis=-1)
    regular = np.abs(np.linalg.det(matrix)) > 0.1
    linear = np.linalg.solve(matrix[regular], y_mm[triples[regular], None])[..., 0]
    a, phi = start.amplitude_mm, start.phase_rad
    linear = np.vstack([[a * np.cos(phi), a * np.sin(phi), start.offset_mm], linear])
    some = rng.permutation(x_rad.size)[:256]
    basis = np.stack([np.sin(x_rad[some]), np.cos(x_rad[some]), np.ones(some.size)])
    count = np.count_nonzero(np.abs(linear @ basis - y_mm[some]) < tolerance_mm, axis=1)
    p, q, d = linear[int(np.argmax(count))]
    best = Sine(float(np.hypot(p, q)), 1.0, float(np.mod(np.arctan2(q, p), 2 * np.pi)), float(d))
    for _ in range(3):
        inliers = np.abs(best(x_rad) - y_mm) < tolerance_mm
        if np.count_nonzero(inliers) < 4:
            break
        best = _refine(best, x_rad[inliers], y_mm[inliers])
    return best, np.abs(best(x_rad) - y_mm) < tolerance_mm


def _refine(sine: Sine, x: Coordinates, y: Coordinates) -> Sine:
    a, omega, phi, d = sine.amplitude_mm, sine.omega, sine.phase_rad, sine.offset_mm
    for _ in range(GAUSS_NEWTON_STEPS):
        inner = omega * x + phi
        slope = a * np.cos(inner)
        jacobian = np.stack([np.sin(inner), slope * x, slope, np.ones_like(x)], axis=1)
        # a small ridge: ω and φ mean nothing where the amplitude vanishes
        normal = jacobian.T @ jacobian + 1e-6 * x.size * np.diag([0, 1e-2, 1e-4, 0])
        step = np.linalg.solve(normal, jacobian.T @ (y - a * np.sin(inner) - d))
        a, omega, phi, d = a + step[0], float(np.clip(omega + step[1], 0.8, 1.2)), phi + step[2], d + step[3]
    if a < 0:
        a, phi = -a, phi + np.pi
    return Sine(float(a), float(omega), float(np.mod(phi, 2 * np.pi)), float(d))
