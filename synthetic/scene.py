"""The bone: air in a bore and in its cells, as clearances from which rays can be traced, on the CPU or a GPU.

The clearance of a place is its distance to the nearest surface, > 0 in air. That of the bore is R + displacement − r;
that of a cell is :mod:`endoct.synthetic.cavity`'s; :mod:`endoct.synthetic.tracing` joins them and follows the rays.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from endoct.stitching.arrays import Coordinates, Mask
from endoct.synthetic.cavity import OWN_SIDE, Cavities, Near, azimuth, cavities, clearance, near
from endoct.synthetic.parameters import Sample
from endoct.synthetic.relief import BoreRelief, WallGrid, bore_relief, wall_grid
from endoct.synthetic.tracing import BLOCK, STEP_MM, first_air, first_fluid, first_solid, joined, owner_of

SEPTUM_MM = 0.4
NORMAL_MM = 0.002


@dataclass(frozen=True, eq=False)
class Scene:
    """The bone of one sample.

    ``relief``: of the bore without cells, on ``grid``; ``cells``: the cavities; ``displacement`` (n_z, n_theta + 2):
    that relief as a tensor, its first columns once more at the end; ``steepest``: the largest of its slopes;
    ``least_mm``: the least of its values.
    """

    grid: WallGrid
    relief: BoreRelief
    cells: Cavities
    displacement: Tensor
    steepest: float
    least_mm: float

    @property
    def device(self) -> torch.device:
        """Where its tensors are."""
        return self.displacement.device


@dataclass(frozen=True, eq=False)
class Crossings:
    """What n rays meet, all along the ray in mm from its origin, float64 (n,), NaN where there is nothing.

    ``entry_mm``: the first solid surface, bone or dust; ``exit_mm``, ``reentry_mm``: where a septum thinner than
    0.4 mm is left and bone met again; ``fluid_mm``: where the ray enters fluid before the entry; ``cell`` int32: 1 +
    index of the cavity whose surface the entry is on, 0 on the bore's own wall; ``dust``: the entry is on bone dust;
    ``normal`` (n, 3): unit, from bone into air at the entry.
    """

    entry_mm: Coordinates
    exit_mm: Coordinates
    reentry_mm: Coordinates
    fluid_mm: Coordinates
    cell: NDArray[np.int32]
    dust: Mask
    normal: Coordinates


def build_scene(sample: Sample, device: str = "cpu", workers: int = 1) -> Scene:
    """Return the bone that ``sample`` describes, its tensors on ``device``, made by ``workers`` threads."""
    grid, relief = wall_grid(sample), bore_relief(sample, workers)
    along = np.abs(np.diff(relief.displacement_mm, axis=0)).max(initial=0) / grid.dz_mm
    around = np.abs(np.diff(relief.displacement_mm, axis=1)).max(initial=0) / grid.dtheta_mm
    return Scene(
        grid=grid,
        relief=relief,
        cells=cavities(sample.bore.cells, grid.radius_mm, device),
        displacement=torch.as_tensor(np.pad(relief.displacement_mm, ((0, 0), (0, 2)), mode="wrap"), device=device),
        steepest=float(np.hypot(along, around)),
        least_mm=float(relief.displacement_mm.min()),
    )


@torch.inference_mode()
def crossings(
    scene: Scene, origin_mm: Coordinates, direction: Coordinates, start_mm: Coordinates, reach_mm: Coordinates
) -> Crossings:
    """Return what rays meet between ``start_mm`` (n,), where they are in air, and ``reach_mm`` (n,).

    ``origin_mm`` (n, 3) and ``direction`` (n, 3), unit, in the bore frame. Surfaces are found to 1e-4 mm; bone or air
    thinner than 4 µm along the ray may be missed.
    """
    origin, heading, start, reach = (
        torch.as_tensor(np.ascontiguousarray(a, dtype=np.float64), device=scene.device)
        for a in (origin_mm, direction, start_mm, reach_mm)
    )
    cell, count = _candidates(scene, origin, heading)
    entry, leaves, again, wet = (torch.full_like(start, math.nan) for _ in range(4))
    owner, dust = torch.zeros_like(start, dtype=torch.int32), torch.zeros_like(start, dtype=torch.bool)
    normal = torch.full_like(origin, math.nan)
    # within the least radius of the bore there is only air
    start = torch.maximum(start, _at_radius(scene.grid.radius_mm + scene.least_mm, origin, heading)).to(torch.float32)
    reach = reach.to(torch.float32)
    for block, k in _blocks(count):
        rays = near(scene.cells, cell[block, :k], origin[block], heading[block], torch.float32)
        bore = _BoreAlong.through(scene, origin[block], heading[block])
        hit = first_solid(scene.cells, rays, bore, start[block], reach[block])
        met = torch.nonzero(torch.isfinite(hit))[:, 0]
        which, hit, rays, bore = block[met], hit[met], rays.of(met), bore.of(met)
        entry[which] = hit.double()
        owner[which], dust[which] = owner_of(scene.cells, rays, bore, hit)
        normal[which] = _normal(scene, rays, bore, hit).double()
        if k:
            limit = reach[which]
            wet[which] = first_fluid(scene.cells, rays, start[which], hit).double()
            out = first_air(scene.cells, rays, bore, hit, torch.minimum(hit + SEPTUM_MM, limit))
            back = first_solid(scene.cells, rays, bore, out + STEP_MM / 2, limit)
            leaves[which] = torch.where(torch.isfinite(back), out, math.nan).double()
            again[which] = back.double()
    return Crossings(*(values.cpu().numpy() for values in (entry, leaves, again, wet, owner, dust, normal)))


def _candidates(scene: Scene, origin: Tensor, heading: Tensor) -> tuple[Tensor, Tensor]:
    """Return the cells that rays may meet, int64 (n, k) ending in the empty one, and how many, int64 (n,)."""
    cells, nothing, n = scene.cells, len(scene.cells) - 1, len(origin)
    wall = _at_radius(scene.grid.radius_mm, origin, heading)
    x, y = (origin[:, axis] + wall * heading[:, axis] for axis in range(2))
    margin = cells.reach + cells.edge + 1e-3
    may = torch.zeros((n, nothing), dtype=torch.bool, device=scene.device)
    some = max(1, BLOCK // max(1, nothing))
    for first in range(0, n, some):
        part = slice(first, first + some)
        start, towards = origin[part].to(torch.float32), heading[part].to(torch.float32)
        centre, outward, widest = (values[:-1].to(torch.float32) for values in (cells.centre, cells.outward, margin))
        away = [centre[None, :, axis] - start[:, axis, None] for axis in range(3)]
        along = sum(away[axis] * towards[:, axis, None] for axis in range(3))
        apart = sum((away[axis] - along * towards[:, axis, None]) ** 2 for axis in range(3))
        own_side = x[part, None].float() * outward[None, :, 0] + y[part, None].float() * outward[None, :, 1]
        may[part] = (apart < widest * widest) & (own_side > OWN_SIDE * scene.grid.radius_mm)
    ray, number = torch.nonzero(may, as_tuple=True)
    count = torch.bincount(ray, minlength=n)
    rank = torch.arange(len(ray), device=scene.device) - (count.cumsum(0) - count)[ray]
    chosen = torch.full((n, int(count.max()) if n else 0), nothing, device=scene.device)
    chosen[ray, rank] = number
    return chosen, count


def _at_radius(radius_mm: float, origin: Tensor, heading: Tensor) -> Tensor:
    """Return how far along the ray it is ``radius_mm`` from the axis, going out; 0 where it never is."""
    x, y, dx, dy = origin[:, 0], origin[:, 1], heading[:, 0], heading[:, 1]
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius_mm**2
    return torch.nan_to_num((-b + torch.sqrt(b * b - a * c)) / a, nan=0.0, posinf=0.0, neginf=0.0)


def _blocks(count: Tensor) -> list[tuple[Tensor, int]]:
    """Return the rays in blocks of one number of cells each."""
    blocks = []
    for k in range(int(count.max()) + 1 if len(count) else 0):
        which = torch.nonzero(count == k)[:, 0]
        blocks += [(block, k) for block in torch.split(which, BLOCK // max(1, k)) if len(block)]
    return blocks


@dataclass(frozen=True, eq=False)
class _BoreAlong:
    """The bore along scattered rays, float32: where they start, and their direction."""

    scene: Scene
    x: Tensor
    y: Tensor
    z: Tensor
    dx: Tensor
    dy: Tensor
    dz: Tensor

    @classmethod
    def through(cls, scene: Scene, origin: Tensor, heading: Tensor) -> "_BoreAlong":
        return cls(scene, *origin.to(torch.float32).unbind(1), *heading.to(torch.float32).unbind(1))

    def of(self, which: Tensor) -> "_BoreAlong":
        parts = self.x, self.y, self.z, self.dx, self.dy, self.dz
        return _BoreAlong(self.scene, *(values.index_select(0, which) for values in parts))

    def at(self, t: Tensor) -> tuple[Tensor, Tensor]:
        x, y, z = self.x + t * self.dx, self.y + t * self.dy, self.z + t * self.dz
        r = torch.sqrt(x * x + y * y).clamp_min(1e-9)
        outwards = (x * self.dx + y * self.dy) / r
        aside = torch.sqrt((1 - outwards * outwards).clamp_min(0))
        clear = _displacement(self.scene, z, azimuth(x, y)) + (self.scene.grid.radius_mm - r)
        return clear, 1 + self.scene.steepest * aside

    def beside(self, axis: int, way_mm: float) -> "_BoreAlong":
        name = "xyz"[axis]
        return replace(self, **{name: getattr(self, name) + way_mm})


def _displacement(scene: Scene, z: Tensor, theta: Tensor) -> Tensor:
    """Return the bore's displacement, bilinear, cyclic in θ, continued beyond the ends of z."""
    n_z, n_columns = scene.displacement.shape
    n_theta = n_columns - 2
    row = (z * (1 / scene.grid.dz_mm)).clamp(0, n_z - 1)
    column = theta * (n_theta / (2 * math.pi))
    column = column + n_theta * (column < 0)
    top, left = row.floor().clamp_max(max(0, n_z - 2)), column.floor()
    down, right = row - top, column - left
    above = top.long() * n_columns + left.long()
    below = above + (n_columns if n_z > 1 else 0)
    upper, lower = (
        (first := torch.take(scene.displacement, place)) + right * (torch.take(scene.displacement, place + 1) - first)
        for place in (above, below)
    )
    return upper + down * (lower - upper)


def _normal(scene: Scene, rays: Near, bore: _BoreAlong, t: Tensor) -> Tensor:
    """Return the unit normal (n, 3), from bone into air, of the surface at ``t`` (n,)."""
    slopes = []
    for axis in range(3):
        moved = []
        for way in (NORMAL_MM, -NORMAL_MM):
            clear = bore.beside(axis, way).at(t)[0]
            if rays.cell.shape[1]:
                cells = clearance(scene.cells.inverse, _beside(scene, rays, axis, way), t).air_mm
                clear = joined(clear, cells, rays.edge)
            moved.append(clear)
        slopes.append(moved[0] - moved[1])
    gradient = torch.stack(slopes, 1)
    square = sum(slope * slope for slope in slopes)
    return gradient / torch.sqrt(torch.as_tensor(square))[:, None].clamp_min(1e-12)


def _beside(scene: Scene, rays: Near, axis: int, way_mm: float) -> Near:
    """Return the rays moved along one of the axes."""
    u, v, w = (way_mm * scene.cells.axes[:, row, axis].to(rays.power.dtype)[rays.cell] for row in range(3))
    return replace(rays, u=rays.u + u, v=rays.v + v, w=rays.w + w)
