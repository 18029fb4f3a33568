"""The light that one frame's source sends from bone to bone: radiosity on the facets of the wall.

What arrives at a facet by way of others is the mean, over its rays, of what the facets there send on; that is their
albedo times the light they get, directly and by way of others. Colours are not told apart.
"""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Image
from endoct.synthetic.bone.maps import WallMaps
from endoct.synthetic.endoscope.cone import band_centre_mm
from endoct.synthetic.endoscope.direct_light import Places, direct
from endoct.synthetic.endoscope.facet_grid import LEVEL_MM, FacetGrid, level_of
from endoct.synthetic.endoscope.facets import EVERY_COLUMN, Facets
from endoct.synthetic.endoscope.sight import lookup, lookup_all
from endoct.synthetic.sample.parameters import Endoscope

BOUNCES = 5
MOST_ALBEDO = 0.95
REACH_MM = 2.0
"""How far along the bore beyond the visible band light is followed."""


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
    """Return what one frame's light is after it has been thrown from bone to bone."""
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
    """Return the first of the rows between two places, and the one after the last; at least one."""
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
