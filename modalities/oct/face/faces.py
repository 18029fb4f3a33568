"""Where the capillary's outer face lies in every slice, by that slice and its neighbours.

The depth axis has no known zero, so the outer face is the ruler for the wall's radius. It is the deepest of the bright
lines whose axis keeps its depth through the recording and that have darkness, then a wall behind them. Lines of the
sheath and the inner face lie before it. Behind the wall's own surface it is not dark. A line that the detector draws
does not move at all. A bright plate of bone with marrow behind it looks the same, but has nothing before it.

A slice that strays from its neighbours is not used, and gaps between known slices are bridged. The face departs from
a circle by a few micrometres, as rotation is uneven and glass oblique. These ripples are harmonics of the beam's angle
from order 2 on: the axis's offset and depth take up the orders 0 and 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import NotSeen
from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import medians
from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.lines import Lines, fit_circle
from endoct.modalities.oct.face.points import Points, tukey_weight
from endoct.modalities.oct.face.slices import SliceFeatures, samples_behind
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters

SAME_LINE_MM = 0.02
FIXED_LINE_MM = 0.01
LEAST_PRESENCE = 0.4
BEFORE_MM = 0.03
"""Nearer to the face than that, a line may be a part of it."""
DARK_SHARE = 0.5
"""Behind the face it is nearer to the darkness than to the wall."""
STRAY_MM = 0.08
REACH = 3
"""A slice is compared with so many on either side."""
LEAST_OFFSET_MM = 0.006
"""Nearer to the axis, an offset has no direction."""
FREE_RAD = 0.8
"""Turns start anywhere if the offset's direction typically changes by more than this from slice to slice."""
CERTAIN_FRACTION = 0.5
"""A face seen in this part of the columns need not be near its neighbours'."""
WIDTHS = (3.0, 1.5)
"""Half widths of Tukey's weights, in tolerances, in one round of the fit after the other."""
AXIS_WEIGHT = 5.0
"""The recording's axis depth counts as much as so many points in a slice's fit."""
RIPPLE_HARMONICS = 6
N_RIPPLE = 2 * (RIPPLE_HARMONICS - 1)
DAMPING = 0.05  # of the points' weight: a face seen in part does not swing where it is not seen


def outer_line(
    slices: Sequence[SliceFeatures], acquisition: OctAcquisition, start_offset_mm: float | None
) -> Capillary | None:
    """Return the outer face in every slice that shows it as a line, NaN elsewhere; None where no line qualifies.

    ``start_offset_mm``, where given, is the depth of the face with the catheter on the axis.
    """
    every = [features.lines for features in slices]
    moving = [lines.where(lines.offset_mm > FIXED_LINE_MM) for lines in every]
    for lines in (moving, every):  # the detector's lines do not move, but nor may the face of a centred catheter
        axis_depth_mm = _axis_depth_mm(slices, lines, acquisition, start_offset_mm)
        if axis_depth_mm is not None:
            circles = [of_slice.strongest_near(axis_depth_mm, SAME_LINE_MM) for of_slice in lines]
            return Capillary.of(circles, acquisition.capillary_radius_mm)
    return None


def shows_catheter(slices: Sequence[SliceFeatures], face: Capillary) -> bool:
    """Return whether lines lie before the ``face``, as the glass's inner face and the catheter's sheath do."""
    before = [
        bool(np.any(features.lines.axis_depth_mm < axis_depth_mm - BEFORE_MM))
        for features, axis_depth_mm in zip(slices, face.axis_depth_mm, strict=True)
    ]
    return float(np.mean(before)) >= LEAST_PRESENCE


def line_depths_mm(lines: Lines, mm_per_px: float) -> Coordinates:
    """Return the depths, mm, at which many ``lines`` of a recording have their axis."""
    low = lines.axis_depth_mm.min() - 4 * SAME_LINE_MM
    depth = np.arange(low, lines.axis_depth_mm.max() + 4 * SAME_LINE_MM, mm_per_px / 2)
    density = np.zeros(depth.size)
    for axis_depth_mm, support in zip(lines.axis_depth_mm, lines.support, strict=True):
        density += support * np.exp(-0.5 * ((depth - axis_depth_mm) / (SAME_LINE_MM / 3)) ** 2)
    inner = density[1:-1]
    return np.asarray(depth[1:-1][(inner >= density[:-2]) & (inner > density[2:]) & (inner > 0.02 * density.max())])


def _axis_depth_mm(
    slices: Sequence[SliceFeatures],
    lines_of: Sequence[Lines],
    acquisition: OctAcquisition,
    start_offset_mm: float | None,
) -> float | None:
    """The depth of the axis that the outer face has through the recording; None if no line fits."""
    index = np.repeat(np.arange(len(lines_of)), [len(lines) for lines in lines_of])
    lines = Lines.together(lines_of)
    if not len(lines):
        return None
    if start_offset_mm is not None:
        near = np.abs(lines.axis_depth_mm + lines.radius_mm - start_offset_mm) < 3 * SAME_LINE_MM
        return float(np.median(lines.axis_depth_mm[near])) if near.any() else None
    tracks = []
    for depth_mm in line_depths_mm(lines, acquisition.mm_per_px):
        on = np.abs(lines.axis_depth_mm - depth_mm) < SAME_LINE_MM
        presence = np.unique(index[on]).size / len(slices)
        if presence >= LEAST_PRESENCE and _dark_behind(slices, index[on], lines.where(on), acquisition):
            tracks.append(float(np.median(lines.axis_depth_mm[on])))
    return max(tracks) if tracks else None


def _dark_behind(
    slices: Sequence[SliceFeatures], index: NDArray[np.intp], lines: Lines, acquisition: OctAcquisition
) -> bool:
    """Whether darkness follows a line, and then something bright, in the recording's median profile.

    ``lines`` are the same one in the slices ``index``.
    """
    mm_per_px, gap_mm = acquisition.mm_per_px, acquisition.gap_mm
    n_px = round(2.5 * gap_mm / mm_per_px)

    profiles = [
        _known(medians(samples_behind(slices[i], lines.circle(k), mm_per_px, n_px))) for k, i in enumerate(index)
    ]
    profile = _known(medians(np.asarray(profiles, dtype=np.float32)))
    first, last = round(0.04 / mm_per_px), max(round(0.3 * gap_mm / mm_per_px), round(0.08 / mm_per_px))
    if profile.size <= last + 2 or not np.isfinite(profile[first:last]).all():
        return False
    darkest, dark = float(np.nanmin(profile)), float(np.median(profile[first:last]))
    wall = float(np.nanmax(profile[last:]))
    line = float(np.nanmax(profile[: max(2, round(0.015 / mm_per_px))]))
    return dark < darkest + 0.5 * (line - darkest) and dark < darkest + DARK_SHARE * (wall - darkest)


def _known(medians: Image) -> Image:
    """Columns without any sample get 0."""
    return np.where(np.isfinite(medians), medians, np.float32(0))


def starts_anywhere(capillary: Capillary, start: Literal["auto", "triggered", "free"]) -> bool:
    """Return whether turns start anywhere, so that the catheter's offset points another way in every slice."""
    if start != "auto":
        return start == "free"
    offset = (capillary.x_mm + 1j * capillary.y_mm)[capillary.known]
    offset = offset[np.abs(offset) > LEAST_OFFSET_MM]
    if offset.size < 4:
        return False
    return bool(np.median(np.abs(np.angle(offset[1:] * np.conj(offset[:-1])))) > FREE_RAD)


def steady_slices(capillary: Capillary, free: bool) -> Mask:
    """Return in which slices the circle is known and near to a neighbour's or to the median of six, bool (n_slices,).

    Where turns start anywhere (``free``), only how far off the axis they are can be compared.
    """
    steady = capillary.known.copy()
    aside = (capillary.offset_mm, np.zeros(len(capillary))) if free else (capillary.x_mm, capillary.y_mm)
    places = np.stack(aside, axis=1)
    for i in range(len(places)):
        before, after = places[max(0, i - REACH) : i], places[i + 1 : i + 1 + REACH]
        before, after = before[np.isfinite(before[:, 0])], after[np.isfinite(after[:, 0])]
        around = np.concatenate([before, after])
        if len(around) >= 2:
            typical = np.concatenate([before[-1:], after[:1], np.median(around, axis=0)[None]])
            if np.min(np.hypot(*(typical - places[i]).T)) > STRAY_MM:
                steady[i] = False
    return steady


def bridged(capillary: Capillary) -> Capillary:
    """Return the capillary with unknown slices interpolated linearly between known ones; one must be known."""
    every, known = np.arange(len(capillary)), np.flatnonzero(capillary.known)
    x, y, depth = (
        np.interp(every, known, values[known]) for values in (capillary.x_mm, capillary.y_mm, capillary.axis_depth_mm)
    )
    return Capillary(x, y, depth, capillary.radius_mm)


@dataclass(frozen=True, eq=False)
class Faces:
    """The capillary's outer face in every slice, and how well it fits.

    Attributes: ``capillary``, a circle each; ``bridged``, bool (n_slices,), where it is interpolated from neighbours;
    ``inlier_fraction``, float64 (n_slices,), of columns that show the face; ``residual_mm``, float64 (n_slices,), root
    mean square of these; ``ripple_mm``, float64 (n_slices, N_RIPPLE), where the face departs from the circle, see
    :mod:`endoct.modalities.oct.face.faces`.
    """

    capillary: Capillary
    bridged: Mask
    inlier_fraction: Coordinates
    residual_mm: Coordinates
    ripple_mm: Coordinates

    @property
    def observed(self) -> Capillary:
        """The circles of slices that show the face, NaN in bridged ones."""
        return self.capillary.where(~self.bridged)

    @property
    def typical_axis_mm(self) -> float:
        """Median depth of the axis in slices that show the face, mm."""
        return float(np.median(self.capillary.axis_depth_mm[~self.bridged]))

    def reordered(self, order: NDArray[np.intp]) -> "Faces":
        """Return the same faces with slice ``order[i]`` in place i."""
        of_slices = {name: values[order] for name, values in vars(self).items() if name != "capillary"}
        return Faces(self.capillary.reordered(order), **of_slices)


def locate_faces(slices: Sequence[SliceFeatures], acquisition: OctAcquisition, parameters: OctParameters) -> Faces:
    """Return the outer face in all ``slices``, which come in the order of z.

    Raises :class:`NotSeen` where no line qualifies, nothing lies before it, or most slices do not show it.
    """
    lines = outer_line(slices, acquisition, parameters.start_offset_mm)
    if lines is None:
        raise _no_capillary("no line with darkness and then a wall behind it")
    if parameters.start_offset_mm is None and not shows_catheter(slices, bridged(lines)):
        raise _no_capillary("no line before it, neither the glass's inner face nor the catheter's sheath")
    free = starts_anywhere(lines, parameters.start)
    lines = lines.where(steady_slices(lines, free))
    if not lines.known.any():
        raise _no_capillary("it in no slice")
    axis_mm = float(np.nanmedian(lines.axis_depth_mm))
    starts = bridged(lines)
    circles, fractions, residuals = zip(
        *(_fit_face(slices[i], starts.circle(i), axis_mm, parameters) for i in range(len(slices))), strict=True
    )
    capillary = Capillary.of(circles, lines.radius_mm)
    fraction = np.array(fractions)
    good = fraction >= parameters.least_inlier_fraction
    good &= np.abs(capillary.axis_depth_mm - axis_mm) < SAME_LINE_MM
    good &= steady_slices(capillary.where(good), free) | (fraction > CERTAIN_FRACTION)
    if 2 * np.count_nonzero(good) < len(slices):
        raise _no_capillary(f"it in {np.count_nonzero(good)} of {len(slices)} slices")
    capillary = bridged(capillary.where(good))

    def ripple(i: int) -> Coordinates:
        points = slices[i].points if good[i] else Points.none()
        return fit_ripple(points, capillary.circle(i), parameters.face_tolerance_mm)

    return Faces(
        capillary=capillary,
        bridged=~good,
        inlier_fraction=fraction,
        residual_mm=np.array(residuals),
        ripple_mm=np.array([ripple(i) for i in range(len(slices))]),
    )


def refit_faces(slices: Sequence[SliceFeatures], faces: Faces, parameters: OctParameters) -> Faces:
    """Return ``faces`` fitted again, from where they are, to ``slices`` whose angles are those of beams.

    Bridged slices remain unchanged.
    """
    axis_mm = faces.typical_axis_mm
    circles = [faces.capillary.circle(i) for i in range(len(slices))]
    fraction, residual, ripple = (
        values.copy() for values in (faces.inlier_fraction, faces.residual_mm, faces.ripple_mm)
    )

    for i in map(int, np.flatnonzero(~faces.bridged)):
        features = slices[i]
        circles[i], fraction[i], residual[i] = _fit_face(features, circles[i], axis_mm, parameters)
        ripple[i] = fit_ripple(features.points, circles[i], parameters.face_tolerance_mm)
    capillary = Capillary.of(circles, faces.capillary.radius_mm)
    return replace(faces, capillary=capillary, inlier_fraction=fraction, residual_mm=residual, ripple_mm=ripple)


def _fit_face(
    features: SliceFeatures, start: Circle, axis_mm: float, parameters: OctParameters
) -> tuple[Circle, float, float]:
    """The circle through one slice's points from ``start``, its axis near ``axis_mm``; and how well it fits."""
    points, tolerance_mm, circle = features.points, parameters.face_tolerance_mm, start
    for width in WIDTHS:
        circle = fit_circle(
            points, circle, width_mm=width * tolerance_mm, axis_depth_mm=axis_mm, axis_weight=AXIS_WEIGHT
        )
    residual = points.beyond_mm(circle)
    on = np.abs(residual) < tolerance_mm
    fraction = np.unique(points.angle_rad[on]).size / features.n_columns
    return circle, fraction, float(np.sqrt(np.mean(residual[on] ** 2))) if on.any() else float("nan")


def _no_capillary(instead: str) -> NotSeen:
    return NotSeen(
        "the capillary's outer face cannot be found",
        found=instead,
        expected="a bright line around the whole turn in most slices, the catheter before it, darkness and then a wall",
        remedy="check capillary_outer_diameter_mm, bore_diameter_mm and axial_pixel_mm, look at the B-scans, "
        "or give the depth of the outer face as start_offset_mm",
    )


def ripple_basis(angle_rad: ArrayLike) -> Coordinates:
    """Return cosines, then sines of harmonics 2 to ``RIPPLE_HARMONICS`` of the angles (n,), float64 (n, N_RIPPLE)."""
    waves = harmonics(angle_rad, range(2, RIPPLE_HARMONICS + 1))
    return np.concatenate([waves[:, 0::2], waves[:, 1::2]], axis=1)


def fit_ripple(points: Points, circle: Circle, tolerance_mm: float) -> Coordinates:
    """Return the factors of :func:`ripple_basis`, float64 (N_RIPPLE,), mm, from ``points`` near ``circle``."""
    residual = points.beyond_mm(circle)
    weight = tukey_weight(residual, 2 * tolerance_mm) * points.strength
    basis = ripple_basis(points.angle_rad)
    normal = basis.T @ (weight[:, None] * basis) + DAMPING * max(float(weight.sum()), 1.0) * np.eye(N_RIPPLE)
    return np.asarray(np.linalg.solve(normal, basis.T @ (weight * residual)))
