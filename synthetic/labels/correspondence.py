"""Which A-scan saw what a pixel saw, and the other way round.

Both lead through the wall: a pixel's place on it is looked up among the places where beams end, and a beam's end
among the places where pixels end, so that what one of them cannot see has no counterpart.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from endoct.stitching.arrays import Coordinates, Image
from endoct.synthetic.labels.pullback import Pullback

SAME_PLACE_MM = 0.05
"""A pixel covers up to 0.02 mm of the wall; farther away lies something else, as the floor next to a lip."""


def ascans_of_places(pullback: Pullback, z_mm: Coordinates, theta_rad: Coordinates) -> tuple[Image, Image]:
    """Return (slice, A-scan), fractional, float32 (n,), that look at places of the wall (n,); NaN beyond the pullback.

    Between two slices the slice is interpolated; before the first and after the last half a pitch counts.
    """
    n_slices, n_ascans = pullback.z_mm.shape
    middle = pullback.z_mm.mean(axis=1, dtype=np.float64)
    order = np.argsort(middle)
    pitch_mm = np.gradient(middle) if n_slices > 1 else np.ones(1)
    nearest = order[np.searchsorted((middle[order][1:] + middle[order][:-1]) / 2, z_mm)]
    slice_, ascan = np.empty(z_mm.size), np.empty(z_mm.size)
    for i in map(int, np.unique(nearest)):
        mine = np.flatnonzero(nearest == i)
        around = np.argsort(pullback.theta_rad[i], kind="stable")
        theta = pullback.theta_rad[i, around].astype(np.float64)
        # as a point on a circle, for between the turn's end and its start the number jumps
        turns = np.interp(theta_rad[mine], theta, np.exp(2j * np.pi * around / n_ascans), period=2 * np.pi)
        ascan[mine] = np.mod(np.angle(turns) / (2 * np.pi), 1) * n_ascans
        k = np.minimum(ascan[mine].astype(np.intp), n_ascans - 1)
        slice_[mine] = i + (z_mm[mine] - pullback.z_mm[i, k]) / pitch_mm[i]
    beyond = (slice_ < -0.5) | (slice_ > n_slices - 0.5)
    slice_[beyond] = ascan[beyond] = np.nan
    return slice_.astype(np.float32), ascan.astype(np.float32)


def nearest_places(places_mm: Coordinates, wanted_mm: Coordinates) -> NDArray[np.intp]:
    """Return for each wanted place, float64 (m, 3), the index of the same among ``places_mm`` (n, 3), −1 for none."""
    if not len(places_mm):
        return np.full(len(wanted_mm), -1, np.intp)
    distance, index = cKDTree(places_mm).query(np.nan_to_num(wanted_mm, nan=1e6), distance_upper_bound=SAME_PLACE_MM)
    return np.where(np.isfinite(distance), index, -1)


def cartesian_mm(z_mm: Image, theta_rad: Image, radius_mm: Image) -> Coordinates:
    """Return places of the wall, arrays of one shape, as float64 (…, 3): x, y, z in the bore frame."""
    radius = radius_mm.astype(np.float64)
    return np.stack([radius * np.cos(theta_rad), radius * np.sin(theta_rad), z_mm], axis=-1).astype(np.float64)
