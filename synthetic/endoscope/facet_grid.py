"""The facets of a wall, and the rays that leave them by the cosine law.

Facets are samples of the wall's relief on a coarse grid (z, θ), on each level that it passes there. Rays are followed
to the facets that they meet; between samples the relief is bilinear. A ray that passes the middle of the bore is
followed only before and after it.
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


@dataclass(frozen=True, eq=False)
class FacetGrid:
    """Samples of a wall's relief, and the facets that each has.

    ``relief_mm`` (n_z, n_theta) at the samples, which are ``dz_mm`` apart, the first at ``first_mm``, and in θ the
    first at ``first_rad``. Halfway to its neighbours and before, the wall lies between ``least_mm`` and ``most_mm``.
    The facets of a sample follow each other, from ``first`` on: its own, and where the wall passes several levels one
    for each from ``lowest`` to ``highest``. All (n_z, n_theta); those of a row follow those of the row before.
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


RAYS = 48
STEP_MM = 0.03
OFF_MM = 0.004
"""A ray starts this far above its facet."""
LONGEST_STEPS = 120
"""A ray along the wall is taken to leave the bore after this many steps."""
RAYS_AT_ONCE = 2**16
GOLDEN_RAD = math.pi * (3 - math.sqrt(5))


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
