"""Signed distances in a volume, finer than its voxels."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image, Mask


def signed_distance(level: Image, spacing_mm: Coordinates) -> Image:
    """Return the distance to where ``level`` (k, j, i) is 0, mm, > 0 where it is; float32.

    Between two voxels of different sign the surface lies where a straight line between their levels is 0. For voxels
    beside it the distance follows from those places along the three axes (Chopp 2001, "Some improvements of the fast
    marching method"), for all others from the nearest of these voxels and the piece of surface beside it. Where there
    is no surface the distance is ±1000.
    """
    air = level > 0
    beside, own = _next_to_surface(level, spacing_mm)
    if not beside.any():
        return np.where(air, np.float32(1000), np.float32(-1000))
    normal = np.stack([np.gradient(level, float(step), axis=axis) for axis, step in enumerate(spacing_mm)])
    normal /= np.maximum(np.sqrt(np.sum(normal * normal, axis=0)), 1e-9)
    nearest = ndimage.distance_transform_edt(~beside, sampling=spacing_mm, return_distances=False, return_indices=True)
    places = np.indices(level.shape, np.float32) * spacing_mm.astype(np.float32)[:, None, None, None]
    surface = places - np.where(air, own, -own) * normal  # beside every voxel that has one beside it

    def to_surface(of: NDArray[np.int32]) -> Image:
        way = places - surface[(slice(None), *of)]
        along = np.abs(np.sum(way * normal[(slice(None), *of)], axis=0))
        aside = np.maximum(np.sum(way * way, axis=0) - along * along, 0)
        # a piece of surface is as wide as a voxel, beyond which the way to its edge counts
        beyond = np.maximum(np.sqrt(aside) - np.float32(spacing_mm.max() / 2), 0)
        return np.asarray(np.sqrt(along * along + beyond * beyond), dtype=np.float32)

    distance = to_surface(nearest)
    for axis in range(3):
        for way in (-1, 1):  # the nearest piece may be that of a neighbour
            np.minimum(distance, to_surface(np.roll(nearest, way, axis=1 + axis)), out=distance)
    distance[beside] = own[beside]
    return np.where(air, distance, -distance)


def _next_to_surface(level: Image, spacing_mm: Coordinates) -> tuple[Mask, Image]:
    """Return the voxels next to the surface, and their distances from it, mm."""
    beside, inverse_square = np.zeros(level.shape, np.bool_), np.zeros(level.shape, np.float32)
    for axis, step in enumerate(spacing_mm):
        to_crossing = np.full(level.shape, np.inf, np.float32)
        first, last = [slice(None)] * 3, [slice(None)] * 3
        first[axis], last[axis] = slice(None, -1), slice(1, None)
        a, b = level[tuple(first)], level[tuple(last)]
        differs = (a > 0) != (b > 0)
        share = np.where(differs, a / np.where(differs, a - b, 1), np.inf).astype(np.float32)
        for part, way in ((tuple(first), share), (tuple(last), np.where(differs, 1 - share, np.inf))):
            np.minimum(to_crossing[part], np.float32(step) * np.maximum(way, 1e-4), out=to_crossing[part])
        beside |= np.isfinite(to_crossing)
        inverse_square += 1 / (to_crossing * to_crossing)
    return beside, np.where(beside, 1 / np.sqrt(np.maximum(inverse_square, 1e-12)), 0).astype(np.float32)


def chambers(distance_mm: Image, spacing_mm: Coordinates, apart_mm: float) -> NDArray[np.int32]:
    """Return the chambers of air, 1, 2, …: basins around the places farthest from bone, int32 (k, j, i), 0 in bone.

    Air of a mastoid is connected nearly throughout; what is called a cell ends where it is narrow. Two places are two
    cells' where they are ``apart_mm`` from each other along an axis.
    """
    from skimage.segmentation import watershed  # takes a while to load

    air = distance_mm > 0
    smooth = ndimage.gaussian_filter(distance_mm, 1.0)
    window = np.maximum(3, 2 * np.rint(apart_mm / 2 / spacing_mm).astype(int) + 1)
    peaks = air & (smooth == ndimage.maximum_filter(smooth, size=tuple(window)))
    parts, n_parts = ndimage.label(air)
    peakless = np.ones(n_parts + 1, np.bool_)
    peakless[parts[peaks]] = peakless[0] = False
    markers, _ = ndimage.label(peaks | peakless[parts], structure=np.ones((3, 3, 3)))
    return np.asarray(watershed(-smooth, markers, mask=air), dtype=np.int32)
