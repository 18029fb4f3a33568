"""Which of the bright lines is the capillary's outer face.

The depth axis has no known zero, so the outer face is the ruler for the wall's radius. Of the lines in the slices it is
the deepest one whose axis keeps its depth through the recording and that has darkness and then a wall behind it. Lines
of the sheath and the inner face lie before it; behind the wall's own surface it is not dark; a line that the detector
draws does not move at all. A bright plate of bone with marrow behind it looks the same, but has nothing before it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.ranks import medians
from endoct.modalities.oct.face.face_circle import Capillary
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.slices import SliceFeatures, samples_behind
from endoct.modalities.oct.manifest import OctAcquisition

SAME_LINE_MM = 0.02
FIXED_LINE_MM = 0.01
LEAST_PRESENCE = 0.4
BEFORE_MM = 0.03  # nearer to the face than that, a line may be a part of it
DARK_SHARE = 0.5  # behind the face it is nearer to the darkness than to the wall


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

    def profile_behind(k: int) -> Image:
        return _known(medians(samples_behind(slices[index[k]], lines.circle(k), mm_per_px, n_px)))

    profiles = [profile_behind(k) for k in range(len(index))]
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
