"""Which line is the capillary's outer face, and where it lies in every slice.

The depth axis has no known zero, so the outer face is the ruler for the wall's radius. Of the lines found in the
slices it is the deepest one that stands at one depth of its axis through the recording, has darkness behind it
and a wall behind that. Sheath lines and the inner face lie before it; the wall is not dark behind; a line of the
detector does not move at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.face.lines import Points, fit_circle
from endoct.modalities.oct.face.sine import RIPPLE_HARMONICS, Sine, circle_distance_mm, ransac_sine, ripple_basis
from endoct.modalities.oct.face.slices import SliceEvidence, behind
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.errors import NotSeen

SAME_LINE_MM = 0.02
FIXED_LINE_MM = 0.01
LEAST_PRESENCE = 0.4
DARK_SHARE = 0.5  # behind the face it is nearer to the darkness than to the wall
STRAY_MM = 0.08
CERTAIN_FRACTION = 0.5
TELLING_MM = 0.006  # nearer to the axis, an offset has no direction
FREE_RAD = 0.8  # typical change of the offset's direction from slice to slice, above which turns start anywhere


@dataclass(frozen=True, eq=False)
class Faces:
    """The outer face in every slice: offset of the catheter and depth of its axis, mm, and how well they fit.

    All float64 (n_slices,); ``bridged`` bool; ``sines``, the paper's fit of each slice; ``ripple_mm``, float64
    (n_slices, 2·RIPPLE_HARMONICS − 2), see :func:`ripple_basis`.
    """

    x_mm: Coordinates
    y_mm: Coordinates
    axis_depth_mm: Coordinates
    inlier_fraction: Coordinates
    residual_mm: Coordinates
    bridged: Mask
    sines: tuple[Sine, ...]
    ripple_mm: Coordinates

    def reordered(self, order: NDArray[np.intp]) -> "Faces":
        """Return the same faces with slice ``order[i]`` in place i."""
        return Faces(
            self.x_mm[order],
            self.y_mm[order],
            self.axis_depth_mm[order],
            self.inlier_fraction[order],
            self.residual_mm[order],
            self.bridged[order],
            tuple(self.sines[i] for i in order),
            self.ripple_mm[order],
        )


def locate_faces(
    slices: Sequence[SliceEvidence], radius_mm: float, gap_mm: float, mm_per_px: float, parameters: OctParameters
) -> Faces:
    """Find the outer face (``radius_mm``) in all slices, given in the order of z; ``gap_mm`` to the nominal wall.

    Raises :class:`NotSeen` where no line qualifies or most slices do not show it.
    """
    moving = [s.lines[np.hypot(s.lines[:, 0], s.lines[:, 1]) > FIXED_LINE_MM] for s in slices]
    for lines in (moving, [s.lines for s in slices]):  # a line of the detector does not move; nor may a centred face
        axis_depth = _axis_depth(slices, lines, radius_mm, gap_mm, mm_per_px, parameters)
        if axis_depth is not None:
            break
    else:
        raise _no_capillary("no line with darkness and then a wall behind it")
    circles = np.full((len(slices), 3), np.nan)
    for i, of_slice in enumerate(lines):
        near = of_slice[np.abs(of_slice[:, 2] - axis_depth) < SAME_LINE_MM]
        if near.size:
            circles[i] = near[int(np.argmax(near[:, 3])), :3]
    free = starts_anywhere(circles[:, 0], circles[:, 1], np.isfinite(circles[:, 0]), parameters)
    circles = _without_outliers(circles, free)
    starts = _bridge(circles)
    axis_depth = float(np.nanmedian(circles[:, 2]))
    fitted, fraction, residual = np.empty_like(starts), np.zeros(len(slices)), np.full(len(slices), np.nan)
    for i, evidence in enumerate(slices):
        fitted[i], fraction[i], residual[i] = _refine(evidence, starts[i], axis_depth, radius_mm, parameters)
    good = (fraction >= parameters.least_inlier_fraction) & (np.abs(fitted[:, 2] - axis_depth) < SAME_LINE_MM)
    steady = np.isfinite(_without_outliers(np.where(good[:, None], fitted, np.nan), free)[:, 0])
    good &= steady | (fraction > CERTAIN_FRACTION)
    if 2 * np.count_nonzero(good) < len(slices):
        raise _no_capillary(f"it in {np.count_nonzero(good)} of {len(slices)} slices")
    fitted = _bridge(np.where(good[:, None], fitted, np.nan))
    sines = _sines(slices, fitted, good, radius_mm, parameters)
    ripple = _ripples(slices, fitted, good, radius_mm, parameters)
    return Faces(fitted[:, 0], fitted[:, 1], fitted[:, 2], fraction, residual, ~good, sines, ripple)


def refit_faces(slices: Sequence[SliceEvidence], faces: Faces, radius_mm: float, parameters: OctParameters) -> Faces:
    """Return ``faces`` fitted again, from where they are, to ``slices`` with beam angles for nominal ones.

    The sines stay those of nominal angles; a bridged slice stays as it is.
    """
    good = ~faces.bridged
    fitted = np.stack([faces.x_mm, faces.y_mm, faces.axis_depth_mm], axis=1)
    axis_depth = float(np.median(faces.axis_depth_mm[good]))
    fraction, residual = faces.inlier_fraction.copy(), faces.residual_mm.copy()
    for i in map(int, np.flatnonzero(good)):
        fitted[i], fraction[i], residual[i] = _refine(slices[i], fitted[i], axis_depth, radius_mm, parameters)
    ripple = _ripples(slices, fitted, good, radius_mm, parameters)
    return Faces(fitted[:, 0], fitted[:, 1], fitted[:, 2], fraction, residual, ~good, faces.sines, ripple)


def _axis_depth(
    slices: Sequence[SliceEvidence],
    lines_of: Sequence[Coordinates],
    radius_mm: float,
    gap_mm: float,
    mm_per_px: float,
    parameters: OctParameters,
) -> float | None:
    """The depth of the axis, where ρ = 0, that the outer face has through the recording, mm; None if no line fits."""
    index = np.concatenate([np.full(len(lines), i) for i, lines in enumerate(lines_of)])
    lines = np.concatenate(lines_of)
    if not lines.size:
        return None
    if parameters.start_offset_mm is not None:
        near = np.abs(lines[:, 2] + radius_mm - parameters.start_offset_mm) < 3 * SAME_LINE_MM
        return float(np.median(lines[near, 2])) if near.any() else None
    tracks = []
    for depth in line_depths_mm(lines, mm_per_px):
        on = np.abs(lines[:, 2] - depth) < SAME_LINE_MM
        presence = np.unique(index[on]).size / len(slices)
        if presence >= LEAST_PRESENCE and _dark_behind(slices, index[on], lines[on], radius_mm, gap_mm, mm_per_px):
            tracks.append(float(np.median(lines[on, 2])))
    return max(tracks) if tracks else None


def line_depths_mm(lines: Coordinates, mm_per_px: float) -> Coordinates:
    """Return depths, mm, at which many ``lines`` (n, 4) of a recording have their axis."""
    low = lines[:, 2].min() - 4 * SAME_LINE_MM
    depth = np.arange(low, lines[:, 2].max() + 4 * SAME_LINE_MM, mm_per_px / 2)
    density = np.zeros(depth.size)
    for line in lines:
        density += line[3] * np.exp(-0.5 * ((depth - line[2]) / (SAME_LINE_MM / 3)) ** 2)
    inner = density[1:-1]
    return np.asarray(depth[1:-1][(inner >= density[:-2]) & (inner > density[2:]) & (inner > 0.02 * density.max())])


def _dark_behind(
    slices: Sequence[SliceEvidence],
    index: NDArray[np.intp],
    lines: Coordinates,
    radius_mm: float,
    gap_mm: float,
    mm_per_px: float,
) -> bool:
    """Whether darkness follows the line, and then something bright, in the recording's median profile."""
    n_px = round(2.5 * gap_mm / mm_per_px)
    profiles = [
        np.nanmedian(_filled(behind(slices[i], line, radius_mm, mm_per_px, n_px)), axis=0)
        for i, line in zip(index, lines, strict=True)
    ]
    profile = np.nanmedian(_filled(np.asarray(profiles, dtype=np.float32)), axis=0)
    first, last = round(0.04 / mm_per_px), max(round(0.3 * gap_mm / mm_per_px), round(0.08 / mm_per_px))
    if profile.size <= last + 2 or not np.isfinite(profile[first:last]).all():
        return False
    darkest, dark = float(np.nanmin(profile)), float(np.median(profile[first:last]))
    wall = float(np.nanmax(profile[last:]))
    line = float(np.nanmax(profile[: max(2, round(0.015 / mm_per_px))]))
    return dark < darkest + 0.5 * (line - darkest) and dark < darkest + DARK_SHARE * (wall - darkest)


def _filled(samples: Image) -> Image:
    """Columns without any sample get 0 in place of NaN, which a median could not take."""
    return np.where(np.isfinite(samples).any(axis=0), samples, np.float32(0))


def _refine(
    evidence: SliceEvidence, start: Coordinates, axis_depth: float, radius_mm: float, parameters: OctParameters
) -> tuple[tuple[float, float, float], float, float]:
    points, everything = evidence.points, np.ones(evidence.points.strength.size, bool)
    circle = tuple(start)
    for width in (3.0, 1.5):
        circle = fit_circle(
            points, everything, np.asarray(circle), radius_mm,
            width_mm=width * parameters.face_tolerance_mm, zero_mm=axis_depth, zero_sigma_points=5.0,
        )  # fmt: skip
    residual = points.depth_mm - circle[2] - circle_distance_mm(points.angle_rad, circle[0], circle[1], radius_mm)
    on = np.abs(residual) < parameters.face_tolerance_mm
    columns = np.unique(points.angle_rad[on]).size
    rms = float(np.sqrt(np.mean(residual[on] ** 2))) if on.any() else float("nan")
    return (circle[0], circle[1], circle[2]), columns / evidence.n_columns, rms


def _given(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def _sines(
    slices: Sequence[SliceEvidence], circles: Coordinates, good: Mask, radius_mm: float, parameters: OctParameters
) -> tuple[Sine, ...]:
    """The paper's sine through the points near the circle; a bridged slice gets the circle's first order."""
    sines = []
    for i, (evidence, (x, y, depth)) in enumerate(zip(slices, circles, strict=True)):
        eccentricity = float(np.hypot(x, y))
        first_order = Sine(
            amplitude_mm=_given(parameters.start_amplitude_mm, eccentricity),
            omega=1.0,
            phase_rad=float(np.mod(_given(parameters.start_phase_rad, -np.arctan2(y, x) - np.pi / 2), 2 * np.pi)),
            offset_mm=float(depth + radius_mm - eccentricity**2 / (4 * radius_mm)),
        )
        points = evidence.points
        residual = points.depth_mm - depth - circle_distance_mm(points.angle_rad, x, y, radius_mm)
        near = np.abs(residual) < 2 * parameters.face_tolerance_mm
        if good[i] and np.count_nonzero(near) >= 4:
            first_order, _ = ransac_sine(
                points.angle_rad[near],
                points.depth_mm[near],
                tolerance_mm=parameters.face_tolerance_mm + eccentricity**2 / (4 * radius_mm),
                trials=parameters.ransac_trials,
                rng=np.random.default_rng((parameters.seed, i)),
                start=first_order,
            )
        sines.append(first_order)
    return tuple(sines)


def _ripples(
    slices: Sequence[SliceEvidence], circles: Coordinates, good: Mask, radius_mm: float, parameters: OctParameters
) -> Coordinates:
    return np.array(
        [
            _ripple(evidence.points, circle, radius_mm, parameters) if found else np.zeros(2 * RIPPLE_HARMONICS - 2)
            for evidence, circle, found in zip(slices, circles, good, strict=True)
        ]
    )


def _ripple(points: Points, circle: Coordinates, radius_mm: float, parameters: OctParameters) -> Coordinates:
    """Harmonics of where the face departs from the circle, by uneven rotation and oblique glass; a few µm."""
    residual = points.depth_mm - circle[2] - circle_distance_mm(points.angle_rad, circle[0], circle[1], radius_mm)
    weight = np.maximum(1 - (residual / (2 * parameters.face_tolerance_mm)) ** 2, 0) ** 2 * points.strength
    basis = ripple_basis(points.angle_rad)
    # as if a fifth of the circle's points lay on the circle, so that a face seen in part does not swing where unseen
    normal = basis.T @ (weight[:, None] * basis) + 0.05 * max(float(weight.sum()), 1.0) * np.eye(basis.shape[1])
    return np.asarray(np.linalg.solve(normal, basis.T @ (weight * residual)))


def _without_outliers(circles: Coordinates, free: bool) -> Coordinates:
    """Replace circles that stray from both neighbours and from the median of six by NaN.

    Where turns start anywhere (``free``), only how far off the axis they are can be compared.
    """
    kept = circles.copy()
    if free:
        circles = np.stack([np.hypot(circles[:, 0], circles[:, 1]), np.zeros(len(circles)), circles[:, 2]], axis=1)
    for i in range(len(circles)):
        before, after = circles[max(0, i - 3) : i], circles[i + 1 : i + 4]
        before, after = before[np.isfinite(before[:, 0])], after[np.isfinite(after[:, 0])]
        around = np.concatenate([before, after])
        if len(around) >= 2:
            typical = np.concatenate([before[-1:], after[:1], np.median(around, axis=0)[None]])
            if np.min(np.hypot(*(typical - circles[i])[:, :2].T)) > STRAY_MM:
                kept[i] = np.nan
    return kept


def _bridge(circles: Coordinates) -> Coordinates:
    """Fill NaN rows by linear interpolation between their neighbours. Raises where there is nothing to go by."""
    good = np.flatnonzero(np.isfinite(circles[:, 0]))
    if not good.size:
        raise _no_capillary("it in no slice")
    every = np.arange(len(circles))
    return np.stack([np.interp(every, good, circles[good, k]) for k in range(3)], axis=1)


def _no_capillary(found: str) -> NotSeen:
    return NotSeen(
        "the capillary's outer face cannot be found",
        found=found,
        expected="a bright line around the whole turn in most slices, darkness and then the wall behind it",
        remedy="check capillary_outer_diameter_mm, bore_diameter_mm and axial_pixel_mm, look at the B-scans, "
        "or give the depth of the outer face as start_offset_mm",
    )


def starts_anywhere(x_mm: Coordinates, y_mm: Coordinates, known: Mask, parameters: OctParameters) -> bool:
    """Return whether turns start anywhere: then the offset (x, y) of the catheter points another way in every slice."""
    if parameters.start != "auto":
        return parameters.start == "free"
    offset = (x_mm + 1j * y_mm)[known]
    offset = offset[np.abs(offset) > TELLING_MM]
    if offset.size < 4:
        return False
    return bool(np.median(np.abs(np.angle(offset[1:] * np.conj(offset[:-1])))) > FREE_RAD)
