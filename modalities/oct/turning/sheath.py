"""The catheter's own sheath as a landmark that does not turn with the optics.

Sheath lines are drawn from off the sheath's axis. The direction of that offset stays put while the catheter is pulled,
so that in a turn that starts later it is seen earlier. Two lines or more that keep their angle to one another through
the recording make a landmark; how well they keep it gives its standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.neighbours import LEAST_OFFSET_MM
from endoct.modalities.oct.face.outer_line import SAME_LINE_MM, line_depths_mm
from endoct.modalities.oct.face.points import tukey_weight
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import mean_angle_rad, wrap_rad
from endoct.stitching.robust import robust_sigma

LINE_WIDTH_MM = 0.008
LEAST_SECTORS = 0.3
LEAST_PRESENCE = 0.6
POINT_MM = 0.0001  # of a line's offset, at best
RIGID_RAD = 0.08
USUAL_RAD = 0.02


@dataclass(frozen=True, eq=False)
class Mark:
    """Direction (n,) of a landmark in each slice's own frame, NaN where it is not seen, with its standard deviation."""

    direction_rad: Coordinates
    sigma_rad: Coordinates


def sheath_mark(slices: Sequence[SliceFeatures], faces: Faces, mm_per_px: float) -> Mark | None:
    """Return the direction of the lines that keep their angle to one another, or None where fewer than two do."""
    lines = Lines.together([features.lines for features in slices])
    axis_mm = float(np.median(faces.capillary.axis_depth_mm))
    depths = [float(depth) for depth in line_depths_mm(lines, mm_per_px) if abs(depth - axis_mm) >= SAME_LINE_MM]
    # slice by slice, since each may have to be read from a disk
    of_slices = np.array([[_offset(features, depth) for depth in depths] for features in slices])
    offsets = []
    for offset in of_slices.T:
        seen = np.isfinite(offset)
        if np.mean(seen) >= LEAST_PRESENCE and np.median(np.abs(offset[seen])) > LEAST_OFFSET_MM:
            offsets.append(offset)
    if len(offsets) < 2:
        return None
    off_axis = np.array(offsets)
    directions, lengths = np.angle(off_axis), np.nanmedian(np.abs(off_axis), axis=1)
    apart = np.array([[_scatter_rad(a - b) for b in directions] for a in directions])
    rigid = apart < RIGID_RAD
    members = np.flatnonzero(rigid[int(np.argmax(rigid.sum(axis=1)))])
    if members.size < 2:
        return None
    return _combined(directions[members], POINT_MM / lengths[members])


def _offset(features: SliceFeatures, depth_mm: float) -> complex:
    """Return the offset x + iy of the line whose axis lies near ``depth_mm``, NaN where it is not seen well."""
    line = features.lines.strongest_near(depth_mm, SAME_LINE_MM)
    if line is None:
        return complex(np.nan, np.nan)
    points = features.points
    cosine, sine = np.cos(points.angle_rad), np.sin(points.angle_rad)
    for _ in range(5):
        residual = points.beyond_mm(line)
        weight = tukey_weight(residual, LINE_WIDTH_MM) * points.strength
        if np.unique(points.angle_rad[weight > 0]).size < LEAST_SECTORS * features.n_columns:
            return complex(np.nan, np.nan)
        jacobian = np.stack([-cosine, -sine, np.ones_like(cosine)], axis=1)
        normal = jacobian.T @ (weight[:, None] * jacobian) + 1e-9 * np.eye(3)
        dx, dy, deeper = (float(step) for step in np.linalg.solve(normal, jacobian.T @ (weight * residual)))
        line = Circle(line.x_mm + dx, line.y_mm + dy, line.axis_depth_mm + deeper, line.radius_mm)
    return complex(line.x_mm, line.y_mm)


def _scatter_rad(angle_rad: Coordinates) -> float:
    """Robust standard deviation of angles about their centre; NaN are left out."""
    known = angle_rad[np.isfinite(angle_rad)]
    if known.size < 4:
        return float("inf")
    away = wrap_rad(known - mean_angle_rad(known))
    return robust_sigma(away - np.median(away))


def _combined(directions_rad: Coordinates, least_sigma_rad: Coordinates) -> Mark:
    """Return the weighted direction of lines, float64 (lines, n), that keep their angles to one another.

    A line weighs by how well it keeps its angle to the others.
    """
    sigma = np.full(len(directions_rad), USUAL_RAD)
    seen = np.isfinite(directions_rad)
    turned = directions_rad - mean_angle_rad(directions_rad - directions_rad[:1], axis=1)[:, None]
    for _ in range(4):
        sums = np.where(seen, np.exp(1j * turned) / sigma[:, None] ** 2, 0)
        others = sums.sum(axis=0) - sums  # without the line itself, or the surest would only agree with itself
        away = np.where(seen & (np.abs(others) > 0), wrap_rad(turned - np.angle(others)), np.nan)
        turned = turned - np.nanmedian(away, axis=1)[:, None]
        # a line's own scatter less that of the others, with which it is compared
        of_others = 1 / np.sqrt(np.maximum(np.sum(1 / sigma**2) - 1 / sigma**2, 1e-12))
        scatter = np.array([_scatter_rad(one) for one in away])
        sigma = np.maximum(np.sqrt(np.maximum(scatter**2 - of_others**2, (0.5 * scatter) ** 2)), least_sigma_rad)
    weight = np.where(seen, 1 / sigma[:, None] ** 2, 0)
    mean = np.zeros(directions_rad.shape[1])
    for _ in range(8):  # a line that was mistaken for another in one slice must not pull the rest
        sums = np.where(seen, np.exp(1j * turned), 0) * weight
        mean = np.angle(np.sum(sums, axis=0))
        away = np.where(seen, wrap_rad(turned - mean), 0)
        weight = np.where(seen, 1 / (sigma[:, None] ** 2 + away**2), 0)
    total = weight.sum(axis=0)
    known = total > 0
    return Mark(np.where(known, mean, np.nan), np.where(known, 1 / np.sqrt(np.maximum(total, 1e-12)), np.nan))
