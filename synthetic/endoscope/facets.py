"""The wall in facets that exchange light (radiosity), and how steeply bone rises along the bore next to each place.

What each facet sees of the others is followed once for all frames. The relief is sampled on a coarse grid (z, θ).
Every sample is a facet. Where the relief between it and its neighbours is steep, as on the side of a cell, it has
more of them, one for each ``LEVEL_MM`` of depth. From each, rays go out by the cosine law and are followed to the
facet that they meet. The probe, which moves, is left out: it takes some of that light and sends back about as much.

The light that arrives at a facet by way of others is the mean, over its rays, of what the facets there send on: their
albedo times the light they get, directly and by way of others. All colours are treated alike.

The shade is how steeply bone rises: it says which light can reach a place of the wall, in any frame.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.endoscope.cone import band_centre_mm
from endoct.synthetic.endoscope.direct_light import Places, direct
from endoct.synthetic.endoscope.facet_grid import (
    LEVEL_MM,
    FacetGrid,
    Indices,
    facet_grid,
    level_of,
    neighbours,
    seen_facets,
)
from endoct.synthetic.endoscope.sight import lookup, lookup_all
from endoct.synthetic.sample.parameters import Endoscope

WAYS = (-1, 0), (1, 0), (0, -1), (0, 1)
"""Steps to the neighbours of a sample, in z and in θ."""
LOOKS = 8
"""The wall between two samples is looked at this often."""


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
    return Facets(
        grid=grid,
        z_mm=z_mm,
        theta_rad=theta_rad,
        radius_mm=radius,
        slope_z=slope_z,
        slope_theta=slope_theta,
        albedo=_albedo(wall, grid)[row, column],
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


def _albedo(wall: WallMaps, grid: FacetGrid) -> Image:
    """Return the mean albedo about each sample."""
    n_z, n_theta = grid.relief_mm.shape
    return np.asarray(cv2.resize(wall.albedo, (n_theta, n_z), interpolation=cv2.INTER_AREA), dtype=np.float32)


EVERY_COLUMN = 2
"""Columns of the wall's maps to one of the shade's."""
REACH = 1.2
"""Bone that may cast a shadow is searched this far along the bore, in mm for each mm of depth. No light comes in at a
steeper slant."""
GROWS = 1.1
"""Distances that are looked at lie one row apart at first, then in this ratio."""
COLUMNS_AT_ONCE = 64


def shade_of(wall: WallMaps) -> Image:
    """Return the steepest rise of bone towards the bore's axis, mm/mm, float32 (n_z, n_theta/2, 2).

    At smaller z and at larger z of each place; a ray that comes along the bore at dz/dr is blocked where their product
    is over 1.
    """
    relief = np.ascontiguousarray(wall.relief_mm[:, ::EVERY_COLUMN])
    least, most = wall.relief_range_mm
    shade = np.zeros((*relief.shape, 2), np.float32)
    rows = _distances(min(relief.shape[0] - 1, int(REACH * (most - least) / wall.dz_mm)))
    for first in range(0, relief.shape[1], COLUMNS_AT_ONCE):
        part = np.ascontiguousarray(relief[:, first : first + COLUMNS_AT_ONCE])
        before, behind = np.zeros_like(part), np.zeros_like(part)
        for k in rows:
            rise = part[k:] - part[:-k]
            rise *= np.float32(1 / (k * wall.dz_mm))
            np.maximum(before[k:], rise, out=before[k:])
            np.maximum(behind[:-k], -rise, out=behind[:-k])
        shade[:, first : first + COLUMNS_AT_ONCE, 0] = before
        shade[:, first : first + COLUMNS_AT_ONCE, 1] = behind
    return shade


def _distances(most: int) -> list[int]:
    rows, at = [], 1.0
    while at <= most:
        rows.append(int(at))
        at = max(at + 1, at * GROWS)
    return rows


BOUNCES = 5
MOST_ALBEDO = 0.95
REACH_MM = 2.0
"""Light is followed this far along the bore beyond the visible band."""


@dataclass(frozen=True, eq=False)
class Bounced:
    """Irradiance by way of other bone, float32 (levels·rows, columns): level by level, on the facets' grid.

    Rows are those of the grid from ``first_row`` on, ``rows`` of each level.
    """

    grid: FacetGrid
    first_row: int
    rows: int
    irradiance: Image

    def at(self, z_mm: Image, theta_rad: Image, radius_mm: Image) -> Image:
        """Return the irradiance of places, z from the mouth, float32 (n,)."""
        row = np.clip(self.grid.row(z_mm) - self.first_row, 0, self.rows - 1)
        column = self.grid.column(theta_rad)
        levels = self.irradiance.shape[0] // self.rows
        level = np.clip((radius_mm - self.grid.radius_mm) * np.float32(1 / LEVEL_MM), 0, levels - 1)
        below = np.floor(level)
        found = lookup(self.irradiance, row + below * self.rows, column)
        deep = np.flatnonzero(level > below)
        above = np.minimum(below[deep] + 1, levels - 1)
        deeper = lookup(self.irradiance, row[deep] + above * self.rows, column[deep])
        found[deep] += (level - below)[deep] * (deeper - found[deep])
        return found


def bounced(camera: Endoscope, frame_index: int, wall: WallMaps, facets: Facets, shade: Image) -> Bounced:
    """Return the light of one frame after its reflections from bone to bone."""
    grid, middle = facets.grid, camera.z_mm[frame_index]
    reach = REACH_MM + camera.visible_length_mm / 2
    some = _rows(grid, middle - reach, middle + reach)
    lit, part = np.zeros(len(grid) + 1, np.float32), grid.of_rows(*some)
    z_mm, theta_rad = facets.z_mm[part], facets.theta_rad[part]
    row = np.clip(z_mm / np.float32(wall.dz_mm), 0, wall.relief_mm.shape[0] - 1)
    before, behind = lookup_all(shade, row, theta_rad / np.float32(wall.dtheta_rad * EVERY_COLUMN))
    apex_mm = middle - band_centre_mm(camera, wall.radius_mm)
    at = Places(
        z_mm=z_mm - np.float32(apex_mm),
        theta_rad=theta_rad,
        radius_mm=facets.radius_mm[part],
        slope_z=facets.slope_z[part],
        slope_theta=facets.slope_theta[part],
        shade_before=before,
        shade_behind=behind,
    )
    straight, _ = direct(camera, frame_index, at, wall.radius_mm)
    albedo = np.minimum(np.float32(camera.bone_albedo) * facets.albedo[part], np.float32(MOST_ALBEDO))
    seen, indirect = facets.seen[part], np.zeros_like(straight)
    for _ in range(BOUNCES if camera.bone_albedo else 0):
        lit[part] = albedo * (straight + indirect)
        indirect = lit.take(seen).mean(axis=1)
    lit[part] = indirect
    near = _rows(grid, middle - camera.visible_length_mm, middle + camera.visible_length_mm)
    return Bounced(grid, near[0], near[1] - near[0], _by_level(grid, near, lit))


def _rows(grid: FacetGrid, low_mm: float, high_mm: float) -> tuple[int, int]:
    """Return the range of rows between two places, at least one row."""
    n = grid.relief_mm.shape[0]
    first = min(max(int((low_mm - grid.first_mm) / grid.dz_mm), 0), n - 1)
    return first, min(max(int((high_mm - grid.first_mm) / grid.dz_mm) + 1, first + 1), n)


def _by_level(grid: FacetGrid, rows: tuple[int, int], values: Image) -> Image:
    """Return values of facets (n,) level by level; a sample without a facet on a level has that of the nearest."""
    columns = grid.relief_mm.shape[1]
    sample, own = np.arange(rows[0] * columns, rows[1] * columns), grid.relief_mm[slice(*rows)].ravel()
    levels = []
    for level in range(int(grid.highest[slice(*rows)].max()) + 1):
        relief = np.where(level_of(own) == level, own, np.float32(level * LEVEL_MM))
        levels.append(values[grid.facets_at(sample, relief)])
    return np.concatenate(levels).reshape(-1, columns)
