"""The bone: air in a bore and in its cells, as clearances from which rays can be traced, on the CPU or a GPU.

The clearance of a place is its distance to the nearest surface, > 0 in air. That of the bore is R + displacement − r;
that of a cell is :mod:`endoct.synthetic.cavity`'s; bore and cell are joined by a polynomial smooth maximum over the
cell's ``edge_mm``, which adds at most a quarter of it. Rays step by what no surface can be nearer than, but at least
``STEP_MM``, within which the surface is then found by the secant rule.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from endoct.stitching.arrays import Coordinates, Mask
from endoct.synthetic.cavity import OWN_SIDE, Cavities, Near, cavities, clearance, in_one_thread, near
from endoct.synthetic.parameters import Sample
from endoct.synthetic.relief import BoreRelief, WallGrid, bore_relief, wall_grid

STEP_MM = 0.004
SEPTUM_MM = 0.4
SECANTS = 3
NORMAL_MM = 0.002
BLOCK = 32_000  # pairs of a ray and a cell traced at once: what fits a cache, and what torch leaves to one thread

BoreAlong = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True, eq=False)
class Scene:
    """The bone of one sample.

    ``relief``: of the bore without cells, on ``grid``; ``cells``: the cavities; ``displacement`` (n_z, n_theta):
    that relief as a tensor; ``steepest``: the largest of its slopes; ``least_mm``: the least of its values.
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


def build_scene(sample: Sample, device: str = "cpu") -> Scene:
    """Return the bone that ``sample`` describes, its tensors on ``device``."""
    grid, relief = wall_grid(sample), bore_relief(sample)
    along = np.abs(np.diff(relief.displacement_mm, axis=0)).max(initial=0) / grid.dz_mm
    around = np.abs(np.diff(relief.displacement_mm, axis=1)).max(initial=0) / grid.dtheta_mm
    return Scene(
        grid=grid,
        relief=relief,
        cells=cavities(sample.bore.cells, grid.radius_mm, device),
        displacement=torch.as_tensor(relief.displacement_mm, device=device),
        steepest=float(np.hypot(along, around)),
        least_mm=float(relief.displacement_mm.min()),
    )


@in_one_thread
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
    for which, k in _blocks(count):
        rays = near(scene.cells, cell[which, :k], origin[which], heading[which], torch.float64)
        bore = _bore_along(scene, origin[which], heading[which])
        limit = reach[which]
        # within the least radius of the bore there is only air
        inner = _at_radius(scene.grid.radius_mm + scene.least_mm, origin[which], heading[which])
        hit = first_solid(scene, rays, bore, torch.maximum(start[which], inner), limit)
        entry[which] = hit
        met = torch.isfinite(hit)
        if not met.any():
            continue
        number, on_dust = owner_of(scene, rays, bore, torch.where(met, hit, start[which]))
        owner[which], dust[which] = torch.where(met, number, 0), met & on_dust
        wet[which] = first_fluid(scene, rays, start[which], torch.where(met, hit, limit))
        normal[which] = torch.where(met[:, None], _normal(scene, rays, origin[which], heading[which], hit), math.nan)
        if count[which].any():
            out = _first_air(scene, rays, bore, hit, torch.minimum(hit + SEPTUM_MM, limit))
            back = first_solid(scene, rays, bore, out + STEP_MM / 2, limit)
            leaves[which] = torch.where(torch.isfinite(back), out, math.nan)
            again[which] = back
    return Crossings(*(values.cpu().numpy() for values in (entry, leaves, again, wet, owner, dust, normal)))


def _candidates(scene: Scene, origin: Tensor, heading: Tensor) -> tuple[Tensor, Tensor]:
    """Return the cells that rays may meet, int64 (n, k) ending in the empty one, and how many, int64 (n,)."""
    cells, nothing = scene.cells, len(scene.cells) - 1
    wall = _at_radius(scene.grid.radius_mm, origin, heading)
    hits = [origin[:, axis] + wall * heading[:, axis] for axis in range(3)]
    margin = cells.reach + cells.edge + 1e-3
    low = torch.minimum(hits[2], origin[:, 2]).min() if len(origin) else torch.zeros(())
    high = torch.maximum(hits[2], origin[:, 2]).max() if len(origin) else torch.zeros(())
    slope = float(heading[:, 2].abs().max()) if len(origin) else 0.0
    # beyond the wall a ray goes on along z as it points
    room = margin + 4 * slope
    window = torch.nonzero((cells.centre[:-1, 2] > low - room[:-1]) & (cells.centre[:-1, 2] < high + room[:-1]))[:, 0]
    if not len(window):
        return torch.full((len(origin), 1), nothing, device=scene.device), torch.zeros(
            len(origin), dtype=torch.int64, device=scene.device
        )
    centre, outward = cells.centre[window], cells.outward[window]
    away = [centre[None, :, axis] - origin[:, axis, None] for axis in range(3)]
    along = sum(away[axis] * heading[:, axis, None] for axis in range(3))
    apart = sum((away[axis] - along * heading[:, axis, None]) ** 2 for axis in range(3))
    own_side = sum(hits[axis][:, None] * outward[None, :, axis] for axis in range(2)) > OWN_SIDE * scene.grid.radius_mm
    may = (apart < margin[window] ** 2) & own_side
    count = may.to(torch.int64).cumsum(1)[:, -1]
    most = max(1, int(count.max()) if len(origin) else 1)
    chosen = torch.sort(may.to(torch.int8), dim=1, descending=True, stable=True)[1][:, :most]
    return torch.where(may.gather(1, chosen), window[chosen], nothing), count


def _at_radius(radius_mm: float, origin: Tensor, heading: Tensor) -> Tensor:
    """Return how far along the ray it is ``radius_mm`` from the axis, going out; 0 where it never is."""
    x, y, dx, dy = origin[:, 0], origin[:, 1], heading[:, 0], heading[:, 1]
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius_mm**2
    return torch.nan_to_num((-b + torch.sqrt(b * b - a * c)) / a, nan=0.0, posinf=0.0, neginf=0.0)


def _blocks(count: Tensor) -> list[tuple[Tensor, int]]:
    """Return the rays in blocks of a number of cells each, few rays with many cells or many with few."""
    order = torch.sort(count, stable=True)[1]
    blocks, first = [], 0
    while first < len(order):
        last = min(len(order), first + BLOCK)
        last = min(last, first + max(1, BLOCK // max(1, int(count[order[last - 1]]))))
        blocks.append((order[first:last], max(1, int(count[order[last - 1]]))))
        first = last
    return blocks


def _bore_along(scene: Scene, origin: Tensor, heading: Tensor) -> BoreAlong:
    """Return the bore's clearance along scattered rays, and the largest rate at which it can fall."""

    def bore(which: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
        start, d = origin[which], heading[which]
        x, y, z = (start[:, axis] + t * d[:, axis] for axis in range(3))
        r = torch.hypot(x, y)
        outwards = (x * d[:, 0] + y * d[:, 1]) / r.clamp_min(1e-9)
        aside = torch.sqrt((1 - outwards * outwards).clamp_min(0))
        clear = scene.grid.radius_mm + _displacement(scene, z, torch.atan2(y, x)) - r
        return clear, 1 + scene.steepest * aside

    return bore


def _displacement(scene: Scene, z: Tensor, theta: Tensor) -> Tensor:
    """Return the bore's displacement, bilinear, cyclic in θ, continued beyond the ends of z."""
    n_z, n_theta = scene.displacement.shape
    row = (z / scene.grid.dz_mm).clamp(0, n_z - 1)
    column = theta * (n_theta / (2 * math.pi))
    top, left = row.floor().clamp(0, max(0, n_z - 2)), column.floor()
    down, right = row - top, column - left
    first = left.long() % n_theta
    second = (first + 1) % n_theta
    flat = scene.displacement.view(-1)
    upper = top.long() * n_theta
    lower = (top.long() + 1).clamp_max(n_z - 1) * n_theta
    above = flat[upper + first] * (1 - right) + flat[upper + second] * right
    below = flat[lower + first] * (1 - right) + flat[lower + second] * right
    return above * (1 - down) + below * down


def joined(bore_mm: Tensor, cells_mm: Tensor, edge_mm: Tensor) -> Tensor:
    """Return the clearance of bore (n,) and cells (n, k) together, (n,): rounded at rims, sharp between cells."""
    bore = bore_mm[:, None]
    blend = (edge_mm - (bore - cells_mm).abs()).clamp_min(0)
    return (torch.maximum(bore, cells_mm) + blend * blend / (4 * edge_mm)).amax(1)


def _table(scene: Scene, rays: Near) -> Tensor:
    return scene.cells.inverse.to(rays.power.dtype)


def first_solid(scene: Scene, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays that are in air at ``start`` (n,) first meet a surface, NaN beyond ``limit`` (n,)."""
    return _first_crossing(scene, rays, bore, start, limit, 1)


def _first_air(scene: Scene, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays that are in bone at ``start`` first leave it, NaN beyond ``limit``."""
    return _first_crossing(scene, rays, bore, start + STEP_MM / 2, limit, -1)


def _first_crossing(scene: Scene, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor, sign: int) -> Tensor:
    """Return where sign·clearance of rays first falls to 0 between ``start`` and ``limit``, NaN where it does not."""
    table = _table(scene, rays)
    found = torch.full_like(start, math.nan)
    which = torch.nonzero(start <= limit)[:, 0]
    part, t, stop = rays.of(which), start[which], limit[which]
    last, last_clear = t, torch.zeros_like(t)
    ends: list[tuple[Tensor, ...]] = []
    while len(which):
        cells = clearance(table, part, t)
        bore_mm, falls = bore(which, t)
        clear = joined(bore_mm, cells.air_mm, part.edge)
        done = sign * clear <= 0
        if sign > 0:
            step = torch.maximum(bore_mm / falls, cells.step_mm.amax(1))
            # in the rounding of a rim neither bore nor cell, only their joint clearance is positive
            step = torch.where(step > 0, step, 0.5 * clear)
        else:
            step = (-cells.step_mm).amin(1)
            near_rim = bore_mm > -2 * part.edge.amax(1)
            step = torch.where(near_rim, torch.minimum(step, -0.5 * clear), step)
        ahead = t + step.clamp_min(STEP_MM)
        on = ~done & (ahead < stop)
        if bool(on.all()):
            last, last_clear, t = t, clear, ahead
            continue
        met = torch.nonzero(done)[:, 0]
        ends.append((which[met], last[met], last_clear[met], t[met], clear[met]))
        kept = torch.nonzero(on)[:, 0]
        last, last_clear, t = t[kept], clear[kept], ahead[kept]
        which, part, stop = which[kept], part.of(kept), stop[kept]
    if ends:
        at, low, low_clear, high, high_clear = (torch.cat(parts) for parts in zip(*ends, strict=True))
        found[at] = _between(table, rays.of(at), bore, at, low, low_clear, high, high_clear)
    return found


def _between(
    table: Tensor,
    rays: Near,
    bore: BoreAlong,
    which: Tensor,
    low: Tensor,
    at_low: Tensor,
    high: Tensor,
    at_high: Tensor,
) -> Tensor:
    """Return where the clearance is 0 between ``low`` and ``high``, where its signs differ, by the secant rule."""
    for last in range(SECANTS):
        fall = at_low - at_high
        share = torch.where(fall == 0, 1.0, at_low / torch.where(fall == 0, 1.0, fall)).clamp(0, 1)
        middle = low + share * (high - low)
        if last == SECANTS - 1:
            break
        clear = joined(bore(which, middle)[0], clearance(table, rays, middle).air_mm, rays.edge)
        same = torch.sign(clear) == torch.sign(at_low)
        low, at_low = torch.where(same, middle, low), torch.where(same, clear, at_low)
        high, at_high = torch.where(same, high, middle), torch.where(same, at_high, clear)
    return middle


def owner_of(scene: Scene, rays: Near, bore: BoreAlong, t: Tensor) -> tuple[Tensor, Tensor]:
    """Return 1 + index of the cavity whose surface is at ``t`` (n,), 0 for the bore's, and whether it is dust."""
    cells = clearance(_table(scene, rays), rays, t)
    nearest, slot = cells.air_mm.max(1)
    of_cell = nearest > bore(torch.arange(len(t), device=t.device), t)[0]
    number = torch.where(of_cell, rays.cell.gather(1, slot[:, None])[:, 0] + 1, 0).to(torch.int32)
    if cells.in_dust is None:
        return number, torch.zeros_like(of_cell)
    return number, of_cell & cells.in_dust.gather(1, slot[:, None])[:, 0]


def first_fluid(scene: Scene, rays: Near, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays enter fluid between ``start`` and ``limit`` (n,), NaN where they do not."""
    surface = scene.cells.fluid[rays.cell].to(rays.power.dtype)
    found = torch.full_like(start, math.inf)
    table = _table(scene, rays)
    for slot in range(rays.cell.shape[1]):
        which = torch.nonzero(torch.isfinite(surface[:, slot]))[:, 0]
        if not len(which):
            continue
        one = rays.of(which).alone(slot)
        sinks = one.dw[:, 0] * one.along[:, 0]
        plane = (surface[which, slot] - one.bulge[:, 0] - one.w[:, 0] * one.along[:, 0]) / sinks
        below = sinks > 0
        t = torch.where(below, torch.maximum(plane, start[which]), start[which])
        stop = torch.where(below, limit[which], torch.minimum(plane, limit[which]))
        while len(which):
            step = clearance(table, one, t).step_mm[:, 0]
            inside = (step > 0) & (t < stop)
            found[which[inside]] = torch.minimum(found[which[inside]], t[inside])
            on = ~inside & (t < stop)
            which, t, stop, one = (
                which[on],
                (t + (-step).clamp_min(STEP_MM))[on],
                stop[on],
                one.of(torch.nonzero(on)[:, 0]),
            )
    return torch.where(torch.isfinite(found), found, math.nan)


def _normal(scene: Scene, rays: Near, origin: Tensor, heading: Tensor, t: Tensor) -> Tensor:
    """Return the unit normal (n, 3), from bone into air, of the surface at ``t`` (n,)."""
    table = _table(scene, rays)
    everywhere = torch.arange(len(t), device=t.device)
    slopes = []
    for axis in range(3):
        moved = []
        for way in (NORMAL_MM, -NORMAL_MM):
            start = origin.clone()
            start[:, axis] += way
            beside = _beside(scene, rays, axis, way)
            bore = _bore_along(scene, start, heading)(everywhere, t)[0]
            moved.append(joined(bore, clearance(table, beside, t).air_mm, rays.edge))
        slopes.append(moved[0] - moved[1])
    gradient = torch.stack(slopes, 1)
    return gradient / torch.sqrt(_square(gradient))[:, None].clamp_min(1e-12)


def _square(vector: Tensor) -> Tensor:
    return vector[:, 0] * vector[:, 0] + vector[:, 1] * vector[:, 1] + vector[:, 2] * vector[:, 2]


def _beside(scene: Scene, rays: Near, axis: int, way_mm: float) -> Near:
    """Return the rays moved along one of the axes."""
    u, v, w = (way_mm * scene.cells.axes[:, row, axis].to(rays.power.dtype)[rays.cell] for row in range(3))
    return replace(rays, u=rays.u + u, v=rays.v + v, w=rays.w + w)
