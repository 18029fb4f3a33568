"""The fit of one slice: circle, uneven rotation and the face's own departures from the circle, in one.

A beam that is turned by ε meets a face seen from off its axis by e at another depth, by ε·e·sin(α − β). That is some
micrometres a degree, and the face stands out so that its place is known to a fraction of one. A constant ε turns the
direction β of the offset with it, so this says nothing of where a turn starts. Nor does it say anything where the
catheter is on the axis; the prior then leaves the turn even. The face's own departures from a circle have a prior too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN, median_in_loops
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.faces import N_RIPPLE, ripple_basis
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass, face_distance
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.turning.rotation import N_SMOOTH, smooth_basis

ROUNDNESS_MM = 0.0007  # the face's departure from a circle, each harmonic
AXIS_SIGMA_MM = 0.003
POINT_SIGMA_MM = 0.001
WIDE_MM = (0.05, 0.04, 0.03, 0.02, 0.02)
WIDEST_MM = (0.08, 0.06)
NARROW_MM = (0.012, 0.006, 0.006, 0.006)
LOST_GAIN = 28.0  # twice the logarithm of the likelihoods' ratio
LOST_RAD = (0.01, 0.15)
FARTHEST = 0.8  # of the radius: an offset of the catheter beyond that is no fit
TINY = 1e-6  # steps of derivatives, rad and mm
COS_TINY, SIN_TINY = math.cos(TINY), math.sin(TINY)
N_FACTORS = 1 + N_SMOOTH
FACTORS = slice(3, 3 + N_FACTORS)
RIPPLE = slice(FACTORS.stop, FACTORS.stop + N_RIPPLE)
"""Unknowns of a slice: x, y and depth of the axis; stretch and harmonics of the rotation; ripple of the face."""


def unknowns(circle: Circle, factors: Coordinates) -> Coordinates:
    """Return the unknowns of a slice from its ``circle`` and the ``factors`` of its rotation, without ripple."""
    return np.concatenate([[circle.x_mm, circle.y_mm, circle.axis_depth_mm], factors, np.zeros(N_RIPPLE)])


@dataclass(frozen=True, eq=False)
class Prior:
    """Means and inverse variances of the unknowns, float64 (``RIPPLE.stop``,), one more each with a lost block."""

    mean: Coordinates
    precision: Coordinates

    @classmethod
    def of(cls, axis_depth_mm: float, factors: Coordinates, sigma: Coordinates) -> "Prior":
        """Return the prior with the recording's axis depth and ``factors`` (N_FACTORS,) with their ``sigma``."""
        centred = Circle(0.0, 0.0, axis_depth_mm, np.nan)
        free = np.array([1e-6, 1e-6, 1 / AXIS_SIGMA_MM**2])
        round_ = np.full(N_RIPPLE, 1 / ROUNDNESS_MM**2)
        return cls(unknowns(centred, factors), np.concatenate([free, 1 / sigma**2, round_]))


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
    around = _basis_around()
    return float(np.mean(np.einsum("ij,jk,ik->i", around, covariance, around)))


@cache
def _basis_around() -> Coordinates:
    """The basis at even steps around a turn; made when first needed, as it is by compiled code."""
    return smooth_basis(np.linspace(0, 2 * np.pi, 90, endpoint=False))


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
    angle = points.angle_rad
    basis, face = smooth_basis(angle), ripple_basis(angle)
    rotation_columns = np.arange(FACTORS.start, FACTORS.stop)
    if np.isfinite(lost_at_rad):
        basis = np.concatenate([basis, (angle >= lost_at_rad)[:, None]], axis=1)
        rotation_columns = np.append(rotation_columns, RIPPLE.stop)
    fit = TurnFit(
        unknown=unknown.copy(),
        prior=prior,
        normal=np.zeros((unknown.size, unknown.size)),
        jacobian=np.zeros((angle.size, unknown.size)),
        weight=np.zeros(angle.size),
        residual=np.zeros(angle.size),
        slope=np.zeros(angle.size),
        lost_at_rad=lost_at_rad,
    )
    done = _iterate(
        (angle, points.depth_mm, points.strength),
        (basis, rotation_columns, face),
        (glass.outer_radius_mm, glass.thickness_mm),
        np.array(widths_mm),
        (prior.mean, prior.precision),
        (fit.unknown, fit.normal, fit.jacobian, fit.weight, fit.residual, fit.slope),
    )
    return fit if done else None


@compiled
def _iterate(
    points: tuple[Coordinates, Coordinates, Coordinates],
    bases: tuple[Coordinates, NDArray[np.intp], Coordinates],
    glass: tuple[float, float],
    widths_mm: Coordinates,
    expected: tuple[Coordinates, Coordinates],
    fit: tuple[Coordinates, Coordinates, Coordinates, Coordinates, Coordinates, Coordinates],
) -> bool:
    """Improve a ``fit``, the arrays of a :class:`TurnFit`, in place, once for every width; say whether that went well.

    ``bases``: of the rotation, with the columns of its unknowns, and of the face's ripple. ``expected``: means and
    precisions of the prior. Rows of the jacobian where the weight is 0 are not made. Points where no beam could see the
    face as near as ``widths_mm`` are infinitely far.
    """
    angle, depth, strength = points
    basis, columns, face = bases
    radius_mm, thickness_mm = glass
    mean, precision = expected
    unknown, normal, jacobian, weight, residual, slope = fit
    n_unknown = unknown.size
    matrix, change = np.empty((n_unknown, n_unknown)), np.empty(n_unknown)
    used, misfit = np.empty(angle.size, np.intp), np.empty(angle.size)
    for width in widths_mm:
        x, y = unknown[0], unknown[1]
        if math.hypot(x, y) > FARTHEST * radius_mm:
            return False
        nearest, farthest = _depths_of_face(unknown, radius_mm, thickness_mm)
        for i in range(angle.size):
            if not nearest - width <= depth[i] <= farthest + width:
                residual[i], weight[i] = np.inf, 0
                continue
            beam = angle[i]
            for k in range(columns.size):
                beam += basis[i, k] * unknown[columns[k]]
            cosine, sine = math.cos(beam), math.sin(beam)
            distance = face_distance(cosine, sine, x, y, radius_mm, thickness_mm)
            ripple = 0.0
            for k in range(N_RIPPLE):
                ripple += face[i, k] * unknown[RIPPLE.start + k]
            residual[i] = depth[i] - unknown[2] - distance - ripple
            weight[i] = max(1 - (residual[i] / width) ** 2, 0) ** 2 * strength[i]
            by_angle = cosine * COS_TINY - sine * SIN_TINY, sine * COS_TINY + cosine * SIN_TINY
            turned = face_distance(by_angle[0], by_angle[1], x, y, radius_mm, thickness_mm)
            slope[i] = (turned - distance) / TINY
            if weight[i] > 0:
                by_x = face_distance(cosine, sine, x + TINY, y, radius_mm, thickness_mm)
                by_y = face_distance(cosine, sine, x, y + TINY, radius_mm, thickness_mm)
                jacobian[i, 0] = (by_x - distance) / TINY
                jacobian[i, 1] = (by_y - distance) / TINY
                jacobian[i, 2] = 1
                for k in range(N_RIPPLE):
                    jacobian[i, RIPPLE.start + k] = face[i, k]
                for k in range(columns.size):
                    jacobian[i, columns[k]] = slope[i] * basis[i, k]
        n_used = 0
        for i in range(angle.size):
            if weight[i] > 0:
                used[n_used], misfit[n_used] = i, abs(residual[i])
                n_used += 1
        if n_used < n_unknown:
            return False
        variance = max(POINT_SIGMA_MM, SIGMA_PER_MEDIAN * median_in_loops(misfit[:n_used])) ** 2
        for i in range(angle.size):
            weight[i] /= variance
        for k in range(n_unknown):
            change[k] = precision[k] * (mean[k] - unknown[k])
            for m in range(n_unknown):
                normal[k, m] = precision[k] if k == m else 0.0
        for i in range(n_used):
            at = used[i]
            for k in range(n_unknown):
                share = weight[at] * jacobian[at, k]
                change[k] += share * residual[at]
                for m in range(n_unknown):
                    normal[k, m] += share * jacobian[at, m]
        for k in range(n_unknown):
            for m in range(n_unknown):
                matrix[k, m] = normal[k, m]
        solve(matrix, change)
        for k in range(n_unknown):
            unknown[k] += change[k]
    return True


@compiled
def _depths_of_face(unknown: Coordinates, radius_mm: float, thickness_mm: float) -> tuple[float, float]:
    """The least and the most depth at which any beam could meet the face, mm."""
    offset, inner_mm = math.hypot(unknown[0], unknown[1]), radius_mm - thickness_mm
    if offset > 0.99 * inner_mm:  # no catheter lies there
        return -np.inf, np.inf
    within = (offset / GLASS_INDEX) ** 2
    through = math.sqrt(radius_mm**2 - within) - math.sqrt(inner_mm**2 - within)
    oblique = GLASS_INDEX * (through - thickness_mm)
    around = 0.0
    for k in range(RIPPLE.start, RIPPLE.stop):
        around += abs(unknown[k])
    around += TINY
    return unknown[2] + radius_mm - offset - around, unknown[2] + radius_mm + offset + oblique + around


def finish_fit(points: Points, fit: TurnFit, glass: Glass, seek_lost: bool) -> TurnFit:
    """Return a wide fit narrowed, with a lost block where one explains much that a smooth rotation does not."""
    finished = fit_turn(points, fit.unknown, fit.prior, glass, NARROW_MM) or fit
    candidates = np.unique(points.angle_rad)[4:-4]
    if not seek_lost or not candidates.size:
        return finished
    used = np.flatnonzero(fit.weight > 0)
    used = used[np.argsort(points.angle_rad[used], kind="stable")]
    after = np.searchsorted(points.angle_rad[used], candidates)
    # a jump moves all points from its angle on, so that its sums run from the last point back to there
    weighted = fit.slope[used] * fit.weight[used]
    coupled = _sums_from(after, weighted[:, None] * fit.jacobian[used])
    # the part of the jump that the other unknowns could not take up
    left = _sums_from(after, weighted * fit.slope[used])
    left -= np.sum(coupled * np.linalg.solve(fit.normal, coupled.T).T, axis=1)
    left = np.maximum(left, 1e-12) + 1 / LOST_RAD[1] ** 2
    pull = _sums_from(after, weighted * fit.residual[used])
    size, gain = pull / left, pull**2 / left
    gain = np.where((size > LOST_RAD[0]) & (size < LOST_RAD[1]), gain, 0)
    best = int(np.argmax(gain))
    if gain[best] <= LOST_GAIN:
        return finished
    begin, widths, at = np.append(fit.unknown, size[best]), (WIDE_MM[-1], *NARROW_MM), float(candidates[best])
    with_block = Prior(np.append(fit.prior.mean, 0.0), np.append(fit.prior.precision, 1 / LOST_RAD[1] ** 2))
    again = fit_turn(points, begin, with_block, glass, widths, at)
    if again is None or not LOST_RAD[0] < again.lost_rad < LOST_RAD[1]:
        return finished
    return again if _misfit(points, finished) - _misfit(points, again) > LOST_GAIN else finished


def _sums_from(first: NDArray[np.intp], rows: Coordinates) -> Coordinates:
    """Return for each index in ``first`` the sum of ``rows`` from there on; none are left at ``len(rows)``."""
    sums = np.concatenate([np.cumsum(rows[::-1], axis=0)[::-1], np.zeros_like(rows[:1])])
    return np.asarray(sums[first])


def _misfit(points: Points, fit: TurnFit) -> float:
    """Twice the negative logarithm of the likelihood, in which all far points count alike (Tukey), and of the prior."""
    far = NARROW_MM[-1]
    within = np.minimum((fit.residual / far) ** 2, 1)
    cost = float(np.sum(points.strength * (1 - (1 - within) ** 3))) * far**2 / 3
    return cost / POINT_SIGMA_MM**2 + float(np.sum(fit.prior.precision * (fit.unknown - fit.prior.mean) ** 2))
