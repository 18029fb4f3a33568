"""How the rotation is corrected: uneven turns first, then the angles at which turns start.

The uneven rotation within a turn shows in how the capillary's outer face departs from a circle. Every slice is
fitted twice (:mod:`endoct.modalities.oct.turning.turn_fit`): first alone, then about what its neighbours showed,
since friction changes slowly along the bore.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.memory import Computed
from endoct.base.numeric.ranks import robust_sigmas
from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.faces import Faces, refit_faces, starts_anywhere
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import HARMONICS, N_SMOOTH, Rotation, even_rotation, smooth_basis
from endoct.modalities.oct.turning.start_angle import measure_starts
from endoct.modalities.oct.turning.turn_fit import (
    N_FACTORS,
    WIDE_MM,
    WIDEST_MM,
    Prior,
    TurnFit,
    finish_fit,
    fit_turn,
    mean_variance,
    unknowns,
)

STRETCH_SIGMA = 0.02  # 1–3 % of jitter in published catheters
SMOOTH_SIGMA_RAD = 0.06  # of the first harmonic, of the others in proportion to 1/h: a few degrees, 10° at bends
NOTHING_RAD = 1e-6
LEAST_SHARE = 0.35  # of sectors that show the face
CERTAIN_SHARE = 0.5  # of the same, where an even turn's circle could not be fitted
NEAR_AXIS_MM = 0.04
LEAST_INFORMATION = 0.5  # at most this share of the prior's variance may be left
MOST_UNEVEN = 0.7  # of the mean speed
NEIGHBOURS = 4
LEAST_NEIGHBOURS = 3
NOT_CORRECTED = "Turns start anywhere; this was not corrected, so that slices lie at unrelated angles."


@dataclass(frozen=True, eq=False)
class _Turning:
    """What holds for every slice: the glass, the depth of the axis, and how large factors of the rotation usually are.

    ``usual`` is float64 (N_FACTORS,), standard deviations; ``seek_lost``, whether to look for lost blocks of A-scans.
    """

    glass: Glass
    axis_mm: float
    usual: Coordinates
    seek_lost: bool


@dataclass(frozen=True, eq=False)
class _Expected:
    """What a slice's neighbours lead to expect of its factors, with standard deviations, each float64 (N_FACTORS,).

    ``certain``: whether the slice's own first fit could be trusted; ``possible``: whether that of any slice could.
    """

    factors: Coordinates
    sigma: Coordinates
    certain: bool
    possible: bool


@dataclass(frozen=True, eq=False)
class _Turn:
    """One slice's turn: its circle, and the factors of its rotation, float64 (N_FACTORS,), as far as ``known``."""

    circle: Circle
    factors: Coordinates
    known: bool = False
    sigma_rad: float = float("nan")
    lost_at_rad: float = float("nan")
    lost_rad: float = 0.0


def measure_turns(
    slices: Sequence[SliceFeatures], faces: Faces, glass: Glass, parameters: OctParameters
) -> tuple[Rotation, Faces]:
    """Return the rotation within every slice's turn (starts are left at 0), and the faces with offsets to match.

    Slices in the order of z. What ``parameters`` switch off stays even.
    """
    usual = _usual_factors(parameters)
    recording = _Turning(glass, faces.typical_axis_mm, usual, parameters.correct_lost_ascans)
    starts = _starting_circles(slices, faces)
    # no more than the factors are kept: a fit's matrices are larger than its slice
    every = range(len(slices))
    first = [_fit_alone(slices[i], starts[i], recording) for i in every]
    expected = _expected(first, usual)
    turns = [_fit_about(slices[i], starts[i], expected[i], recording, bool(faces.bridged[i])) for i in every]
    factors = np.array([turn.factors for turn in turns])
    rotation = replace(
        even_rotation(len(slices)),
        stretch=factors[:, 0].copy(),
        smooth_rad=factors[:, 1:].copy(),
        lost_at_rad=np.array([turn.lost_at_rad for turn in turns]),
        lost_rad=np.array([turn.lost_rad for turn in turns]),
        shape_known=np.array([turn.known for turn in turns]),
        shape_sigma_rad=np.array([turn.sigma_rad for turn in turns]),
    )
    bridged = faces.bridged & ~rotation.shape_known
    circles = [faces.capillary.circle(i) if bridged[i] else turn.circle for i, turn in enumerate(turns)]
    return rotation, replace(faces, capillary=Capillary.of(circles, faces.capillary.radius_mm), bridged=bridged)


def with_beam_angles(features: SliceFeatures, rotation: Rotation, index: int) -> SliceFeatures:
    """Return the features of a slice with the angles of beams in place of nominal ones."""
    points = features.points
    return replace(
        features,
        points=replace(points, angle_rad=rotation.beam_rad(index, points.angle_rad)),
        ascan_angle_rad=rotation.beam_rad(index, features.ascan_angle_rad),
    )


def _usual_factors(parameters: OctParameters) -> Coordinates:
    """How large factors usually are, their standard deviations, float64 (N_FACTORS,)."""
    corrected = np.array([parameters.correct_turn_length, *[parameters.correct_rotation] * N_SMOOTH])
    order = np.repeat(np.arange(1, HARMONICS + 1), 2)
    return np.where(corrected, np.concatenate([[STRETCH_SIGMA], SMOOTH_SIGMA_RAD / order]), NOTHING_RAD)


def _starting_circles(slices: Sequence[SliceFeatures], faces: Faces) -> list[Circle]:
    """The circle of every slice; where it is bridged, perhaps since an even turn's does not fit, a line nearby."""
    circles = [faces.capillary.circle(i) for i in range(len(slices))]
    for i in map(int, np.flatnonzero(faces.bridged)):
        circles[i] = slices[i].lines.strongest_near(faces.typical_axis_mm, NEAR_AXIS_MM) or circles[i]
    return circles


def _fit_alone(features: SliceFeatures, start: Circle, recording: _Turning) -> Coordinates | None:
    """The factors of a slice by itself; None where they cannot be trusted."""
    even = np.zeros(N_FACTORS)
    prior = Prior.of(recording.axis_mm, even, recording.usual)
    fit = fit_turn(features.points, unknowns(start, even), prior, recording.glass)
    if fit is None or not _plausible(fit, features, recording.usual, LEAST_SHARE):
        return None
    possible = mean_variance(np.diag(recording.usual**2))
    return fit.factors if fit.variance < LEAST_INFORMATION * possible else None


def _fit_about(
    features: SliceFeatures, start: Circle, expected: _Expected, recording: _Turning, bridged: bool
) -> _Turn:
    """The turn of a slice about what is ``expected`` of it."""
    begin, points = unknowns(start, expected.factors), features.points
    if expected.possible:
        widths = WIDE_MM if expected.certain else WIDEST_MM + WIDE_MM
        prior = Prior.of(recording.axis_mm, expected.factors, expected.sigma)
        wide = fit_turn(points, begin, prior, recording.glass, widths)
        if wide is not None:
            fit = finish_fit(points, wide, recording.glass, recording.seek_lost)
            if _plausible(fit, features, recording.usual, CERTAIN_SHARE if bridged else LEAST_SHARE):
                sigma_rad, circle = float(np.sqrt(fit.variance)), fit.circle(start.radius_mm)
                return _Turn(circle, fit.factors, True, sigma_rad, fit.lost_at_rad, fit.lost_rad)
    if bridged:
        return _Turn(start, np.zeros(N_FACTORS))
    # as its neighbours turned, which is evenly where theirs is not known either
    fixed = Prior.of(recording.axis_mm, expected.factors, np.full(N_FACTORS, NOTHING_RAD))
    about = fit_turn(points, begin, fixed, recording.glass)
    if about is None:
        return _Turn(start, np.zeros(N_FACTORS))
    return _Turn(about.circle(start.radius_mm), np.append(0.0, expected.factors[1:]))


def _expected(first: Sequence[Coordinates | None], usual: Coordinates) -> list[_Expected]:
    """What to expect of every slice from the ``first`` fits of its neighbours.

    Lengths differ from turn to turn; only the smooth error resembles that of neighbours.
    """
    n = len(first)
    factors = np.array([np.full(N_FACTORS, np.nan) if one is None else one for one in first])
    certain = np.isfinite(factors[:, 0])
    about = np.zeros_like(factors)
    for i in range(n):
        near = np.r_[max(0, i - NEIGHBOURS) : i, i + 1 : min(n, i + NEIGHBOURS + 1)]
        near = near[certain[near]]
        if near.size >= LEAST_NEIGHBOURS:
            about[i] = np.median(factors[near], axis=0)
    about[:, 0] = 0
    spread = robust_sigmas((factors - about)[certain]) if certain.any() else usual
    # at least a sixth of what is usual: a few slices may differ
    spread = np.clip(spread, usual / 6, usual)
    spread[0] = usual[0]
    return [_Expected(about[i], spread, bool(certain[i]), bool(certain.any())) for i in range(n)]


def _plausible(fit: TurnFit, features: SliceFeatures, usual: Coordinates, share: float) -> bool:
    """Whether at least a ``share`` of sectors showed the face, and the fit is a possible rotation."""
    if np.unique(features.points.angle_rad[fit.weight > 0]).size < share * features.n_columns:
        return False
    rate = np.diff(_basis_around() @ fit.factors) / (2 * np.pi / 179)
    return bool(np.abs(rate).max() < MOST_UNEVEN and np.all(np.abs(fit.factors) < 5 * usual))


@cache
def _basis_around() -> Coordinates:
    """The basis at places around a turn, both ends included; made when first needed, as it is by compiled code."""
    return smooth_basis(np.linspace(0, 2 * np.pi, 180))


@dataclass(frozen=True, eq=False)
class Turns:
    """The slices and their faces at the angles that ``rotation`` gives, with notes on it. All in the order of z."""

    slices: Sequence[SliceFeatures]
    faces: Faces
    rotation: Rotation
    notes: tuple[str, ...] = ()


def correct_uneven_turns(
    turns: Turns, glass: Glass, fixed_rows: Mask, acquisition: OctAcquisition, parameters: OctParameters
) -> Turns:
    """Return nominal ``turns`` with what ``parameters`` ask to correct within turns; faces are fitted again.

    Points in ``fixed_rows``, bool (n_depth,), do not count. Where the face crosses a fixed line of the detector, the
    line's points look like those of a face seen in a very uneven turn.
    """
    if not (parameters.correct_rotation or parameters.correct_turn_length or parameters.correct_lost_ascans):
        return turns
    nominal = turns.slices

    def without_fixed_rows(i: int) -> SliceFeatures:
        features = nominal[i]
        return replace(features, points=features.points.outside_rows(fixed_rows, acquisition.mm_per_px))

    rotation, faces = measure_turns(Computed(len(nominal), without_fixed_rows), turns.faces, glass, parameters)
    slices = Computed(len(nominal), lambda i: with_beam_angles(nominal[i], rotation, i))
    notes = turns.notes
    if count := int(np.count_nonzero(np.isfinite(rotation.lost_at_rad))):
        notes += (f"{count} of {len(slices)} slices lack a block of A-scans; what lay there is not valid.",)
    return Turns(slices, refit_faces(slices, faces, parameters), rotation, notes)


def correct_starts(turns: Turns, glass: Glass, acquisition: OctAcquisition, parameters: OctParameters) -> Turns:
    """Return ``turns`` with the angles at which they start, where ``parameters`` ask for that."""
    if parameters.correct_start_angle:
        rotation, note = measure_starts(turns.slices, turns.faces, glass, turns.rotation, acquisition, parameters)
        return replace(turns, rotation=rotation, notes=(*turns.notes, note) if note else turns.notes)
    if starts_anywhere(turns.faces.observed, parameters.start):
        return replace(turns, notes=(*turns.notes, NOT_CORRECTED))
    return turns
