"""Planes that cut the bore, such as fractures: each shows as one period of a sine in an unrolled wall.

The middles of thin dark lines vote for the sines that go through them, one vote for each direction: the transform of
Duda and Hart (1972), for sines. What most directions vote for is fitted by least squares; its lines vote no more.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import medians, robust_sigma, robust_sigmas
from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.result import CuttingPlane
from endoct.stitching.grid import SurfaceGrid

THICKEST = 0.5
"""Lines are at most so thick. This and the next lengths are shares of the bore's radius."""
FINEST, COARSEST = 0.02, 0.25
"""Rows are looked at no closer, and lines are not followed from row to row where these lie farther apart."""
BIN, HIGHEST = 0.05, 3.5
"""The step in z of votes, and the amplitude of the highest sine: 74° of dip."""
NEAR = 0.15
"""Lines so near a sine that was voted for are its own."""
LINE_SIGMAS, LEAST_CONTRAST = 5.0, 0.1
"""A line is darker than what lies on either side along the bore, by so many times the spread of that and by so much."""
MOST_COLUMNS, DIRECTIONS = 360, 90
LEAST_VOTES, LEAST_SUPPORT = 0.55, 0.45
"""The share of directions that vote for a plane, and that of columns of which it has a line."""


def find_planes(darkness: Evidence) -> tuple[CuttingPlane, ...]:
    """Return the planes that show as thin dark lines around the bore, by ascending z."""
    radius_mm, z_mm = darkness.radius_mm, darkness.z_mm
    dz_mm = max(darkness.dz_mm, FINEST * radius_mm)
    n_rows = int((z_mm[-1] - z_mm[0]) / dz_mm) + 1
    if dz_mm > COARSEST * radius_mm or n_rows < 3:
        return ()
    even = on_grid(darkness, z_mm[0] + dz_mm * np.arange(n_rows), min(darkness.values.shape[1], MOST_COLUMNS))
    row, column = np.nonzero(_middles_of_lines(even))
    z, theta = even.z_mm[row] / radius_mm, 2 * np.pi / even.values.shape[1] * column
    planes: list[CuttingPlane] = []
    more = True
    while more:  # a plane may hide others that cut the axis at the same place
        more = False
        for sine in _voted_for(z, theta):
            if (fit := _fitted(z, theta, even.values.shape[1], sine)) is not None:
                more = True
                planes.append(fit[0].scaled(radius_mm))
                z, theta = z[~fit[1]], theta[~fit[1]]
    return tuple(sorted(planes, key=lambda plane: plane.z_mm))


def without_planes(cells: Mask, planes: tuple[CuttingPlane, ...], grid: SurfaceGrid) -> Mask:
    """Return ``cells``, bool (n_z, n_theta), without what is thin along the bore and lies in planes.

    A fracture is no cell. Where it opens into a cavity, that stays.
    """
    thickest_mm = THICKEST * grid.radius_mm
    in_plane = np.zeros(cells.shape, np.bool_)
    for plane in planes:
        in_plane |= np.abs(grid.z_mm[:, np.newaxis] - plane.z_at(grid.theta_rad)) <= thickest_mm / 2
    rows = max(3, round(thickest_mm / grid.dz_mm))
    beyond = np.pad(cells, ((rows, rows), (0, 0)), mode="edge")  # what the ends of z cut off may be thick
    is_thick = ndimage.binary_opening(beyond, np.ones((rows, 1)))[rows:-rows]
    return np.asarray(cells & (is_thick | ~in_plane))


def _middles_of_lines(darkness: Evidence) -> Mask:
    """Return the middles along z of what is thin and dark, bool (n_z, n_theta)."""
    rows = darkness.radius_mm / darkness.dz_mm
    window = max(3, 2 * round(THICKEST / 2 * rows) + 1)
    beyond = np.pad(darkness.values, ((window, window), (0, 0)), mode="edge")  # nothing is brighter beyond the ends
    above = (beyond - ndimage.grey_opening(beyond, size=(window, 1)))[window:-window]
    usual = medians(above)
    least = np.maximum(usual + LINE_SIGMAS * robust_sigmas(above - usual), LEAST_CONTRAST)
    around = 2 * max(1, round(NEAR * rows)) + 1
    highest = above == ndimage.maximum_filter1d(above, around, axis=0, mode="nearest")
    is_seen = ndimage.binary_erosion(darkness.valid, np.ones((window, 1)), border_value=1)  # on either side, too
    return np.asarray(highest & (above > least) & is_seen)


def _direction(theta: Coordinates) -> NDArray[np.intp]:
    return np.asarray(theta * (DIRECTIONS / (2 * np.pi)), np.intp) % DIRECTIONS


def _voted_for(z: Coordinates, theta: Coordinates) -> Iterator[Coordinates]:
    """Yield the sines, (3,) of 1, cos θ and sin θ in radii, that most lines lie on, in descending order of votes."""
    if z.size < LEAST_VOTES * DIRECTIONS:
        return
    first = z.min() - 1
    hits = np.zeros((DIRECTIONS, int((z.max() - first + 1) / BIN) + 1), np.uint8)
    hits[_direction(theta), ((z - first) / BIN).astype(np.intp)] = 1
    wide = ndimage.maximum_filter1d(hits, 3, axis=1)
    steps = np.arange(-round(HIGHEST / BIN), round(HIGHEST / BIN) + 1, 2)
    middle = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    votes, cosine, sine = _votes(wide, np.cos(middle), np.sin(middle), steps)
    peaks = (votes == ndimage.maximum_filter1d(votes, 5)) & (votes >= LEAST_VOTES * DIRECTIONS)
    for at in sorted(np.flatnonzero(peaks), key=lambda k: (-int(votes[k]), k)):
        yield np.array([first + (at + 0.5) * BIN, BIN * cosine[at], BIN * sine[at]])


@compiled
def _votes(
    hits: NDArray[np.uint8], cos: Coordinates, sin: Coordinates, steps: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """Return the most votes of a sine about each place along z, (n_z,), and its factors of cos θ and sin θ in bins."""
    n, n_z = hits.shape
    most, cosine, sine = np.zeros(n_z, np.uint8), np.zeros(n_z, np.int64), np.zeros(n_z, np.int64)
    total = np.empty(n_z, np.uint8)
    for a in steps:
        for b in steps:
            if a * a + b * b > steps[-1] * steps[-1]:
                continue
            total[:] = 0
            for k in range(n):
                by = int(np.round(a * cos[k] + b * sin[k]))
                for z in range(max(0, -by), min(n_z, n_z - by)):
                    total[z] += hits[k, z + by]
            for z in range(n_z):
                if total[z] > most[z]:
                    most[z], cosine[z], sine[z] = total[z], a, b
    return most, cosine, sine


def _fitted(z: Coordinates, theta: Coordinates, n_theta: int, sine: Coordinates) -> tuple[CuttingPlane, Mask] | None:
    """Return the plane, in radii, of the lines near a ``sine``, and which lines are its; None where they are too few.

    Neighbouring directions err alike, which widens the errors: their residuals count as of a process of first order.
    """
    basis = np.column_stack([np.ones_like(theta), harmonics(theta, (1,))])
    tolerance = NEAR
    for _ in range(8):
        off = z - basis @ sine
        own = np.abs(off) <= tolerance
        support = np.unique(theta[own]).size / n_theta
        if support < LEAST_SUPPORT:
            return None
        sine = np.asarray(np.linalg.lstsq(basis[own], z[own])[0], np.float64)
        tolerance = max(min(tolerance, 3 * robust_sigma(off[own])), BIN)
    order = np.argsort(theta[own], kind="stable")
    off = (z - basis @ sine)[own][order]
    squares = float(np.sum(off**2))
    alike = min(max(float(np.sum(off * np.roll(off, 1))) / max(squares, 1e-12), 0.0), 0.99)
    variance = squares / (off.size - 3) * (1 + alike) / (1 - alike)
    covariance = variance * np.linalg.inv(basis[own].T @ basis[own])
    slope, azimuth = math.hypot(sine[1], sine[2]), math.atan2(sine[2], sine[1])
    steeper = np.array([0, math.cos(azimuth), math.sin(azimuth)])
    aside = np.array([0, -math.sin(azimuth), math.cos(azimuth)])
    of_slope, of_side = (math.sqrt(u @ covariance @ u) for u in (steeper, aside))
    plane = CuttingPlane(
        z_mm=float(sine[0]),
        dip_rad=math.atan(slope),
        azimuth_rad=azimuth % (2 * math.pi),
        z_error_mm=math.sqrt(covariance[0, 0]),
        dip_error_rad=of_slope / (1 + slope**2),
        azimuth_error_rad=min(of_side / max(slope, 1e-9), math.pi),
        support=support,
        radius_mm=1.0,
    )
    return plane, np.abs(z - basis @ sine) <= NEAR
