"""The light that arrives at places of the wall: straight from the probe, and from there by way of other bone.

Straight it comes from a ring of fibres around the lens, as the cone mirror shows it.

In the plane through the probe's axis and a place on the wall, the mirror is a straight line. A fibre that is ``u`` off
the axis within that plane lights the place from its mirror image, over a path L. Around the bore a cone does not act as
a plane mirror. No reflection off it changes the angular momentum of a ray about the axis. So a bundle that leaves the
fibre β wide arrives S·β wide, with

    S = ρ·(p/ρ_c + u·(1/ρ_c − 1/ρ)·L/Δρ).

Here p is the path to the cone, and Δρ the distance of the place from the mirror image. Cone and place are ρ_c and ρ off
the axis. The irradiance is cos i/(L·S). What a fibre is off that plane changes it by less than a hundredth and
is left out (``benchmarks/light`` traces photons without any of this). For u = 0 it is cos i·sin ψ/(L·ρ), and before a
plane mirror the inverse square of the path.

Fibres shine evenly over solid angle. What passes the mirror's edge is not followed. The shade is how steeply bone
rises along the bore next to each place: it says which light can reach the place, in any frame.

The light that arrives at a facet by way of others is the mean, over its rays, of what the facets there send on. That is
their albedo times the light they get, directly and by way of others. All colours are treated alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Image
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.endoscope.cone import FrameView, leaned
from endoct.synthetic.endoscope.facets import LEVEL_MM, FacetGrid, Facets, level_of
from endoct.synthetic.endoscope.sight import lookup, lookup_all

FIBRES = 6
"""Places in the ring from which light is summed up: cosines of angles that are evenly spaced over half of it."""
MIRROR_BEYOND = 1.05
"""Radius of the mirror over that of the part that the annulus shows."""
LEAST = 1e-3
"""What must be positive where light goes over the mirror is at least this, in mm or relative."""
PENUMBRA = 5.0
"""A shadow's edge goes from light to dark for one fibre over about the distance between two fibres."""
EVERY_COLUMN = 2
"""Columns of the wall's maps to one of the shade's."""
REACH = 1.2
"""Bone that may cast a shadow is searched this far along the bore, in mm for each mm of depth. No light comes in at a
steeper slant."""
GROWS = 1.1
"""Distances that are looked at lie one row apart at first, then in this ratio."""
COLUMNS_AT_ONCE = 64
BOUNCES = 5
MOST_ALBEDO = 0.95
REACH_MM = 2.0
"""Light is followed this far along the bore beyond the visible band."""


@dataclass(frozen=True, eq=False)
class LitPlaces:
    """Places on the bone, float32 (n,) each.

    ``z_mm`` from the mirror's apex along the bore, ``theta_rad`` and ``radius_mm`` in the bore's frame; slopes ∂r/∂z
    and ∂r/(r ∂θ) of the surface; ``shade_before``, ``shade_behind``: how steeply, at most, bone rises towards the
    bore's axis before the place (at smaller z) and behind it, mm/mm.
    """

    z_mm: Image
    theta_rad: Image
    radius_mm: Image
    slope_z: Image
    slope_theta: Image
    shade_before: Image
    shade_behind: Image


def direct(frame: FrameView, at: LitPlaces) -> tuple[Image, Image]:
    """Return the irradiance of places, and what it would be if they faced the light, float32 (n,) each.

    1 is the irradiance of the bore's wall, if it faced a source in the pinhole, in the middle of the annulus. Shadows
    are those that relief casts along the bore. Around it light comes within 3° of the radius, along which relief hides
    nothing.
    """
    camera, cone = frame.camera, frame.cone
    a, d = cone.half_angle_rad, cone.distance_mm
    sin_2a, cos_2a, cot_a = math.sin(2 * a), math.cos(2 * a), 1 / math.tan(a)
    mirror_mm = MIRROR_BEYOND * float(cone.rays(np.array([camera.outer_px])).rho_mm[0])
    cos, sin = np.cos(at.theta_rad), np.sin(at.theta_rad)
    off_x, off_y = frame.offset_mm
    x = np.asarray(at.radius_mm * cos - np.float32(off_x), dtype=np.float32)
    y = np.asarray(at.radius_mm * sin - np.float32(off_y), dtype=np.float32)
    x, y, z = leaned(camera, (x, y, at.z_mm), -1)
    rho: Image = np.sqrt(x * x + y * y)
    # the unit vectors away from the probe's axis and along it, along and across the bore's radius and along the bore
    away = _local(leaned(camera, (x / rho, y / rho, np.zeros_like(z)), 1), cos, sin)
    inward = _local(leaned(camera, (np.zeros_like(z), np.zeros_like(z), np.ones_like(z)), 1), cos, sin)
    faces = [one[0] - at.slope_theta * one[1] - at.slope_z * one[2] for one in (away, inward)]
    norm = 1 / np.sqrt(1 + at.slope_z * at.slope_z + at.slope_theta * at.slope_theta)
    lit, arriving = np.zeros_like(rho), np.zeros_like(rho)
    ring = [camera.fibre_ring_mm * math.cos((k + 0.5) * math.pi / FIBRES) for k in range(FIBRES)]
    for u in ring if camera.fibre_ring_mm else [0.0]:
        across = rho + np.float32(d * sin_2a + u * cos_2a)
        along = z + np.float32(d * cos_2a - u * sin_2a)
        forwards = cos_2a * along + sin_2a * across
        tangent = (sin_2a * along - cos_2a * across) / np.maximum(forwards, LEAST)
        meets = 1 - cot_a * tangent
        rho_cone = np.asarray((u + d * tangent) / np.maximum(meets, LEAST), dtype=np.float32)
        seen = (forwards > LEAST) & (meets > LEAST) & (rho_cone > LEAST) & (rho_cone < mirror_mm)
        np.clip(rho_cone, LEAST, mirror_mm, out=rho_cone)
        to_cone = (d + cot_a * rho_cone) * np.sqrt(1 + tangent * tangent)
        path = np.sqrt(across * across + along * along)
        spread = rho * to_cone + u * (rho - rho_cone) * path / across
        steep = (across * away[2] + along * inward[2]) / (across * away[0] + along * inward[0])
        shade = np.where(steep > 0, at.shade_before, at.shade_behind)
        share = np.clip(0.5 + PENUMBRA * (1 - np.abs(steep) * shade), 0, 1)
        share *= seen * rho_cone / (spread * path)
        arriving += share
        share *= np.maximum(across * faces[0] + along * faces[1], 0)
        lit += share / path
    scale = _bright_side(frame, x, y, rho)
    scale *= np.float32(1 / (_reference(frame) * (FIBRES if camera.fibre_ring_mm else 1)))
    arriving *= scale
    lit *= norm
    lit *= scale
    return lit, arriving


def _local(vectors: Sequence[Image], cos: Image, sin: Image) -> tuple[Image, Image, Image]:
    """Return vectors of the bore's frame along its radius, around it and along it."""
    x, y, z = vectors
    return x * cos + y * sin, y * cos - x * sin, z


def _reference(frame: FrameView) -> float:
    rays = frame.cone.rays(np.array([(frame.camera.inner_px + frame.camera.outer_px) / 2]))
    path_mm = rays.path_mm + (frame.radius_mm - rays.rho_mm) / rays.outward
    return float((rays.sine / (path_mm * frame.radius_mm))[0])


def _bright_side(frame: FrameView, x: Image, y: Image, rho: Image) -> Image:
    """Return the light's first harmonic around the probe."""
    camera, turned = frame.camera, frame.roll_rad + frame.camera.bright_side_rad
    return (
        1 + np.float32(camera.bright_side) * (x * np.float32(math.cos(turned)) + y * np.float32(math.sin(turned))) / rho
    )


def shade_of(wall: WallMaps) -> Image:
    """Return the steepest rise of bone towards the bore's axis, mm/mm, float32 (n_z, n_theta/2, 2).

    The two are for smaller z and for larger z of each place. A ray that comes along the bore at dz/dr is blocked where
    their product is over 1.
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


def bounced(frame: FrameView, wall: WallMaps, facets: Facets, shade: Image) -> Bounced:
    """Return the light of one frame after its reflections from bone to bone."""
    camera, grid, middle = frame.camera, facets.grid, frame.middle_mm
    reach = REACH_MM + camera.visible_length_mm / 2
    some = _rows(grid, middle - reach, middle + reach)
    lit, part = np.zeros(len(grid) + 1, np.float32), grid.of_rows(*some)
    z_mm, theta_rad = facets.z_mm[part], facets.theta_rad[part]
    row = np.clip(z_mm / np.float32(wall.dz_mm), 0, wall.relief_mm.shape[0] - 1)
    before, behind = lookup_all(shade, row, theta_rad / np.float32(wall.dtheta_rad * EVERY_COLUMN))
    at = LitPlaces(
        z_mm=z_mm - np.float32(frame.apex_mm),
        theta_rad=theta_rad,
        radius_mm=facets.radius_mm[part],
        slope_z=facets.slope_z[part],
        slope_theta=facets.slope_theta[part],
        shade_before=before,
        shade_behind=behind,
    )
    straight, _ = direct(frame, at)
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
