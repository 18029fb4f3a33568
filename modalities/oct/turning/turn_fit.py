"""The fit of one slice: circle, uneven rotation and the face's own departures from the circle, in one.

A beam that is turned by ε meets a face seen from off its axis by e at another depth, by ε·e·sin(α − β): some
micrometres a degree, and the face stands out so that its place is known to a fraction of one. A constant ε turns the
direction β of the offset with it, so this says nothing of where a turn starts; nor does it say anything where the
catheter is on the axis: the prior then leaves the turn even. The face's own departures from a circle have a prior too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.points import Points, tukey_weight
from endoct.modalities.oct.face.ripple import N_RIPPLE, ripple_basis
from endoct.modalities.oct.turning.rotation import N_SMOOTH, smooth_basis
from endoct.stitching.arrays import Coordinates
from endoct.stitching.robust import robust_sigma

ROUNDNESS_MM = 0.0007  # the face's departure from a circle, each harmonic
AXIS_SIGMA_MM = 0.003
POINT_SIGMA_MM = 0.001
WIDE_MM = (0.05, 0.04, 0.03, 0.02, 0.02)
WIDEST_MM = (0.08, 0.06)
NARROW_MM = (0.012, 0.006, 0.006, 0.006)
LOST_GAIN = 28.0  # twice the logarithm of the likelihoods' ratio
LOST_RAD = (0.01, 0.15)
N_FACTORS = 1 + N_SMOOTH
FACTORS = slice(3, 3 + N_FACTORS)
RIPPLE = slice(FACTORS.stop, FACTORS.stop + N_RIPPLE)
N_UNKNOWN = RIPPLE.stop
"""Unknowns of a slice: x, y and depth of the axis; stretch and harmonics of the rotation; ripple of the face."""


def unknowns(circle: Circle, factors: Coordinates) -> Coordinates:
    """Return the unknowns of a slice from its ``circle`` and the ``factors`` of its rotation, without ripple."""
    return np.concatenate([[circle.x_mm, circle.y_mm, circle.axis_depth_mm], factors, np.zeros(N_RIPPLE)])


@dataclass(frozen=True, eq=False)
class Prior:
    """Means and inverse variances of the unknowns, float64 (N_UNKNOWN,), one more each with a lost block."""

    mean: Coordinates
    precision: Coordinates

    @classmethod
    def of(cls, axis_depth_mm: float, factors: Coordinates, sigma: Coordinates) -> "Prior":
        """Return the prior with the recording's axis depth and ``factors`` (N_FACTORS,) with their ``sigma``."""
        centred = Circle(0.0, 0.0, axis_depth_mm, np.nan)
        free = np.array([1e-6, 1e-6, 1 / AXIS_SIGMA_MM**2])
        round_ = np.full(N_RIPPLE, 1 / ROUNDNESS_MM**2)
        return cls(unknowns(centred, factors), np.concatenate([free, 1 / sigma**2, round_]))

    def with_lost_block(self) -> "Prior":
        """Return the prior with the angle of a lost block of A-scans as one unknown more."""
        return Prior(np.append(self.mean, 0.0), np.append(self.precision, 1 / LOST_RAD[1] ** 2))


@dataclass(frozen=True, eq=False)
class TurnFit:
    """One slice's fit, linear about its end: ``unknown`` as in :class:`Prior`, a lost block's angle last."""

    unknown: Coordinates
    prior: Prior
    normal: Coordinates
    jacobian: Coordinates
    weight: Coordinates
    residual: Coordinates
    slope: Coordinates
    lost_at_rad: float = float("nan")

    @property
    def factors(self) -> Coordinates:
        """Stretch and harmonics of the rotation, float64 (N_FACTORS,)."""
        return self.unknown[FACTORS]

    @property
    def lost_rad(self) -> float:
        """Angle of the lost block, rad; 0 where there is none."""
        return float(self.unknown[-1]) if np.isfinite(self.lost_at_rad) else 0.0

    @property
    def variance(self) -> float:
        """Variance of α(a), rad², its mean over the turn."""
        return mean_variance(np.asarray(np.linalg.inv(self.normal)[FACTORS, FACTORS], np.float64))

    def circle(self, radius_mm: float) -> Circle:
        """Return the fitted circle."""
        x, y, depth = (float(value) for value in self.unknown[:3])
        return Circle(x, y, depth, radius_mm)


def mean_variance(covariance: Coordinates) -> float:
    """Return the variance of α(a) that factors of ``covariance`` (N_FACTORS, N_FACTORS) make, rad², over the turn."""
    every = smooth_basis(np.linspace(0, 2 * np.pi, 90, endpoint=False))
    return float(np.mean(np.einsum("ij,jk,ik->i", every, covariance, every)))


def fit_turn(
    points: Points,
    unknown: Coordinates,
    prior: Prior,
    glass: Glass,
    widths_mm: Sequence[float] = WIDE_MM + NARROW_MM,
    lost_at_rad: float = float("nan"),
) -> TurnFit | None:
    """Return the fit to ``points`` from ``unknown`` on, by reweighted least squares with Tukey's weights.

    ``widths_mm`` are the half widths of the weights, step by step. With ``lost_at_rad``, a block of A-scans is missing
    at that nominal angle and the last of the unknowns is its size. None where points are too few or the circle is lost.
    """
    angle, depth = points.angle_rad, points.depth_mm
    basis, face = smooth_basis(angle), ripple_basis(angle)
    rotation_columns = np.arange(FACTORS.start, FACTORS.stop)
    if np.isfinite(lost_at_rad):
        basis = np.concatenate([basis, (angle >= lost_at_rad)[:, None]], axis=1)
        rotation_columns = np.append(rotation_columns, RIPPLE.stop)
    tiny = 1e-6
    fit: TurnFit | None = None
    for width in widths_mm:
        alpha = angle + basis @ unknown[rotation_columns]
        x, y = float(unknown[0]), float(unknown[1])
        if np.hypot(x, y) > 0.8 * glass.outer_radius_mm:
            return None
        distance = glass.face_distance_mm(alpha, x, y)
        residual = depth - unknown[2] - distance - face @ unknown[RIPPLE]
        weight = tukey_weight(residual, width) * points.strength
        on = weight > 0
        if np.count_nonzero(on) < unknown.size:
            return None
        slope = (glass.face_distance_mm(alpha + tiny, x, y) - distance) / tiny
        jacobian = np.empty((angle.size, unknown.size))
        jacobian[:, 0] = (glass.face_distance_mm(alpha, x + tiny, y) - distance) / tiny
        jacobian[:, 1] = (glass.face_distance_mm(alpha, x, y + tiny) - distance) / tiny
        jacobian[:, 2] = 1
        jacobian[:, rotation_columns] = slope[:, None] * basis
        jacobian[:, RIPPLE] = face
        weight /= max(POINT_SIGMA_MM, robust_sigma(residual[on])) ** 2
        normal = jacobian.T @ (weight[:, None] * jacobian) + np.diag(prior.precision)
        change = np.linalg.solve(normal, jacobian.T @ (weight * residual) + prior.precision * (prior.mean - unknown))
        unknown = unknown + change
        fit = TurnFit(unknown, prior, normal, jacobian, weight, residual, slope, lost_at_rad)
    return fit


def finish_fit(points: Points, fit: TurnFit, glass: Glass, seek_lost: bool) -> TurnFit:
    """Return a wide fit narrowed, with a lost block where one explains much that a smooth rotation does not."""
    finished = fit_turn(points, fit.unknown, fit.prior, glass, NARROW_MM) or fit
    candidates = np.unique(points.angle_rad)[4:-4]
    if not seek_lost or not candidates.size:
        return finished
    jump = (points.angle_rad[None, :] >= candidates[:, None]) * fit.slope
    weighted = jump * fit.weight
    coupled = weighted @ fit.jacobian
    # the part of the jump that the other unknowns could not take up
    left = np.sum(weighted * jump, axis=1) - np.sum(coupled * np.linalg.solve(fit.normal, coupled.T).T, axis=1)
    left = np.maximum(left, 1e-12) + 1 / LOST_RAD[1] ** 2
    pull = weighted @ fit.residual
    size, gain = pull / left, pull**2 / left
    gain = np.where((size > LOST_RAD[0]) & (size < LOST_RAD[1]), gain, 0)
    best = int(np.argmax(gain))
    if gain[best] <= LOST_GAIN:
        return finished
    begin, widths, at = np.append(fit.unknown, size[best]), (WIDE_MM[-1], *NARROW_MM), float(candidates[best])
    again = fit_turn(points, begin, fit.prior.with_lost_block(), glass, widths, at)
    if again is None or not LOST_RAD[0] < again.lost_rad < LOST_RAD[1]:
        return finished
    return again if _misfit(points, finished) - _misfit(points, again) > LOST_GAIN else finished


def _misfit(points: Points, fit: TurnFit) -> float:
    """Twice the negative logarithm of the likelihood, in which all far points count alike (Tukey), and of the prior."""
    far = NARROW_MM[-1]
    within = np.minimum((fit.residual / far) ** 2, 1)
    cost = float(np.sum(points.strength * (1 - (1 - within) ** 3))) * far**2 / 3
    return cost / POINT_SIGMA_MM**2 + float(np.sum(fit.prior.precision * (fit.unknown - fit.prior.mean) ** 2))
