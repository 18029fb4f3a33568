"""The wall in facets that exchange light (radiosity), and which facets each of them sees: the same for all frames.

The wall's relief is sampled on a coarse grid (z, θ). Every sample is a facet. Where the relief towards its neighbours
is steep, as on the side of a cell, it has more: one for each ``LEVEL_MM`` of depth. Rays leave each facet by the cosine
law, and are followed to the facets that they meet. Between samples the relief is bilinear. A ray that passes the middle
of the bore is followed only before and after it. The probe, which moves, is left out: it takes some of that light and
sends back about as much.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.endoscope.sight import lookup

FACET_MM = 0.07
LEVEL_MM = 0.1
FLAT_MM = 0.02
"""Where the wall is steep, places on a sample's own facet are at most this far from the sample's relief."""

Indices = NDArray[np.int32]
RAYS = 48
STEP_MM = 0.03
OFF_MM = 0.004
"""A ray starts this far above its facet."""
LONGEST_STEPS = 120
"""A ray along the wall is taken to leave the bore after this many steps."""
RAYS_AT_ONCE = 2**16
GOLDEN_RAD = math.pi * (3 - math.sqrt(5))
WAYS = (-1, 0), (1, 0), (0, -1), (0, 1)
"""Steps to the neighbours of a sample, in z and in θ."""
LOOKS = 8
"""The wall between two samples is looked at this often."""


@dataclass(frozen=True, eq=False)
class FacetGrid:
    """Samples of a wall's relief, and the facets that each has.

    ``relief_mm`` (n_z, n_theta) at the samples, which are ``dz_mm`` apart, the first at ``first_mm``, and in θ the
    first at ``first_rad``. Halfway to its neighbours and before, the wall lies between ``least_mm`` and ``most_mm``.
    The facets of a sample follow each other from ``first`` on. They are its own, and, where the wall passes several
    levels, one for each from ``lowest`` to ``highest``. All (n_z, n_theta); those of a row follow those of the row
    before.
    """

    radius_mm: float
    dz_mm: float
    first_mm: float
    first_rad: float
    relief_mm: Image
    least_mm: Image
    most_mm: Image
    lowest: Indices
    highest: Indices
    first: Indices

    @property
    def dtheta_rad(self) -> float:
        """Step of the samples in θ, rad."""
        return 2 * math.pi / int(self.relief_mm.shape[1])

    def __len__(self) -> int:
        return int(self.first[-1, -1]) + int(_count(self.lowest[-1, -1], self.highest[-1, -1]))

    def of_rows(self, first: int, stop: int) -> slice:
        """Return the facets of some rows of samples."""
        ends = self.first[stop, 0] if stop < self.first.shape[0] else len(self)
        return slice(int(self.first[first, 0]), int(ends))

    def row(self, z_mm: Image) -> Image:
        """Return the rows, fractional, of places along the bore."""
        return np.asarray((z_mm - self.first_mm) / self.dz_mm, dtype=np.float32)

    def column(self, theta_rad: Image) -> Image:
        """Return the columns, fractional, of angles."""
        return np.asarray((theta_rad - self.first_rad) / self.dtheta_rad, dtype=np.float32)

    def facets_at(self, sample: NDArray[np.intp], relief_mm: Image) -> Indices:
        """Return the facets of some samples, indices into the flattened grid, on which the wall has ``relief_mm``."""
        own, lowest, highest = (one.ravel()[sample] for one in (self.relief_mm, self.lowest, self.highest))
        aside = 1 + np.clip(level_of(relief_mm), lowest, highest) - lowest
        flat = (lowest == highest) | (np.abs(relief_mm - own) < FLAT_MM)
        return np.asarray(self.first.ravel()[sample] + np.where(flat, 0, aside), dtype=np.int32)


def facet_grid(wall: WallMaps) -> FacetGrid:
    """Return where the facets of a wall are."""
    n_z, n_theta = wall.relief_mm.shape
    rows = max(1, round(FACET_MM / wall.dz_mm))
    columns = math.gcd(n_theta, 2 ** max(0, round(math.log2(FACET_MM / (wall.dtheta_rad * wall.radius_mm)))))
    relief = np.ascontiguousarray(wall.relief_mm[min(rows // 2, n_z - 1) :: rows, columns // 2 :: columns])
    around = np.stack([relief, *((relief + one) / 2 for one in neighbours(relief))])
    least, most = around.min(axis=0), around.max(axis=0)
    lowest, highest = level_of(least), level_of(most)
    count = _count(lowest, highest).ravel()
    return FacetGrid(
        radius_mm=wall.radius_mm,
        dz_mm=rows * wall.dz_mm,
        first_mm=min(rows // 2, n_z - 1) * wall.dz_mm,
        first_rad=(columns // 2) * wall.dtheta_rad,
        relief_mm=relief,
        least_mm=least,
        most_mm=most,
        lowest=lowest,
        highest=highest,
        first=(np.cumsum(count) - count).reshape(relief.shape).astype(np.int32),
    )


def _count(lowest: Indices, highest: Indices) -> Indices:
    """Return the number of facets of each sample."""
    return np.asarray(1 + np.where(highest > lowest, highest - lowest + 1, 0), dtype=np.int32)


def level_of(relief_mm: Image) -> Indices:
    """Return the level of each depth below the nominal wall."""
    return np.asarray(np.maximum(np.rint(relief_mm * np.float32(1 / LEVEL_MM)), 0), dtype=np.int32)


def neighbours(relief: Image) -> tuple[Image, Image, Image, Image]:
    """Return the relief at smaller and larger z, at smaller and larger θ."""
    wide = np.pad(relief, ((1, 1), (0, 0)), mode="edge")
    return wide[:-2], wide[2:], np.roll(relief, 1, axis=1), np.roll(relief, -1, axis=1)


def seen_facets(grid: FacetGrid, places: tuple[Image, ...], slopes: tuple[Image, Image]) -> Indices:
    """Return which facet each of the rays from a facet meets, (n, RAYS), n where it leaves the bore.

    ``places``: z from the mouth, θ and radius of the facets in order, and ``slopes`` of the surface there along z and
    θ, (n,) each.
    """
    (z_mm, theta_rad, radius_mm), (slope_z, slope_theta) = places, slopes
    n = z_mm.size
    seen = np.full((n, RAYS), n, np.int32)
    for part in (slice(first, first + RAYS_AT_ONCE // RAYS) for first in range(0, n, RAYS_AT_ONCE // RAYS)):
        cos, sin = np.cos(theta_rad[part]), np.sin(theta_rad[part])
        normal = _unit(-np.ones_like(cos), slope_theta[part], slope_z[part])
        start = np.stack([radius_mm[part], np.zeros_like(cos), z_mm[part]]) + np.float32(OFF_MM) * normal
        ways = _turned(_scattered(normal), cos, sin).reshape(3, -1)
        starts = np.repeat(_turned(start[:, :, None], cos, sin), RAYS, axis=2).reshape(3, -1)
        ray, facet = _met(grid, starts, ways)
        seen[part].reshape(-1)[ray] = facet
    return seen


def _unit(first: Image, second: Image, third: Image) -> Image:
    vectors = np.stack([first, second, third])
    return np.asarray(vectors / np.sqrt(np.sum(vectors * vectors, axis=0)), dtype=np.float32)


def _scattered(normal: Image) -> Image:
    """Return the directions of the rays by the cosine law, (3, n, RAYS): a spiral over a disc, raised to a half sphere.

    Normals (3, n) are along the radius, around and along the bore.
    """
    first = _unit(-normal[2], np.zeros_like(normal[0]), normal[0])
    second = np.cross(normal, first, axis=0)
    k = np.arange(RAYS)
    out, turn = np.sqrt((k + 0.5) / RAYS), k * GOLDEN_RAD
    parts = (out * np.cos(turn), first), (out * np.sin(turn), second), (np.sqrt(1 - out * out), normal)
    return np.asarray(sum(weight.astype(np.float32) * axis[:, :, None] for weight, axis in parts), dtype=np.float32)


def _turned(vectors: Image, cos: Image, sin: Image) -> Image:
    """Return vectors (3, n, …), along the radius and around, along x and y."""
    r, t, z = vectors
    c, s = cos[:, None], sin[:, None]
    return np.stack([r * c - t * s, r * s + t * c, z])


def _met(grid: FacetGrid, start: Image, way: Image) -> tuple[NDArray[np.intp], Indices]:
    """Return which of the rays (3, n) meet bone before they leave the bore, and the facets that they meet."""
    enters, leaves = _innermost(grid, start, way)
    t = np.where(enters <= 0, leaves, 0).astype(np.float32)
    before, depth_before = t, np.full_like(t, -1)
    on, rays, facets = np.arange(t.size), [np.zeros(0, np.intp)], [np.zeros(0, np.int32)]
    for _ in range(LONGEST_STEPS):
        x, y, z = start + t * way
        depth = np.sqrt(x * x + y * y) - np.float32(grid.radius_mm) - _relief(grid, z, _azimuth(x, y))
        inside = (z >= 0) & (z <= grid.dz_mm * grid.relief_mm.shape[0])
        met, further = np.flatnonzero((depth >= 0) & inside), np.flatnonzero((depth < 0) & inside)
        if met.size:
            share = depth_before[met] / np.minimum(depth_before[met] - depth[met], np.float32(-1e-9))
            at = before[met] + share * (t[met] - before[met])
            rays.append(on[met])
            facets.append(_facet(grid, start.take(met, axis=1) + at * way.take(met, axis=1)))
        if not further.size:
            break
        enters, leaves, depth_before, before = (one.take(further) for one in (enters, leaves, depth, t))
        on, start, way = on.take(further), start.take(further, axis=1), way.take(further, axis=1)
        t = before + np.float32(STEP_MM)
        jumps = (before <= enters) & (t > enters)
        before, t = np.where(jumps, leaves, before), np.where(jumps, leaves, t)
    return np.concatenate(rays), np.concatenate(facets)


def _innermost(grid: FacetGrid, start: Image, way: Image) -> tuple[Image, Image]:
    """Return where rays enter and leave the middle of the bore, which holds only air; ∞ where they miss it."""
    least = np.float32(grid.radius_mm + float(grid.relief_mm.min()))
    a = np.maximum(way[0] * way[0] + way[1] * way[1], np.float32(1e-9))
    b = way[0] * start[0] + way[1] * start[1]
    square = b * b - a * (start[0] * start[0] + start[1] * start[1] - least * least)
    root = np.sqrt(np.maximum(square, 0))
    passes = (square > 0) & (b < 0)
    return np.where(passes, (-b - root) / a, np.float32(np.inf)), (-b + root) / a


def _azimuth(x: Image, y: Image) -> Image:
    """Return the angles of places, to 0.2°: a tenth of a facet."""
    return np.asarray(cv2.phase(x, y), dtype=np.float32).ravel()


def _relief(grid: FacetGrid, z_mm: Image, theta_rad: Image) -> Image:
    row = np.asarray(np.clip(grid.row(z_mm), 0, grid.relief_mm.shape[0] - 1), dtype=np.float32)
    return lookup(grid.relief_mm, row, grid.column(theta_rad))


def _facet(grid: FacetGrid, places: Image) -> Indices:
    """Return the facets of places on the wall, (3, n)."""
    x, y, z_mm = places
    n_z, n_theta = grid.relief_mm.shape
    row = np.clip(np.rint(grid.row(z_mm)).astype(np.intp), 0, n_z - 1)
    sample = row * n_theta + np.mod(np.rint(grid.column(_azimuth(x, y))).astype(np.intp), n_theta)
    return grid.facets_at(sample, np.sqrt(x * x + y * y) - np.float32(grid.radius_mm))


@dataclass(frozen=True, eq=False)
class Facets:
    """The facets of a wall, (n,) each, float32, on their ``grid``, and what they see.

    ``z_mm`` from the mouth, ``theta_rad``, ``radius_mm``; the surface's slopes; ``albedo``, relative. ``seen``:
    (n, RAYS), the facet that each ray meets, n where it leaves the bore.
    """

    grid: FacetGrid
    z_mm: Image
    theta_rad: Image
    radius_mm: Image
    slope_z: Image
    slope_theta: Image
    albedo: Image
    seen: Indices


def facets_of(wall: WallMaps) -> Facets:
    """Return the facets of a wall."""
    grid = facet_grid(wall)
    row, column, level = _listed(grid)
    relief = grid.relief_mm[row, column]
    before, behind, left, right = (one[row, column] - relief for one in neighbours(grid.relief_mm))
    dtheta_mm = grid.dtheta_rad * grid.radius_mm
    # a sample's own facet lies as the flatter of its sides does
    slope_z = _flatter(-before, behind) / np.float32(grid.dz_mm)
    slope_theta = _flatter(-left, right) / np.float32(dtheta_mm)
    z_mm = (grid.first_mm + grid.dz_mm * row).astype(np.float32)
    theta_rad = (grid.first_rad + grid.dtheta_rad * column).astype(np.float32)
    aside = np.flatnonzero(level >= 0)
    # others lie, in the middle of what there is of their level, on the way to the neighbour that leads there fastest
    low = (level[aside] - np.float32(0.5)) * np.float32(LEVEL_MM)
    limits = (limit[row[aside], column[aside]] for limit in (grid.least_mm, grid.most_mm))
    ends = [np.clip(limit, low, low + np.float32(LEVEL_MM)) for limit in limits]
    to_level = ((ends[0] + ends[1]) / 2 - relief[aside]).astype(np.float32)
    ahead = np.stack([one[aside] for one in (before, behind, left, right)]) * np.sign(to_level)
    towards = ahead.argmax(axis=0)
    step_z, step_theta = (np.array(WAYS) * (grid.dz_mm, grid.dtheta_rad)).astype(np.float32)[towards].T
    share, steepness = _crossing(wall, z_mm[aside], theta_rad[aside], step_z, step_theta, to_level + relief[aside])
    # rays start where the relief is level between samples: they are followed over that
    even = np.clip(np.abs(to_level) / np.maximum(ahead.max(axis=0), np.float32(1e-6)), 0, 1)
    starts = [_moved(one, aside, even * step) for one, step in ((z_mm, step_z), (theta_rad, step_theta))]
    z_mm[aside] += share * step_z
    theta_rad[aside] += share * step_theta
    full = [
        (two[aside] - one[aside]) / np.float32(2 * step)
        for one, two, step in ((before, behind, grid.dz_mm), (left, right, dtheta_mm))
    ]
    scale = steepness / np.maximum(np.hypot(*full), np.float32(1e-6))
    slope_z[aside], slope_theta[aside] = scale * full[0], scale * full[1]
    relief[aside] += to_level
    radius = relief + np.float32(grid.radius_mm)
    albedo = cv2.resize(wall.albedo, grid.relief_mm.shape[::-1], interpolation=cv2.INTER_AREA)  # about each sample
    return Facets(
        grid=grid,
        z_mm=z_mm,
        theta_rad=theta_rad,
        radius_mm=radius,
        slope_z=slope_z,
        slope_theta=slope_theta,
        albedo=np.asarray(albedo, np.float32)[row, column],
        seen=seen_facets(grid, (*starts, radius), (slope_z, slope_theta)),
    )


def _moved(values: Image, which: NDArray[np.intp], by: Image) -> Image:
    moved = values.copy()
    moved[which] += by
    return moved


def _crossing(
    wall: WallMaps, z_mm: Image, theta_rad: Image, step_z: Image, step_theta: Image, relief_mm: Image
) -> tuple[Image, Image]:
    """Return which share of a step along the wall it takes to where that has ``relief_mm``, and its slope there."""
    shares = np.linspace(0, 1, LOOKS + 1, dtype=np.float32)
    row = (z_mm[:, None] + shares * step_z[:, None]) / np.float32(wall.dz_mm)
    column = (theta_rad[:, None] + shares * step_theta[:, None]) / np.float32(wall.dtheta_rad)
    row = np.clip(row, 0, wall.relief_mm.shape[0] - 1)
    places = [np.asarray(one, dtype=np.float32).ravel() for one in (row, column)]
    there = lookup(wall.relief_mm, *places).reshape(row.shape) - relief_mm[:, None]
    part = np.arange(there.shape[0])
    at = (there[:, :-1] * there[:, 1:] <= 0).argmax(axis=1)
    first, rise = there[part, at], there[part, at + 1] - there[part, at]
    way_mm = np.hypot(step_z, step_theta * np.float32(wall.radius_mm)) / LOOKS
    within = np.clip(-first / np.where(rise == 0, 1, rise), 0, 1)
    return (at + within) / LOOKS, np.abs(rise) / way_mm


def _flatter(first: Image, second: Image) -> Image:
    """Return the smaller of two steps, 0 where one goes up and the other down."""
    smaller = np.where(np.abs(first) < np.abs(second), first, second)
    return np.where(first * second > 0, smaller, 0)


def _listed(grid: FacetGrid) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return row, column and level of all facets; −1 is a sample's own."""
    first = grid.first.ravel()
    sample = np.repeat(np.arange(first.size), np.diff(first, append=len(grid)))
    rank = np.arange(sample.size) - first[sample]
    row, column = np.divmod(sample, grid.relief_mm.shape[1])
    return row, column, np.where(rank > 0, rank - 1 + grid.lowest.ravel()[sample], -1)
