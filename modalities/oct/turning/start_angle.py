"""Where every turn starts, from what does not turn with the optics.

The sheath is a landmark (:mod:`endoct.modalities.oct.turning.sheath_pattern`). It may creep from slice to slice.
Nothing in the recording can distinguish that from starts that creep: that share of the twist stays unknown and is
stated. Starts and the landmark's own directions are solved for together by least squares. The landmark is seen at its
direction less the start. Starts lie about 0; the direction changes little from slice to slice and is 0 on average.
Outliers of either count less and less.

Where turns start anywhere and no sheath is seen, neighbouring slices are compared. The direction of the capillary's
offset from the catheter drifts by degrees a slice, and cells span two slices.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import mean_angle_rad, wrap_rad
from endoct.base.numeric.least_squares import vertex
from endoct.base.numeric.ranks import robust_sigma
from endoct.modalities.oct.bscan import mean_between
from endoct.modalities.oct.face.face_circle import Circle, circle_distance_mm
from endoct.modalities.oct.face.faces import Faces, starts_anywhere
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import Rotation
from endoct.modalities.oct.turning.sheath_pattern import Mark, sheath_mark

ROBUST_STEPS = 5
MEAN_WEIGHT = 1e3  # of the landmark's mean direction, which is defined as 0
CREEP_RAD = 0.0017  # of a mark from slice to slice: 0.1°
LEAST_START_RAD = 0.002
BY_SHEATH = "Turns start anywhere; where each does was measured from the sheath's lines."
BY_NEIGHBOURS = (
    "Turns start anywhere and no sheath line shows where; cells that span two slices and the capillary's direction "
    "were followed from slice to slice, so that the twist along the bore is uncertain."
)
CONTRADICTED = (
    "According to the sheath's lines turns start so that the capillary jumps from slice to slice; they were not used."
)
DRIFT_RAD = 0.09  # of the capillary's direction from slice to slice: 5°
PROFILE_MM = (0.02, 0.10)  # behind the nominal wall: dark in cells
N_PROFILE = 192
NEAR_RAD = 0.7
LEAST_LIKENESS = 0.6
CELLS_RAD = 0.035  # how far the shapes of cells shift one slice against the next: 2°


def separated(
    moved_rad: Coordinates, sigma_rad: Coordinates, usual_rad: float, creep_rad: float
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations, float64 (n,).

    ``moved_rad``: where the landmark is seen, with the standard deviation ``sigma_rad``, infinite where it is not seen.
    Starts scatter by ``usual_rad``, the landmark creeps by ``creep_rad`` a slice. Starts are eliminated, so that only
    neighbouring directions and their mean are coupled: memory and time grow linearly with the number of slices.
    """
    n = moved_rad.size
    of_starts, of_sights = np.full(n, usual_rad**-2.0), sigma_rad**-2.0
    to_next, mean = creep_rad**-2.0, np.full(n, MEAN_WEIGHT / n)
    neighbours = np.minimum(np.arange(n), 1) + np.minimum(np.arange(n)[::-1], 1)
    start_weight, sight_weight = np.ones(n), np.ones(n)
    for _ in range(ROBUST_STEPS):  # a turn that was measured wrongly is an outlier to its neighbours too
        known, seen = of_starts * start_weight**2, of_sights * sight_weight**2
        held = known * seen / (known + seen)
        bands = np.full((2, n), -to_next)
        bands[1] = held + to_next * neighbours
        free, by_mean = solveh_banded(bands, np.stack([held * moved_rad, mean], axis=1)).T
        direction = free - by_mean * (mean @ free) / (1 + mean @ by_mean)
        start = seen / (known + seen) * (direction - moved_rad)
        variance = _variances(held, to_next) - by_mean**2 / (1 + mean @ by_mean)
        spread = np.sqrt(1 / (known + seen) + (seen / (known + seen)) ** 2 * variance)
        start_weight = 1 / np.sqrt(1 + (start / usual_rad / 2) ** 2)
        sight_weight = 1 / np.sqrt(1 + ((direction - start - moved_rad) / sigma_rad / 2) ** 2)
    return start, spread


def _variances(held: Coordinates, to_next: float) -> Coordinates:
    """Return the diagonal of the inverse, (n,): every node is tied to the ground, and to its neighbours on both sides.

    As conductances in series and in parallel: only positive terms are added, so that nothing cancels.
    """

    def from_before(each: Coordinates) -> Coordinates:
        through, last = np.zeros(each.size), 0.0
        for i, own in enumerate(each[:-1]):
            last = float(own) + last
            last = through[i + 1] = to_next * last / (to_next + last)
        return through

    return np.asarray(1 / (held + from_before(held) + from_before(held[::-1])[::-1]))


def measure_starts(
    slices: Sequence[SliceFeatures],
    faces: Faces,
    glass: Glass,
    rotation: Rotation,
    acquisition: OctAcquisition,
    parameters: OctParameters,
) -> tuple[Rotation, str]:
    """Return ``rotation`` with starts, and a note on how they were measured, or "".

    ``slices`` in the order of z, their angles those of beams. Starts are relative to their mean where turns are
    triggered, to the first slice where they start anywhere.
    """
    mark = sheath_mark(slices, faces, glass, acquisition.mm_per_px)
    if mark is not None:  # it is seen at the angles that the turn's shape gives
        mark = replace(mark, sigma_rad=np.hypot(mark.sigma_rad, np.nan_to_num(rotation.shape_sigma_rad)))
    if starts_anywhere(faces.observed, parameters.start):
        if mark is not None:
            start, sigma = _from_mark(mark, faces)
            return _from_first(rotation, start, sigma), BY_SHEATH
        start, sigma = starts_from_neighbours(slices, faces, acquisition)
        return _from_first(rotation, start, sigma), BY_NEIGHBOURS
    if mark is None:
        return rotation, ""
    triggered = _triggered(rotation, mark)
    if _contradicted(triggered.start_rad, faces):
        return rotation, CONTRADICTED
    return triggered, ""


def _contradicted(start_rad: Coordinates, faces: Faces) -> bool:
    """Whether the capillary's direction jumps from slice to slice with these starts, but not without them."""
    seen = ~faces.bridged
    recorded = faces.capillary.direction_rad[seen]
    if recorded.size < 2:
        return False
    without, jumps = (
        float(np.mean(np.abs(wrap_rad(np.diff(direction))))) for direction in (recorded, recorded + start_rad[seen])
    )
    return jumps > max(DRIFT_RAD, 2 * without)


def _triggered(rotation: Rotation, mark: Mark) -> Rotation:
    """Turns start near one angle, so that long ones lie later in the mean; slow changes are rather the mark's."""
    seen = np.isfinite(mark.direction_rad)
    later = np.pi * rotation.stretch
    direction = mark.direction_rad + later
    moved = np.where(seen, wrap_rad(direction - mean_angle_rad(direction[seen])), 0.0)
    steps = np.diff(moved[seen])
    if not steps.size:
        return rotation
    # what the steps scatter by more than the mark is sure of
    scatter = robust_sigma(steps) ** 2 / 2 - np.median(mark.sigma_rad[seen]) ** 2
    usual = max(LEAST_START_RAD, float(np.sqrt(max(scatter, 0.0))))
    early, spread = separated(moved, np.where(seen, mark.sigma_rad, np.inf), usual, CREEP_RAD)
    start = early + later
    return replace(
        rotation,
        start_rad=np.where(seen, start - start[seen].mean(), 0.0),
        start_known=seen,
        start_sigma_rad=np.where(seen, spread, np.nan),
    )


def _from_mark(mark: Mark, faces: Faces) -> tuple[Coordinates, Coordinates]:
    """Starts and their standard deviations from the mark; NaN where neither it nor the capillary is seen.

    Slices that do not show the mark go by the capillary's direction, between slices that show both.
    """
    n = len(faces.capillary)
    capillary = faces.observed.direction_rad
    seen = np.isfinite(mark.direction_rad)
    start = np.where(seen, -mark.direction_rad, np.nan)
    away = np.abs(np.arange(n) - int(np.flatnonzero(seen)[0]))
    sigma = np.where(seen, np.hypot(mark.sigma_rad, CREEP_RAD * np.sqrt(away)), np.nan)
    both = seen & np.isfinite(capillary)
    left = ~seen & np.isfinite(capillary)
    if both.any() and left.any():
        at, common = np.flatnonzero(both), np.unwrap((capillary + start)[both])
        start = np.where(left, np.interp(np.arange(n), at, common) - capillary, start)
        either_side = np.searchsorted(at, np.arange(n)) - np.array([[1], [0]])
        distance = np.abs(np.arange(n) - at[np.clip(either_side, 0, at.size - 1)]).min(axis=0)
        sigma = np.where(left, DRIFT_RAD * np.sqrt(distance), sigma)
    return start, sigma


def _from_first(rotation: Rotation, start: Coordinates, sigma: Coordinates) -> Rotation:
    """``rotation`` with starts relative to the first known one; NaN where not known."""
    known = np.isfinite(start)
    start = np.where(known, start, 0.0)
    if known.any():
        start = start - start[int(np.flatnonzero(known)[0])]
    return replace(
        rotation,
        start_rad=np.where(known, np.mod(start, 2 * np.pi), 0.0),
        start_known=known,
        start_sigma_rad=np.where(known, sigma, np.nan),
    )


def starts_from_neighbours(
    slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations relative to the first slice, float64 (n_slices,), rad.

    Each is measured from the slice before; NaN where the outer face is not seen.
    """
    capillary_rad = faces.observed.direction_rad
    profiles = _profiles(slices, faces, acquisition)
    n = len(slices)
    start, variance = np.full(n, np.nan), np.full(n, np.nan)
    last = -1
    for i in map(int, np.flatnonzero(np.isfinite(capillary_rad))):
        if last < 0:
            start[i], variance[i] = 0.0, 0.0
        else:
            by_capillary = float(wrap_rad(np.asarray(capillary_rad[last] - capillary_rad[i])))
            sigma = DRIFT_RAD * np.sqrt(i - last)
            by_cells, likeness = _turned_by(profiles[last], profiles[i], by_capillary)
            step, spread = by_capillary, sigma
            if likeness > LEAST_LIKENESS:
                share = sigma**2 / (sigma**2 + CELLS_RAD**2)
                step = by_capillary + share * by_cells
                spread = np.sqrt(share) * CELLS_RAD
            start[i], variance[i] = start[last] + step, variance[last] + spread**2
        last = i
    return start, np.sqrt(variance)


def _turned_by(a: Coordinates, b: Coordinates, about_rad: float) -> tuple[float, float]:
    """By how much more than ``about_rad`` the start of b lies behind that of a, and how alike the two are then."""
    spectrum = np.fft.rfft(a) * np.conj(np.fft.rfft(b))
    shift = np.fft.rfftfreq(a.size, 1 / a.size) * about_rad
    alike = np.fft.irfft(spectrum * np.exp(1j * shift), n=a.size) / max(
        float(np.sqrt(np.sum(a**2) * np.sum(b**2))), 1e-9
    )
    reach = round(NEAR_RAD / (2 * np.pi) * a.size)
    near = np.roll(alike, reach)[: 2 * reach + 1]
    k = int(np.argmax(near))
    if k in (0, 2 * reach):
        return 0.0, 0.0
    sub = float(vertex(*near[k - 1 : k + 2]))
    return (k + sub - reach) * 2 * np.pi / a.size, float(near[k])


def _profiles(slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition) -> Coordinates:
    """How bright each slice is just behind the nominal wall, over θ in its own frame, float64 (n, N_PROFILE)."""
    profiles = np.array([_profile(each, faces.capillary.circle(i), acquisition) for i, each in enumerate(slices)])
    dark, bright = np.percentile(profiles, 5), np.median(profiles)
    profiles = np.clip((profiles - dark) / max(bright - dark, 1e-9), 0, 1)
    return np.asarray(profiles - profiles.mean(axis=1, keepdims=True))


def _profile(features: SliceFeatures, face: Circle, acquisition: OctAcquisition) -> Coordinates:
    """The mean of the samples just behind the nominal wall, over θ in the slice's own frame, float64 (N_PROFILE,)."""
    beam_rad, ascans = features.ascan_angle_rad, features.ascans
    along = circle_distance_mm(beam_rad, face.x_mm, face.y_mm, acquisition.bore_radius_mm)
    at_mm = face.axis_depth_mm + along
    first, last = (np.round((at_mm + beyond) / acquisition.mm_per_px).astype(np.intp) for beyond in PROFILE_MM)
    level = mean_between(ascans, first, last)
    at_rad = np.mod(np.arctan2(face.y_mm + along * np.sin(beam_rad), face.x_mm + along * np.cos(beam_rad)), 2 * np.pi)
    order = np.argsort(at_rad)
    theta = 2 * np.pi * np.arange(N_PROFILE) / N_PROFILE
    return np.asarray(np.interp(theta, at_rad[order], level[order], period=2 * np.pi))
