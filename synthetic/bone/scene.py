"""The bone: air in a bore and in its cells, as clearances from which rays can be traced, and what the cells hold.

The clearance of a place is its distance to the nearest surface, > 0 in air. That of the bore is R + displacement − r,
that of a cell is given by :mod:`endoct.synthetic.bone.cavities`. :mod:`endoct.synthetic.bone.rays` joins them and
follows the rays.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.synthetic.bone.cavities import OWN_SIDE, Cavities, Indices, Near, cavities, clearance, near
from endoct.synthetic.bone.field import STEEPEST, Field, build_field, joined_with_bore
from endoct.synthetic.bone.rays import BLOCK, STEP_MM, first_air, first_fluid, first_solid, joined, owner_of
from endoct.synthetic.bone.relief import BoreRelief, WallGrid, bore_relief, wall_grid
from endoct.synthetic.elementary import Numbers, azimuth
from endoct.synthetic.sample.parameters import Cell, Sample
from endoct.synthetic.sample.randomness import Stage, generator

SEPTUM_MM = 0.4
"""Through a septum up to this thick, a ray is followed to the bone behind it."""
NORMAL_MM = 0.002
"""A normal follows from clearances this far to either side."""
CELLS_STREAM = 100
"""Which of the wall's generators draws the contents of cells, beyond those of its textures."""


@dataclass(frozen=True, eq=False)
class Contents:
    """One value a cell, the first for no cell, (n + 1,).

    ``lining``: albedo of the inside over that of bone; ``rim_gain``: light added on its rim; ``filling``: what is in
    it; ``down`` float64 (n + 1, 3): unit vector across the surface of its fluid, into the fluid; 0 for no cell.
    """

    lining: Image
    rim_gain: Image
    filling: tuple[str, ...]
    down: Coordinates


@dataclass(frozen=True, eq=False)
class Scene:
    """The bone of one sample.

    ``relief``: of the bore without cells, on ``grid``; ``cells``: the cavities planted on its wall; ``field``: the
    air of three-dimensional bone, where it is that; ``contents``: what is in either's cells. ``displacement``
    (n_z, n_theta + 2): that relief its first columns once more at the end; ``steepest``: the largest of its slopes;
    ``least_mm``: the least of its values.
    """

    grid: WallGrid
    relief: BoreRelief
    cells: Cavities
    field: Field | None
    contents: Contents
    displacement: Image
    steepest: float
    least_mm: float


@dataclass(frozen=True, eq=False)
class Crossings:
    """What n rays meet, all along the ray in mm from its origin, float64 (n,), NaN where there is nothing.

    ``entry_mm``: the first solid surface, bone or dust; ``exit_mm``, ``reentry_mm``: where a septum thinner than
    0.4 mm is left and bone met again; ``fluid_mm``: where the ray enters fluid before the entry; ``cell`` int32: 1 +
    index of the cavity whose surface the entry is on, 0 on the bore's own wall; ``dust``: the entry is on bone dust;
    ``normal`` (n, 3): unit, from bone into air at the entry; ``fluid_normal`` (n, 3): of the fluid in that cell, into
    the fluid, 0 on the bore's own wall.
    """

    entry_mm: Coordinates
    exit_mm: Coordinates
    reentry_mm: Coordinates
    fluid_mm: Coordinates
    cell: NDArray[np.int32]
    dust: Mask
    normal: Coordinates
    fluid_normal: Coordinates


def build_scene(sample: Sample, workers: int = 1) -> Scene:
    """Return the bone that ``sample`` describes, made by ``workers`` threads."""
    grid, relief = wall_grid(sample), bore_relief(sample, workers)
    along = np.abs(np.diff(relief.displacement_mm, axis=0)).max(initial=0) / grid.dz_mm
    around = np.abs(np.diff(relief.displacement_mm, axis=1)).max(initial=0) / grid.dtheta_mm
    field = None
    if sample.bore.network is not None or sample.bore.volume is not None:
        field = build_field(sample)
    return Scene(
        grid=grid,
        relief=relief,
        cells=cavities(sample.bore.cells, grid.radius_mm),
        field=field,
        contents=contents_of_planted(sample.bore.cells) if field is None else contents_of_field(sample, field),
        displacement=np.pad(relief.displacement_mm, ((0, 0), (0, 2)), mode="wrap"),
        steepest=float(np.hypot(along, around)),
        least_mm=float(relief.displacement_mm.min()),
    )


def contents_of_planted(cells: Sequence[Cell]) -> Contents:
    """Return the contents of cells that were planted on the wall: their fluid lies across their axis."""
    down = np.zeros((len(cells) + 1, 3))
    for number, cell in enumerate(cells, 1):
        radial = np.array([np.cos(cell.theta_rad), np.sin(cell.theta_rad), 0.0])
        around = np.array([-radial[1], radial[0], 0.0])
        sideways = np.sin(cell.lean_direction_rad) * around + np.array([0, 0, np.cos(cell.lean_direction_rad)])
        down[number] = np.cos(cell.lean_rad) * radial + np.sin(cell.lean_rad) * sideways
    return Contents(
        lining=np.array([1.0] + [cell.lining for cell in cells], np.float32),
        rim_gain=np.array([0.0] + [cell.rim_gain for cell in cells], np.float32),
        filling=("air", *(cell.filling for cell in cells)),
        down=down,
    )


def contents_of_field(sample: Sample, field: Field) -> Contents:
    """Return the contents of the cells of three-dimensional bone; those of one number look alike in every recording."""
    n = len(field.level_mm) - 1
    rng = generator(sample.bore_seed, Stage.WALL, CELLS_STREAM)
    lined, bright, albedo, gain = rng.random((4, n))
    lined = lined < sample.bore.lining
    lining = np.where(lined, 0.92 + 0.08 * albedo, 0.55 + 0.37 * albedo)
    rim = np.where((bright < 0.2) & ~lined, 0.2 + 0.6 * gain, 0)
    filling = np.where(np.isfinite(field.dust_mm), "dust", np.where(np.isfinite(field.level_mm), "fluid", "air"))
    down = np.tile(field.down, (n + 1, 1))
    down[0] = 0
    return Contents(
        lining=np.append(1.0, lining).astype(np.float32),
        rim_gain=np.append(0.0, rim).astype(np.float32),
        filling=tuple(str(word) for word in filling),
        down=down,
    )


def crossings(
    scene: Scene, origin_mm: Coordinates, direction: Coordinates, start_mm: Coordinates, reach_mm: Coordinates
) -> Crossings:
    """Return what rays meet between ``start_mm`` (n,), where they are in air, and ``reach_mm`` (n,).

    ``origin_mm`` (n, 3) and ``direction`` (n, 3), unit, in the bore frame. Surfaces are exact to 1e-4 mm; bone or air
    thinner than 4 µm along the ray may be missed.
    """
    cell, count = _candidates(scene, origin_mm, direction)
    entry, leaves, again, wet = (np.full(start_mm.shape, math.nan) for _ in range(4))
    owner, dust = np.zeros(start_mm.shape, np.int32), np.zeros(start_mm.shape, np.bool_)
    normal, level = np.full(origin_mm.shape, math.nan), np.zeros(origin_mm.shape)
    # within the least radius of the bore there is only air
    inmost = _at_radius(scene.grid.radius_mm + scene.least_mm, origin_mm, direction)
    start, reach = np.maximum(start_mm, inmost).astype(np.float32), reach_mm.astype(np.float32)
    for block, k in _blocks(count):
        rays = near(scene.cells, cell[block, :k], origin_mm[block], direction[block], np.float32)
        bore = _BoreAlong.through(scene, origin_mm[block], direction[block])
        hit = first_solid(scene.cells, rays, bore, start[block], reach[block])
        met = np.flatnonzero(np.isfinite(hit))
        which, hit, rays, bore = block[met], hit[met], rays.of(met), bore.of(met)
        entry[which] = hit
        owner[which], dust[which] = bore.owner(hit) if scene.field else owner_of(scene.cells, rays, bore, hit)
        normal[which] = _normal(scene, rays, bore, hit)
        level[which] = scene.contents.down[owner[which]]
        if k or scene.field:
            limit = reach[which]
            if scene.field:
                wet[which] = bore.fluid(owner[which], hit)
            else:
                wet[which] = first_fluid(scene.cells, rays, start[which], hit)
            out = first_air(scene.cells, rays, bore, hit, np.minimum(hit + np.float32(SEPTUM_MM), limit))
            back = first_solid(scene.cells, rays, bore, out + np.float32(STEP_MM / 2), limit)
            leaves[which] = np.where(np.isfinite(back), out, math.nan)
            again[which] = back
    return Crossings(entry, leaves, again, wet, owner, dust, normal, level)


def _candidates(scene: Scene, origin: Numbers, heading: Numbers) -> tuple[Indices, Indices]:
    """Return the cells that rays may meet, (n, k), filled up with the empty one, and how many there are, (n,)."""
    cells, nothing, n = scene.cells, len(scene.cells) - 1, len(origin)
    wall = _at_radius(scene.grid.radius_mm, origin, heading)
    x, y = (origin[:, axis] + wall * heading[:, axis] for axis in range(2))
    margin = cells.reach + cells.edge + 1e-3
    may = np.zeros((n, nothing), np.bool_)
    some = max(1, BLOCK // max(1, nothing))
    for first in range(0, n, some):
        part = slice(first, first + some)
        start, towards = origin[part].astype(np.float32), heading[part].astype(np.float32)
        centre, outward, widest = (values[:-1].astype(np.float32) for values in (cells.centre, cells.outward, margin))
        away = [centre[None, :, axis] - start[:, axis, None] for axis in range(3)]
        along = sum(away[axis] * towards[:, axis, None] for axis in range(3))
        apart = sum((away[axis] - along * towards[:, axis, None]) ** 2 for axis in range(3))
        own_side = (
            x[part, None].astype(np.float32) * outward[None, :, 0]
            + y[part, None].astype(np.float32) * outward[None, :, 1]
        )
        may[part] = (apart < widest * widest) & (own_side > OWN_SIDE * scene.grid.radius_mm)
    ray, number = np.nonzero(may)
    count = np.bincount(ray, minlength=n)
    rank = np.arange(len(ray)) - (np.cumsum(count) - count)[ray]
    some_cells = np.full((n, int(count.max()) if n else 0), nothing)
    some_cells[ray, rank] = number
    return some_cells, count


def _at_radius(radius_mm: float, origin: Numbers, heading: Numbers) -> Numbers:
    """Return the distance along each ray at which it leaves ``radius_mm`` about the axis; 0 where it never does."""
    x, y, dx, dy = origin[:, 0], origin[:, 1], heading[:, 0], heading[:, 1]
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius_mm**2
    return np.where(b * b > a * c, (np.sqrt(np.maximum(b * b - a * c, 0)) - b) / np.maximum(a, 1e-12), 0)


def _blocks(count: Indices) -> list[tuple[Indices, int]]:
    """Return the rays in blocks; all rays of a block have the same number of cells."""
    blocks = []
    for k in range(int(count.max(initial=-1)) + 1):
        which, size = np.flatnonzero(count == k), BLOCK // max(1, k)
        blocks += [(which[first : first + size], k) for first in range(0, which.size, size)]
    return blocks


@dataclass(frozen=True, eq=False)
class _BoreAlong:
    """The bore along scattered rays, float32: where they start, and their direction."""

    scene: Scene
    x: Numbers
    y: Numbers
    z: Numbers
    dx: Numbers
    dy: Numbers
    dz: Numbers

    @classmethod
    def through(cls, scene: Scene, origin: Numbers, heading: Numbers) -> "_BoreAlong":
        return cls(scene, *np.ascontiguousarray(origin.T, np.float32), *np.ascontiguousarray(heading.T, np.float32))

    def of(self, which: Indices) -> "_BoreAlong":
        parts = self.x, self.y, self.z, self.dx, self.dy, self.dz
        return _BoreAlong(self.scene, *(values.take(which) for values in parts))

    def at(self, t: Numbers) -> tuple[Numbers, Numbers]:
        x, y, z = self._places(t)
        r = np.maximum(np.sqrt(x * x + y * y), 1e-9)
        outwards = (x * self.dx + y * self.dy) / r
        aside = np.sqrt(np.maximum(1 - outwards * outwards, 0))
        clear = _displacement(self.scene, z, azimuth(x / r, y / r)) + (self.scene.grid.radius_mm - r)
        falls = 1 + self.scene.steepest * aside
        if self.scene.field is None:
            return clear, falls
        return joined_with_bore(clear, self.scene.field.clear_mm(x, y, z)), np.maximum(falls, STEEPEST)

    def owner(self, t: Numbers) -> tuple[NDArray[np.int32], Mask]:
        """Return the cell of the field whose surface is at ``t`` (n,), 0 for the bore's, and whether it is dust."""
        field = self._field
        x, y, z = self._places(t)
        clear = field.clear_mm(x, y, z)
        r = np.maximum(np.sqrt(x * x + y * y), 1e-9)
        of_cell = clear > _displacement(self.scene, z, azimuth(x / r, y / r)) + (self.scene.grid.radius_mm - r)
        number = np.where(of_cell, field.cell_at(x, y, z), 0).astype(np.int32)
        if not field.dusty:
            return number, np.zeros(t.shape, np.bool_)
        return number, (number > 0) & (field.above_dust_mm(x, y, z) < field.air_mm(x, y, z))

    def fluid(self, cell: NDArray[np.int32], t: Numbers) -> Numbers:
        """Return where rays that end at ``t`` (n,) in ``cell`` (n,) enter its fluid, NaN where they do not."""
        return self._field.fluid_mm(cell, self._places(np.zeros_like(t)), (self.dx, self.dy, self.dz), t)

    @property
    def _field(self) -> Field:
        if self.scene.field is None:
            raise TypeError("this bone has no field")
        return self.scene.field

    def _places(self, t: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        return self.x + t * self.dx, self.y + t * self.dy, self.z + t * self.dz

    def shifted(self, axis: int, way_mm: float) -> "_BoreAlong":
        name = "xyz"[axis]
        return replace(self, **{name: getattr(self, name) + way_mm})


def _displacement(scene: Scene, z: Numbers, theta: Numbers) -> Numbers:
    """Return the bore's displacement, bilinear, cyclic in θ, continued beyond the ends of z."""
    n_z, n_columns = scene.displacement.shape
    n_theta = n_columns - 2
    row = np.clip(z * (1 / scene.grid.dz_mm), 0, n_z - 1)
    column = theta * (n_theta / (2 * math.pi))
    column += n_theta * (column < 0)
    top, left = np.minimum(np.floor(row), max(0, n_z - 2)), np.floor(column)
    down, right = row - top, column - left
    above = top.astype(np.intp) * n_columns + left.astype(np.intp)
    below = above + (n_columns if n_z > 1 else 0)
    upper, lower = (
        (first := scene.displacement.take(place)) + right * (scene.displacement.take(place + 1) - first)
        for place in (above, below)
    )
    displacement: Numbers = upper + down * (lower - upper)
    return displacement


def _normal(scene: Scene, rays: Near, bore: _BoreAlong, t: Numbers) -> Numbers:
    """Return the unit normal (n, 3), from bone into air, of the surface at ``t`` (n,)."""
    slopes = []
    for axis in range(3):
        moved = []
        for way in (NORMAL_MM, -NORMAL_MM):
            clear = bore.shifted(axis, way).at(t)[0]
            if rays.cell.shape[1]:
                cells = clearance(scene.cells.inverse, _moved_along(scene, rays, axis, way), t).air_mm
                clear = joined(clear, cells, rays.edge)
            moved.append(clear)
        slopes.append(moved[0] - moved[1])
    gradient = np.stack(slopes, axis=1)
    normal: Numbers = gradient / np.maximum(np.sqrt(np.sum(gradient * gradient, axis=1)), 1e-12)[:, None]
    return normal


def _moved_along(scene: Scene, rays: Near, axis: int, way_mm: float) -> Near:
    """Return the rays moved along one of the axes."""
    u, v, w = (way_mm * scene.cells.axes[:, row, axis].astype(rays.power.dtype)[rays.cell] for row in range(3))
    return replace(rays, u=rays.u + u, v=rays.v + v, w=rays.w + w)
