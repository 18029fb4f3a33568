"""The uneven rotation within every turn, from how the capillary's outer face departs from a circle.

A beam that is turned by ε meets a face seen from off its axis by e at another depth, by ε·e·sin(α − β): some
micrometres a degree, and the face stands out so that its place is known to a fraction of one. A constant ε turns the
direction β of the offset with it, so where a turn starts cannot be told this way, and with the catheter on the axis
nothing can: the prior then leaves the turn even. The face's own departures from a circle are given a prior too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.modalities.oct.face.capillary import Faces
from endoct.modalities.oct.face.glass import GLASS_INDEX
from endoct.modalities.oct.face.lines import Points
from endoct.modalities.oct.face.sine import RIPPLE_HARMONICS, circle_distance_mm, ripple_basis
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import HARMONICS, N_SMOOTH, Rotation, even_rotation, smooth_basis
from endoct.stitching.arrays import Coordinates

STRETCH_SIGMA = 0.02  # 1–3 % of jitter in published catheters
SMOOTH_SIGMA_RAD = 0.06  # of the first harmonic, of the others in proportion to 1/h: a few degrees, 10° at bends
ROUNDNESS_MM = 0.0007  # the face's departure from a circle, each harmonic
AXIS_SIGMA_MM = 0.003
POINT_SIGMA_MM = 0.001
WIDE_MM = (0.05, 0.04, 0.03, 0.02, 0.02)
WIDEST_MM = (0.08, 0.06)
NARROW_MM = (0.012, 0.006, 0.006, 0.006)
NOTHING_RAD = 1e-6
LEAST_SHARE = 0.35  # of sectors that show the face
CERTAIN_SHARE = 0.5  # of the same, where the face was not seen by a circle
NEAR_AXIS_MM = 0.04
LEAST_INFORMATION = 0.5  # of the variance that was possible may be left
MOST_UNEVEN = 0.7  # of the mean speed
NEIGHBOURS = 4
LEAST_NEIGHBOURS = 3
LOST_GAIN = 28.0  # twice the logarithm of the likelihoods' ratio
LOST_RAD = (0.01, 0.15)


def measure_turns(
    slices: Sequence[SliceEvidence], faces: Faces, radius_mm: float, glass_mm: float, parameters: OctParameters
) -> tuple[Rotation, Faces]:
    """Return the rotation within every slice's turn (starts are left at 0), and the faces with offsets to match.

    Slices in the order of z: what friction does changes slowly along it, so that each slice is fitted again about
    what its neighbours show. ``glass_mm`` may be 0, for not known. What ``parameters`` switch off stays even.
    """
    n = len(slices)
    circles = np.stack([faces.x_mm, faces.y_mm, faces.axis_depth_mm], axis=1)
    open_ = np.array([parameters.correct_turn_length, *[parameters.correct_rotation] * N_SMOOTH])
    h = np.repeat(np.arange(1, HARMONICS + 1), 2)
    usual = np.where(open_, np.concatenate([[STRETCH_SIGMA], SMOOTH_SIGMA_RAD / h]), NOTHING_RAD)
    axis_mm = float(np.median(faces.axis_depth_mm[~faces.bridged]))
    mean = np.array([0.0, 0.0, axis_mm])
    for i in map(int, np.flatnonzero(faces.bridged)):  # too uneven a turn, perhaps, for an even one's circle
        lines = slices[i].lines
        near = lines[np.abs(lines[:, 2] - axis_mm) < NEAR_AXIS_MM]
        if near.size:
            circles[i] = near[int(np.argmax(near[:, 3])), :3]
    start = np.concatenate([circles, np.zeros((n, usual.size + 2 * (RIPPLE_HARMONICS - 1)))], axis=1)
    usual_prior = _Prior.of(mean, np.zeros(usual.size), usual)
    told: list[Coordinates | None] = []  # no more than the factors: a fit's matrices are larger than its slice
    for begin, evidence in zip(start, slices, strict=True):
        first = _solve(evidence.points, begin, usual_prior, radius_mm, glass_mm)
        told.append(first.factors if first is not None and _trusted(first, evidence, usual) else None)
    about, spread = _neighbours(told, usual)
    stretch, smooth = np.zeros(n), np.zeros((n, N_SMOOTH))
    lost_at, lost, sigma = np.full(n, np.nan), np.zeros(n), np.full(n, np.nan)
    known = np.zeros(n, bool)
    can_tell = any(factors is not None for factors in told)
    for i, evidence in enumerate(slices):
        begin = start[i].copy()
        begin[3 : 3 + usual.size] = about[i]
        widths = WIDE_MM if told[i] is not None else WIDEST_MM + WIDE_MM
        wide = _solve(evidence.points, begin, _Prior.of(mean, about[i], spread), radius_mm, glass_mm, widths)
        fit = None
        if wide is not None and can_tell:
            fit = _finished(evidence.points, wide, radius_mm, glass_mm, parameters.correct_lost_ascans)
        if fit is not None and _plausible(fit, evidence, usual, CERTAIN_SHARE if faces.bridged[i] else LEAST_SHARE):
            circles[i], known[i], sigma[i] = fit.unknown[:3], True, np.sqrt(fit.variance)
            stretch[i], smooth[i], lost_at[i], lost[i] = fit.factors[0], fit.factors[1:], fit.lost_at_rad, fit.lost_rad
        elif not faces.bridged[i]:
            # as its neighbours turned, which is nothing where they did not tell either
            fixed = _Prior.of(mean, about[i], np.full(usual.size, NOTHING_RAD))
            fit = _solve(evidence.points, begin, fixed, radius_mm, glass_mm)
            if fit is not None:
                circles[i], smooth[i] = fit.unknown[:3], about[i, 1:]
    rotation = replace(
        even_rotation(n),
        stretch=stretch,
        smooth_rad=smooth,
        lost_at_rad=lost_at,
        lost_rad=lost,
        shape_known=known,
        shape_sigma_rad=sigma,
    )
    kept = faces.bridged & ~known
    circles[kept] = np.stack([faces.x_mm, faces.y_mm, faces.axis_depth_mm], axis=1)[kept]
    x, y, depth = circles.T
    return rotation, replace(faces, x_mm=x, y_mm=y, axis_depth_mm=depth, bridged=kept)


def turned(evidence: SliceEvidence, rotation: Rotation, index: int) -> SliceEvidence:
    """Return what a survey kept of a slice with beam angles in place of nominal ones."""
    points = evidence.points
    return replace(
        evidence,
        points=Points(rotation.beam_rad(index, points.angle_rad), points.depth_mm, points.strength),
        ascan_angle_rad=rotation.beam_rad(index, evidence.ascan_angle_rad),
    )


def face_distance_mm(
    alpha_rad: Coordinates, x_mm: float, y_mm: float, radius_mm: float, glass_mm: float
) -> Coordinates:
    """Return the optical path to the outer face, less the glass's delay where a beam meets it squarely, mm.

    An oblique beam goes a longer way through the glass.
    """
    if not glass_mm:
        return circle_distance_mm(alpha_rad, x_mm, y_mm, radius_mm)
    across = x_mm * np.sin(alpha_rad) - y_mm * np.cos(alpha_rad)
    along = x_mm * np.cos(alpha_rad) + y_mm * np.sin(alpha_rad)
    inner_mm = radius_mm - glass_mm
    within = (across / GLASS_INDEX) ** 2
    to_inner = np.sqrt(np.maximum(inner_mm**2 - across**2, 1e-6)) - along
    through = np.sqrt(radius_mm**2 - within) - np.sqrt(np.maximum(inner_mm**2 - within, 1e-6))
    return np.asarray(to_inner + GLASS_INDEX * through - (GLASS_INDEX - 1) * glass_mm)


@dataclass(frozen=True, eq=False)
class _Prior:
    """Means and inverse variances of x, y, depth of the axis, the factors of the rotation and the face's harmonics."""

    mean: Coordinates
    precision: Coordinates

    @classmethod
    def of(cls, circle: Coordinates, factors: Coordinates, sigma: Coordinates) -> "_Prior":
        n_face = 2 * (RIPPLE_HARMONICS - 1)
        free = np.array([1e-6, 1e-6, 1 / AXIS_SIGMA_MM**2])
        return cls(
            np.concatenate([circle, factors, np.zeros(n_face)]),
            np.concatenate([free, 1 / sigma**2, np.full(n_face, 1 / ROUNDNESS_MM**2)]),
        )

    def with_lost_block(self) -> "_Prior":
        return _Prior(np.append(self.mean, 0.0), np.append(self.precision, 1 / LOST_RAD[1] ** 2))


@dataclass(frozen=True, eq=False)
class _Fit:
    """One slice's fit, linear about its end: ``unknown`` as in :class:`_Prior`, a lost block's angle last."""

    unknown: Coordinates
    prior: _Prior
    normal: Coordinates
    jacobian: Coordinates
    weight: Coordinates
    residual: Coordinates
    slope: Coordinates
    lost_at_rad: float = float("nan")

    @property
    def factors(self) -> Coordinates:
        return self.unknown[3 : 4 + N_SMOOTH]

    @property
    def lost_rad(self) -> float:
        return float(self.unknown[-1]) if np.isfinite(self.lost_at_rad) else 0.0

    @property
    def variance(self) -> float:
        """Of α(a), rad², its mean over the turn."""
        return _mean_variance(np.asarray(np.linalg.inv(self.normal)[3 : 4 + N_SMOOTH, 3 : 4 + N_SMOOTH], np.float64))


def _mean_variance(covariance: Coordinates) -> float:
    every = smooth_basis(np.linspace(0, 2 * np.pi, 90, endpoint=False))
    return float(np.mean(np.einsum("ij,jk,ik->i", every, covariance, every)))


def _neighbours(factors: Sequence[Coordinates | None], usual: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return about what to expect every slice's factors, (n, k), and how far they stray from that, (k,).

    Turn lengths differ from turn to turn; only the smooth error is that of the neighbours.
    """
    n = len(factors)
    found = np.array([np.full(usual.size, np.nan) if one is None else one for one in factors])
    about = np.zeros_like(found)
    for i in range(n):
        near = np.r_[max(0, i - NEIGHBOURS) : i, i + 1 : min(n, i + NEIGHBOURS + 1)]
        near = near[np.isfinite(found[near, 0])]
        if near.size >= LEAST_NEIGHBOURS:
            about[i] = np.median(found[near], axis=0)
    about[:, 0] = 0
    away = found - about
    away = away[np.isfinite(away[:, 0])]
    spread = 1.4826 * np.median(np.abs(away), axis=0) if away.size else usual
    # never surer than a third of what is usual: a few slices may differ
    spread = np.clip(spread, usual / 6, usual)
    spread[0] = usual[0]
    return about, spread


def _trusted(fit: "_Fit", evidence: SliceEvidence, usual: Coordinates) -> bool:
    """Whether a fit about nothing known told enough, and what may be."""
    possible = _mean_variance(np.diag(usual**2))
    return _plausible(fit, evidence, usual, LEAST_SHARE) and fit.variance < LEAST_INFORMATION * possible


def _plausible(fit: "_Fit", evidence: SliceEvidence, usual: Coordinates, share: float) -> bool:
    """Whether enough of the face was seen, and what it told is a rotation."""
    if np.unique(evidence.points.angle_rad[fit.weight > 0]).size < share * evidence.n_columns:
        return False
    rate = np.diff(smooth_basis(np.linspace(0, 2 * np.pi, 180)) @ fit.factors) / (2 * np.pi / 179)
    return bool(np.abs(rate).max() < MOST_UNEVEN and np.all(np.abs(fit.factors) < 5 * usual))


def _solve(
    points: Points,
    unknown: Coordinates,
    prior: _Prior,
    radius_mm: float,
    glass_mm: float,
    widths_mm: Sequence[float] = WIDE_MM + NARROW_MM,
    lost_at_rad: float = float("nan"),
) -> _Fit | None:
    """Reweighted least squares (Tukey) over circle, rotation, face and, with ``lost_at_rad``, a lost block."""
    angle, depth = points.angle_rad, points.depth_mm
    basis, face = smooth_basis(angle), ripple_basis(angle)
    first_face = 3 + basis.shape[1]
    last_face = first_face + face.shape[1]
    rotation_columns = np.arange(3, first_face)
    if np.isfinite(lost_at_rad):
        basis = np.concatenate([basis, (angle >= lost_at_rad)[:, None]], axis=1)
        rotation_columns = np.append(rotation_columns, last_face)
    tiny = 1e-6
    fit: _Fit | None = None
    for width in widths_mm:
        alpha = angle + basis @ unknown[rotation_columns]
        x, y = float(unknown[0]), float(unknown[1])
        if np.hypot(x, y) > 0.8 * radius_mm:
            return None
        distance = face_distance_mm(alpha, x, y, radius_mm, glass_mm)
        residual = depth - unknown[2] - distance - face @ unknown[first_face:last_face]
        weight = np.maximum(1 - (residual / width) ** 2, 0) ** 2 * points.strength
        on = weight > 0
        if np.count_nonzero(on) < unknown.size:
            return None
        slope = (face_distance_mm(alpha + tiny, x, y, radius_mm, glass_mm) - distance) / tiny
        jacobian = np.empty((angle.size, unknown.size))
        jacobian[:, 0] = (face_distance_mm(alpha, x + tiny, y, radius_mm, glass_mm) - distance) / tiny
        jacobian[:, 1] = (face_distance_mm(alpha, x, y + tiny, radius_mm, glass_mm) - distance) / tiny
        jacobian[:, 2] = 1
        jacobian[:, rotation_columns] = slope[:, None] * basis
        jacobian[:, first_face:last_face] = face
        weight /= max(POINT_SIGMA_MM, 1.4826 * float(np.median(np.abs(residual[on])))) ** 2
        normal = jacobian.T @ (weight[:, None] * jacobian) + np.diag(prior.precision)
        change = np.linalg.solve(normal, jacobian.T @ (weight * residual) + prior.precision * (prior.mean - unknown))
        unknown = unknown + change
        fit = _Fit(unknown, prior, normal, jacobian, weight, residual, slope, lost_at_rad)
    return fit


def _finished(points: Points, fit: _Fit, radius_mm: float, glass_mm: float, seek_lost: bool) -> _Fit:
    """Return a wide fit narrowed, with a lost block where one explains much that smooth rotation does not."""
    finished = _solve(points, fit.unknown, fit.prior, radius_mm, glass_mm, NARROW_MM) or fit
    candidates = np.unique(points.angle_rad)[4:-4]
    if not seek_lost or not candidates.size:
        return finished
    jump = (points.angle_rad[None, :] >= candidates[:, None]) * fit.slope
    weighted = jump * fit.weight
    coupled = weighted @ fit.jacobian
    # what of the jump the other unknowns could not take up
    left = np.sum(weighted * jump, axis=1) - np.sum(coupled * np.linalg.solve(fit.normal, coupled.T).T, axis=1)
    left = np.maximum(left, 1e-12) + 1 / LOST_RAD[1] ** 2
    pull = weighted @ fit.residual
    size, gain = pull / left, pull**2 / left
    gain = np.where((size > LOST_RAD[0]) & (size < LOST_RAD[1]), gain, 0)
    best = int(np.argmax(gain))
    if gain[best] <= LOST_GAIN:
        return finished
    begin, widths, at = np.append(fit.unknown, size[best]), (WIDE_MM[-1], *NARROW_MM), float(candidates[best])
    again = _solve(points, begin, fit.prior.with_lost_block(), radius_mm, glass_mm, widths, at)
    if again is None or not LOST_RAD[0] < again.lost_rad < LOST_RAD[1]:
        return finished
    return again if _misfit(points, finished) - _misfit(points, again) > LOST_GAIN else finished


def _misfit(points: Points, fit: _Fit) -> float:
    """Twice the negative logarithm of the likelihood, points far off counting alike (Tukey), and of the prior."""
    far = NARROW_MM[-1]
    within = np.minimum((fit.residual / far) ** 2, 1)
    cost = float(np.sum(points.strength * (1 - (1 - within) ** 3))) * far**2 / 3
    return cost / POINT_SIGMA_MM**2 + float(np.sum(fit.prior.precision * (fit.unknown - fit.prior.mean) ** 2))
