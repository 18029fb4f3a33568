"""Rivals of the task "wall": plain ways to join both sides, or to fill the gaps between the rows of one."""

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.fusion.evidence.light_alone import FARTHEST_MM
from endoct.fusion.wall.both_sides import MeasuredRows
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.bench.tasks.wall import JoinedWall, ShownPair

APART_MM, ACROSS = 0.05, 2
"""Kriging takes so many columns on either side, so far apart, of two rows on either side."""


def endoscope(pair: ShownPair) -> JoinedWall:
    """Return the endoscope's cells, and depth by parallax."""
    return JoinedWall(_masks(pair)[0], pair.sides.parallax_mm)


def oct_alone(pair: ShownPair) -> JoinedWall:
    """Return the OCT's cells, and depth interpolated between its rows."""
    return JoinedWall(_masks(pair)[1], pair.sides.relief_mm)


def believed(pair: ShownPair) -> JoinedWall:
    """Return the side of which endoct doubts less."""
    return (oct_alone if pair.believed == pair.sides.depth_side else endoscope)(pair)


def union(pair: ShownPair) -> JoinedWall:
    """Return what either side shows."""
    light, depth = _masks(pair)
    return JoinedWall(light | depth, pair.sides.relief_mm)


def intersection(pair: ShownPair) -> JoinedWall:
    """Return what both sides show."""
    light, depth = _masks(pair)
    return JoinedWall(light & depth, pair.sides.relief_mm)


def mean_of_distances(pair: ShownPair) -> JoinedWall:
    """Return where the mean of the signed distances to both outlines is inside."""
    sample_mm = pair.sides.grid.dz_mm, pair.sides.grid.dtheta_mm
    inside_mm = sum(signed_distance(each, sample_mm, FARTHEST_MM) for each in _masks(pair))
    return JoinedWall(np.asarray(inside_mm > 0), pair.sides.relief_mm)


def staple(pair: ShownPair) -> JoinedWall:
    """Return what Warfield's STAPLE makes of two raters (Warfield 2004), by SimpleITK."""
    import SimpleITK as sitk

    both = pair.sides.observed[0] & pair.sides.observed[1]
    images = [sitk.GetImageFromArray((each & both).astype(np.uint8)) for each in _masks(pair)]
    return JoinedWall(np.asarray(sitk.GetArrayFromImage(sitk.STAPLE(images, 1.0)) > 0.5), pair.sides.relief_mm)


def oct_linear(pair: ShownPair) -> JoinedWall:
    """Return the OCT alone, interpolated linearly between its rows."""
    rows, grid = pair.sides.rows, pair.sides.grid
    return JoinedWall(linear(_of_rows(pair), rows, grid) > 0.5, pair.sides.relief_mm)


def oct_kriged(pair: ShownPair) -> JoinedWall:
    """Return the OCT alone, kriged between its rows."""
    rows, grid = pair.sides.rows, pair.sides.grid
    return JoinedWall(kriged(_of_rows(pair), rows, grid) > 0.5, kriged(rows.relief_mm, rows, grid))


def _masks(pair: ShownPair) -> tuple[Mask, Mask]:
    """Return the cells of the endoscope and of the OCT."""
    sides = pair.sides
    return sides.cells[sides.light_side], sides.cells[sides.depth_side]


def _of_rows(pair: ShownPair) -> Image:
    return np.asarray(pair.sides.rows.cells > 0.5, np.float32)


def linear(image: Image, rows: MeasuredRows, grid: SurfaceGrid) -> Image:
    """Return ``image`` on measured rows, (n_rows, n_theta), interpolated linearly on the rows of ``grid``."""
    near, far = rows.neighbours(grid.z_mm)
    share = np.clip((grid.z_mm - rows.z_mm[near]) / (rows.z_mm[far] - rows.z_mm[near]), 0, 1)[:, np.newaxis]
    return np.asarray(image[near] * (1 - share) + image[far] * share, np.float32)


def kriged(image: Image, rows: MeasuredRows, grid: SurfaceGrid) -> Image:
    """Return ``image`` on measured rows by ordinary kriging, with a covariance that falls off exponentially.

    Its range is where the correlation along θ falls to 1/e, its nugget what is lost within one column. Samples that are
    not known count for nothing.
    """
    known = np.isfinite(image)
    range_mm, nugget = _course(np.where(known, image, image[known].mean()), grid.dtheta_mm)
    step = max(1, round(APART_MM / grid.dtheta_mm))
    offsets = step * np.arange(-ACROSS, ACROSS + 1)
    near, far = rows.neighbours(grid.z_mm)
    total, weight = np.zeros(grid.shape, np.float32), np.zeros(grid.shape, np.float32)
    filled = np.where(known, image, np.float32(0))
    for i, z_mm in enumerate(grid.z_mm):
        first, last = sorted((near[i], far[i]))
        of_rows = np.arange(max(first - 1, 0), min(last + 2, rows.z_mm.size))
        at_z, at_arc = (a.ravel() for a in np.meshgrid(rows.z_mm[of_rows], offsets * grid.dtheta_mm, indexing="ij"))
        apart_mm = np.hypot(at_z[:, None] - at_z, at_arc[:, None] - at_arc)
        system = np.ones((at_z.size + 1, at_z.size + 1))
        system[:-1, :-1] = (1 - nugget) * np.exp(-apart_mm / range_mm) + nugget * np.eye(at_z.size)
        system[-1, -1] = 0
        wanted = np.append((1 - nugget) * np.exp(-np.hypot(at_z - z_mm, at_arc) / range_mm), 1.0)
        weights = np.linalg.solve(system, wanted)[:-1].reshape(of_rows.size, offsets.size)
        for k, row in enumerate(of_rows):
            for m, offset in enumerate(offsets):
                total[i] += np.float32(weights[k, m]) * np.roll(filled[row], -offset)
                weight[i] += np.float32(weights[k, m]) * np.roll(known[row], -offset)
    return np.where(weight > 0.5, total / np.where(weight > 0.5, weight, 1), np.float32(np.nan))


def _course(image: NDArray[np.floating], step_mm: float) -> tuple[float, float]:
    """Return the range in mm and the nugget of the covariance of ``image`` along θ."""
    spectrum = np.abs(np.fft.rfft(image - image.mean(), axis=1)) ** 2
    correlation = np.fft.irfft(spectrum.sum(axis=0), image.shape[1])
    correlation /= correlation[0] or 1.0
    below = np.flatnonzero(correlation[: image.shape[1] // 2] < np.exp(-1))
    return max(1, below[0] if below.size else 1) * step_mm, float(np.clip(1 - correlation[1], 0.001, 0.5))
