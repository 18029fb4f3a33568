"""The catheter's own sheath as a mark of where its optics look: lines that keep their angle to one another."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.face.capillary import Faces, line_depths_mm
from endoct.modalities.oct.face.sine import circle_distance_mm
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad

SAME_LINE_MM = 0.02
LINE_WIDTH_MM = 0.008
LEAST_SECTORS = 0.3
LEAST_PRESENCE = 0.6
TELLING_MM = 0.006  # a line nearer to its axis has no direction
POINT_MM = 0.0001  # of a line's offset, at best
RIGID_RAD = 0.08


@dataclass(frozen=True, eq=False)
class Mark:
    """Direction (n,) in which a mark is seen in each slice's own frame, NaN where not, with its standard deviation."""

    direction_rad: Coordinates
    sigma_rad: Coordinates


def sheath_mark(slices: Sequence[SliceEvidence], faces: Faces, radius_mm: float, mm_per_px: float) -> Mark | None:
    """Return the direction of the lines that keep their angle to one another, or None where fewer than two do."""
    lines = np.concatenate([one.lines for one in slices])
    axis_mm = float(np.median(faces.axis_depth_mm))
    depths = [float(depth) for depth in line_depths_mm(lines, mm_per_px) if abs(depth - axis_mm) >= SAME_LINE_MM]
    # slice by slice, since each may have to be read from a disk
    of_slices = np.array([[_offset(one, depth, radius_mm) for depth in depths] for one in slices])
    offsets = []
    for offset in of_slices.T:
        seen = np.isfinite(offset)
        if np.mean(seen) >= LEAST_PRESENCE and np.median(np.abs(offset[seen])) > TELLING_MM:
            offsets.append(offset)
    if len(offsets) < 2:
        return None
    seen = np.array(offsets)
    directions, lengths = np.angle(seen), np.nanmedian(np.abs(seen), axis=1)
    apart = np.array([[_scatter(a - b) for b in directions] for a in directions])
    rigid = apart < RIGID_RAD
    members = np.flatnonzero(rigid[int(np.argmax(rigid.sum(axis=1)))])
    if members.size < 2:
        return None
    return _together(directions[members], POINT_MM / lengths[members])


def _offset(evidence: SliceEvidence, depth_mm: float, radius_mm: float) -> complex:
    """Return the offset x + iy of the line whose axis lies near ``depth_mm``, NaN where it is not seen well."""
    near = evidence.lines[np.abs(evidence.lines[:, 2] - depth_mm) < SAME_LINE_MM]
    if not near.size:
        return complex(np.nan, np.nan)
    x, y, zero = near[int(np.argmax(near[:, 3])), :3]
    points = evidence.points
    cosine, sine = np.cos(points.angle_rad), np.sin(points.angle_rad)
    for _ in range(5):
        residual = points.depth_mm - zero - circle_distance_mm(points.angle_rad, x, y, radius_mm)
        weight = np.maximum(1 - (residual / LINE_WIDTH_MM) ** 2, 0) ** 2 * points.strength
        if np.unique(points.angle_rad[weight > 0]).size < LEAST_SECTORS * evidence.n_columns:
            return complex(np.nan, np.nan)
        jacobian = np.stack([-cosine, -sine, np.ones_like(cosine)], axis=1)
        normal = jacobian.T @ (weight[:, None] * jacobian) + 1e-9 * np.eye(3)
        x, y, zero = np.array([x, y, zero]) + np.linalg.solve(normal, jacobian.T @ (weight * residual))
    return complex(x, y)


def _scatter(angle_rad: Coordinates) -> float:
    """Robust standard deviation of angles about their centre; NaN are left out."""
    known = angle_rad[np.isfinite(angle_rad)]
    if known.size < 4:
        return float("inf")
    centre = np.angle(np.sum(np.exp(1j * known)))
    away = wrap_rad(known - centre)
    return 1.4826 * float(np.median(np.abs(away - np.median(away))))


def _together(directions_rad: Coordinates, least_sigma_rad: Coordinates) -> Mark:
    """Return the weighted direction of lines, float64 (lines, n), that keep their angles to one another.

    A line weighs by how it keeps to the others.
    """
    sigma = np.full(len(directions_rad), 0.02)
    seen = np.isfinite(directions_rad)
    turned = directions_rad - np.angle(np.nansum(np.exp(1j * (directions_rad - directions_rad[:1])), axis=1))[:, None]
    for _ in range(4):
        sums = np.where(seen, np.exp(1j * turned) / sigma[:, None] ** 2, 0)
        others = sums.sum(axis=0) - sums  # without itself, or the surest would only agree with itself
        away = np.where(seen & (np.abs(others) > 0), wrap_rad(turned - np.angle(others)), np.nan)
        turned = turned - np.nanmedian(away, axis=1)[:, None]
        # its own scatter less that of the others it was held against
        held = 1 / np.sqrt(np.maximum(np.sum(1 / sigma**2) - 1 / sigma**2, 1e-12))
        scatter = np.array([_scatter(one) for one in away])
        sigma = np.maximum(np.sqrt(np.maximum(scatter**2 - held**2, (0.5 * scatter) ** 2)), least_sigma_rad)
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
