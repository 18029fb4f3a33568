"""How B bends along the bore, where one rigid place is not right for all of it: a shift and a roll at every z.

A catheter slips or rolls, a feed drifts, slices are lost or doubled. Shift and roll are linear between knots, and
Gauss–Newton finds them to a fraction of a sample. It starts from no bend, and from the course of both that
:mod:`endoct.fusion.registration.courses` finds, whose jumps part the bore into stretches.

Either must explain wall that it was not fitted on. A quarter of the bore's directions is left out, in turn, and the
bend that the others show has to be better there than the rigid place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from endoct.base.arrays import Coordinates, Mask
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.fusion.registration.courses import INDEPENDENT_MM2, REACH_MM, REACH_RAD, Course, cheapest_course, jumps_of
from endoct.fusion.registration.equations import PATCH_MM, Level, RowEquations, patches_around, row_equations
from endoct.fusion.registration.refinement import blurred_level

KNOT_MM = 1.5
"""Distance of knots, at most."""
GAP_MM = 0.02
"""Distance of the two knots of a jump; where the wall jumps back, as far as it does."""
RATE = 0.03, 0.03
"""How much roll, rad, and shift, mm, typically change along a millimetre; with the root of the distance."""
BLURS_MM = 0.12, 0.06
ROUNDS = 6
STILL = 1e-3
BOLDEST = 0.1
FOLDS = 4
BLOCK_MM = 0.8
"""Height of the patches of wall that gain or lose as one."""
LEAST_GAIN = 1.5
"""How many of its standard errors the gain on wall left out must be. It was 0.9 at most in 46 rigid pairs of two
generators (quick, hard, mastoid, and few, floors, sound, tiny of benchmarks/independent; seeds 9300-9309)."""
LEAST_MM = 0.06
"""A bend that moves no place by more is none."""


@dataclass(frozen=True, eq=False)
class _Knots:
    """Knots at ``z_mm`` (k,), ascending, each on one of the stretches that begin at ``jumps_mm``."""

    z_mm: Coordinates
    stretch: Coordinates
    jumps_mm: Coordinates

    @classmethod
    def over(cls, first_mm: float, last_mm: float, jumps_mm: Sequence[float]) -> "_Knots":
        edges = [first_mm, *jumps_mm, last_mm]
        z_mm, stretch = list[Coordinates](), list[Coordinates]()
        for k, (low, high) in enumerate(pairwise(edges)):
            n = 2 + int((high - low) / KNOT_MM)
            z_mm.append(np.linspace(low + GAP_MM / 2 * (k > 0), high - GAP_MM / 2 * (k < len(jumps_mm)), n))
            stretch.append(np.full(n, float(k)))
        return cls(np.concatenate(z_mm), np.concatenate(stretch), np.array(jumps_mm, np.float64))

    def at(self, z_mm: Coordinates) -> Coordinates:
        """Return how much each knot counts at ``z_mm`` (n,), (n, k)."""
        of = np.searchsorted(self.jumps_mm, z_mm, side="right")
        counts = np.zeros((z_mm.size, self.z_mm.size))
        for k in range(self.z_mm.size):
            same = self.stretch == self.stretch[k]
            hat = np.interp(z_mm, self.z_mm[same], np.arange(self.z_mm.size)[same] == k)
            counts[:, k] = np.where(of == self.stretch[k], hat, 0)
        return counts

    def stiffness(self) -> Coordinates:
        """Return the precision (k, k) of values of which neighbours on a stretch differ by 1 along a millimetre."""
        joined = np.flatnonzero(np.diff(self.stretch) == 0)
        apart = np.diff(np.eye(self.z_mm.size), axis=0)[joined]
        return np.asarray(apart.T @ (apart / np.diff(self.z_mm)[joined, np.newaxis]))

    def bend(self, values: Coordinates, errors: Coordinates) -> Bend | None:
        """Return the bend by roll and shift, (2, k), and their errors; None where wall would be shown twice."""
        z_mm, (roll_rad, shift_mm) = self.z_mm.copy(), values
        for k in np.flatnonzero(np.diff(self.stretch)):
            back_mm = shift_mm[k] - shift_mm[k + 1] - (z_mm[k + 1] - z_mm[k])
            if back_mm > -GAP_MM / 10:
                z_mm[k : k + 2] += (back_mm + GAP_MM / 10) / 2 * np.array([-1, 1])
        if not ((np.diff(z_mm) > 0).all() and (np.diff(z_mm + shift_mm) > 0).all()):
            return None
        return Bend(*(tuple(part.tolist()) for part in (z_mm, shift_mm, roll_rad, errors[1], errors[0])))


def find_bend(a: Evidence, b: Evidence, alignment: Alignment) -> Bend | None:
    """Return how ``b``, as a rigid ``alignment`` places it on ``a``, bends; None where nothing speaks for it.

    Both are clipped, as :func:`~endoct.fusion.registration.refinement.refine` has them.
    """
    if a.dz_mm > b.dz_mm:
        turned = alignment.inverse()
        found = find_bend(b, a, turned)
        return found and replace(turned, bend=found).inverse().bend
    levels = [blurred_level(a, b, 1, sigma_mm) for sigma_mm in BLURS_MM]
    rigid = row_equations(levels[-1], alignment)
    if rigid is None:
        return None
    ways = [(*_gain(a, b, alignment, levels, rigid, jumping=jumping), jumping) for jumping in (False, True)]
    # jumps say what happened: they are taken unless knots without any explain clearly more
    clear = [(gain + error * jumping, jumping) for gain, error, jumping in ways if gain > LEAST_GAIN * error]
    bend = _fit(a, b, alignment, levels, jumping=max(clear)[1]) if clear else None
    if bend is None or max(np.abs(bend.shift_mm).max(), a.radius_mm * np.abs(bend.roll_rad).max()) < LEAST_MM:
        return None
    return bend


def _gain(
    a: Evidence, b: Evidence, alignment: Alignment, levels: Sequence[Level], rigid: RowEquations, *, jumping: bool
) -> tuple[float, float]:
    """Return how much better than ``rigid`` a bend explains wall that it was not fitted on, and the standard error."""
    n_around = rigid.cost.shape[1]
    fold_of = np.arange(n_around) * FOLDS // n_around
    gain = np.zeros((levels[-1].coarse.z_mm.size, n_around))
    for fold in range(FOLDS):
        rest = [replace(of, coarse=_without(of.coarse, fold_of == fold)) for of in levels]
        bend = _fit(a, _without(b, fold_of == fold), alignment, rest, jumping=jumping)
        bent = bend and row_equations(levels[-1], replace(alignment, bend=bend), rigid.size)
        if bent:
            shared, one, two = np.intersect1d(rigid.rows, bent.rows, return_indices=True)
            gain[np.ix_(shared, fold_of == fold)] = (rigid.cost[one] - bent.cost[two])[:, fold_of == fold]
    height = max(1, round(BLOCK_MM / levels[-1].coarse.dz_mm))
    patches = np.add.reduceat(gain, np.arange(0, gain.shape[0], height), axis=0)
    return float(patches.sum()), float(np.linalg.norm(patches))


def _without(evidence: Evidence, patches: Mask) -> Evidence:
    """Return ``evidence`` as if these of the patches around the bore, bool (n_around,), had not been observed."""
    of_column = np.searchsorted(patches_around(evidence), np.arange(evidence.values.shape[1]), side="right") - 1
    return replace(evidence, valid=evidence.valid & ~patches[of_column])


def _fit(a: Evidence, b: Evidence, alignment: Alignment, levels: Sequence[Level], *, jumping: bool) -> Bend | None:
    """Return the bend found from none, or from the course with jumps; None where too little is known."""
    course = cheapest_course(a, b, alignment) if jumping else _no_course(a, b, alignment)
    if course is None:
        return None
    knots = _Knots.over(float(course.z_mm[0]), float(course.z_mm[-1]), jumps_of(course) if jumping else ())
    stiffness, counts = knots.stiffness(), knots.at(course.z_mm)
    loose = counts.T @ counts + 0.1 * stiffness + 1e-6 * np.eye(knots.z_mm.size)
    of_course = np.stack([course.roll_rad, course.shift_mm], axis=1)
    values = np.asarray(np.linalg.solve(loose, counts.T @ of_course).T, dtype=np.float64)
    precision = block_diag(*(stiffness / rate**2 for rate in RATE))
    errors = np.zeros_like(values)
    for of in levels:
        refined = _gauss_newton(of, alignment, knots, values, precision)
        if refined is None:
            return None
        values, errors = refined
    return knots.bend(values, errors)


def _no_course(a: Evidence, b: Evidence, alignment: Alignment) -> Course | None:
    z_mm = np.sort(alignment.z_to_a(b.z_mm))
    z_mm = z_mm[(z_mm >= a.z_mm[0]) & (z_mm <= a.z_mm[-1])]
    return Course(z_mm, np.zeros(z_mm.size), np.zeros(z_mm.size)) if z_mm.size > 1 else None


def _gauss_newton(
    of: Level, alignment: Alignment, knots: _Knots, values: Coordinates, precision: Coordinates
) -> tuple[Coordinates, Coordinates] | None:
    """Return roll and shift at the knots, (2, k), improved from ``values``, and their standard errors."""
    shape, n = values.shape, values.size
    most = np.array([[REACH_RAD], [REACH_MM]])
    as_one = INDEPENDENT_MM2 / (of.coarse.dz_mm * of.coarse.column_mm)  # samples of which all err alike
    for _ in range(ROUNDS):
        bend = knots.bend(values, np.zeros_like(values))
        system = bend and row_equations(of, replace(alignment, bend=bend))
        if not (bend and system):
            return None
        at_mm = alignment.z_to_a(of.coarse.z_mm[system.rows])
        counts = knots.at(at_mm)
        jumps = np.flatnonzero(np.diff(knots.stretch))
        for k in jumps:  # rows amid a jump back lie on neither side of it
            counts[(at_mm > bend.z_mm[k]) & (at_mm < bend.z_mm[k + 1])] = 0
        normal = np.einsum("rk,rij,rl->ikjl", counts, system.normal, counts).reshape(n, n)
        pulls = np.einsum("rk,rmi->rmik", counts, system.pulls).reshape(*system.cost.shape, n)
        prior = precision * as_one * (2 * system.size) ** 2
        total = normal + prior + 1e-9 * np.trace(normal) * np.eye(n)
        step = np.linalg.solve(total, pulls.sum(axis=(0, 1)) - prior @ values.ravel())
        step = np.clip(step, -BOLDEST, BOLDEST).reshape(shape)
        values = np.clip(values + step, -most, most)
        if np.abs(step).max() < STILL:
            break
    # residuals err as one within a patch, as those of a rigid alignment do
    patch = np.flatnonzero(np.diff(np.floor((at_mm - at_mm.min()) / PATCH_MM), prepend=-1))
    pulls = np.add.reduceat(pulls, patch, axis=0).reshape(-1, n)
    inverse = np.linalg.pinv(total, hermitian=True)
    errors = np.sqrt(np.maximum(np.diag(inverse @ (pulls.T @ pulls) @ inverse), 0)).reshape(shape)
    return values, errors
