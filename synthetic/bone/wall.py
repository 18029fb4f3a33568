"""The bore's wall: its relief, its cells, and what both instruments need to know of its surface.

The maps are baked: rays are traced radially through the nodes that cells can reach, those that only one cell reaches
cell by cell; elsewhere the wall is the bore's. What is baked at once stays within ``tracing.BLOCK``. Other processes
may bake parts of it: a node's place does not depend on which others are baked with it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image, Mask
from endoct.stitching.circle import pad_circle
from endoct.stitching.parallel import thread_map
from endoct.synthetic.bone.cavity import Indices, Near, air_mm, covers
from endoct.synthetic.bone.maps import WallMaps
from endoct.synthetic.bone.opening import fan, patch, radial
from endoct.synthetic.bone.relief import BoreRelief, WallGrid, textures
from endoct.synthetic.bone.scene import Scene, build_scene
from endoct.synthetic.bone.tracing import BLOCK, first_fluid, first_solid
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Cell, Sample

DEEPEST_MM = 2.5
OPEN_MM = 0.01  # a cell is open where the first surface lies this much beyond the bore's own wall
RIM_MM = 0.02
SHARE_ELSEWHERE = 2  # of the jobs, for each that this process does: it has more to load and other work besides

Job = tuple[NDArray[np.intp], NDArray[np.int64]]
"""Nodes (n,) to trace together, and the cells at each, (n, k), or (1, 1) where it is the same one."""
Traced = tuple[NDArray[np.intp], tuple[Image, Mask, NDArray[np.int32], Image]]
"""The nodes of a job, and there the relief, whether the wall is missing, the open cell, and wet."""
TracedElsewhere = Sequence[Callable[[], list[Traced]]]
"""Each returns what :func:`part_of_wall` makes of part 0, 1, … of as many, once another process has made it."""


@dataclass(frozen=True, eq=False)
class Wall(WallMaps):
    """The maps, and the ``scene`` they were baked from."""

    scene: Scene

    def maps(self) -> WallMaps:
        """Return the maps alone, without the scene, which takes long to send to another process."""
        return WallMaps(**{field.name: getattr(self, field.name) for field in fields(WallMaps)})


@dataclass(frozen=True, eq=False)
class _Baked:
    """The maps (n_z, n_θ) that tracing gives, and those of the cells' inside and rims."""

    relief_mm: Image
    cell: Mask
    cell_id: NDArray[np.int32]
    wet: Image


def build_wall(sample: Sample, workers: int = 1, elsewhere: TracedElsewhere = ()) -> Wall:
    """Return the wall that ``sample`` describes, made by ``workers`` threads, and in part ``elsewhere``.

    Neither changes the wall.
    """
    scene = build_scene(sample, workers=workers)
    grid, bore = scene.grid, sample.bore
    baked = _bake(scene, bore.cells, workers, elsewhere)
    relief = baked.relief_mm
    slope_theta = np.empty_like(relief)
    slope_theta[:, 1:-1] = relief[:, 2:] - relief[:, :-2]
    slope_theta[:, 0] = relief[:, 1] - relief[:, -1]
    slope_theta[:, -1] = relief[:, 0] - relief[:, -2]
    slope_theta *= np.float32(1 / (2 * grid.dtheta_mm))
    return Wall(
        radius_mm=grid.radius_mm,
        dz_mm=grid.dz_mm,
        relief_mm=relief,
        cell=baked.cell,
        cell_id=baked.cell_id,
        albedo=_albedo(sample, grid, scene.relief, baked, workers),
        rim=_rims(bore.cells, baked, grid),
        slope_z=np.gradient(relief, np.float32(grid.dz_mm), axis=0).astype(np.float32, copy=False),
        slope_theta=slope_theta,
        wet=baked.wet,
        scene=scene,
    )


def part_of_wall(sample: Sample, part: int, parts: int) -> list[Traced]:
    """Return what one of ``parts`` processes that help the one that builds the wall traces of it."""
    scene = build_scene(sample)
    return [_traced(scene, job) for job in _part(_jobs(scene, sample.bore.cells, 1), part, parts)]


def _part(jobs: list[Job], part: int, parts: int) -> list[Job]:
    """Return the jobs of one of ``parts`` processes, or, as part ``parts``, of the one that builds the wall."""
    of = [k // SHARE_ELSEWHERE for k in range(SHARE_ELSEWHERE * parts + 1)]
    return [job for index, job in enumerate(jobs) if of[index % len(of)] == part]


def _albedo(sample: Sample, grid: WallGrid, relief: BoreRelief, baked: _Baked, workers: int) -> Image:
    """Return mottled bone, darkened by smears and in the cells by their lining."""
    bore = sample.bore
    albedo, finer, smears = textures(sample, grid, 4, (0.15, 0.04, 0.25), workers)
    albedo *= 0.6
    albedo += 0.6 * finer
    albedo += 0.5 * relief.fine
    # the drill's mark shows on the wall it has cut, not inside the cells
    albedo += np.where(baked.cell_id > 0, np.float32(0), np.float32(0.5) * relief.grooves)
    albedo *= np.float32(bore.texture)
    albedo += 1
    np.clip(albedo, 0.3, 1.6, out=albedo)
    albedo *= 1 - np.float32(bore.smear) * np.clip((smears - 1.4) / 0.4, 0, 1)
    lining = np.array([1.0] + [cell.lining for cell in bore.cells], np.float32)
    albedo *= lining[baked.cell_id]
    return albedo


def _rims(cells: tuple[Cell, ...], baked: _Baked, grid: WallGrid) -> Image:
    """Return the light added along the outlines of the openings of cells with bright rims."""
    gain = np.array([0.0] + [cell.rim_gain for cell in cells], np.float32)
    if not gain.any():
        return np.zeros_like(baked.relief_mm)
    bright = gain[baked.cell_id]
    sigma_z, sigma_theta = RIM_MM / grid.dz_mm, RIM_MM / grid.dtheta_mm
    pad = math.ceil(4 * sigma_theta)
    wide = pad_circle(bright, pad)
    blurred = cv2.GaussianBlur(wide, (0, 0), sigmaX=sigma_theta, sigmaY=sigma_z)[:, pad:-pad]
    return np.asarray(2 * np.abs(bright - blurred), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class _AlongRadius:
    """The bore along radial rays through nodes of the wall, of which it has that radius."""

    wall_mm: Numbers

    def of(self, which: Indices) -> "_AlongRadius":
        return _AlongRadius(self.wall_mm.take(which))

    def at(self, t: Numbers) -> tuple[Numbers, Numbers]:
        return self.wall_mm - t, np.ones_like(t)


def _bake(scene: Scene, cells: Sequence[Cell], workers: int, elsewhere: TracedElsewhere) -> _Baked:
    """Trace radial rays through the nodes of the wall that cells reach."""
    n_nodes = scene.grid.n_z * scene.grid.n_theta
    relief = scene.relief.displacement_mm.ravel().copy()
    cell = np.zeros(n_nodes, np.bool_)
    cell_id, wet = np.zeros(n_nodes, np.int32), np.zeros(n_nodes, np.float32)
    own = _part(_jobs(scene, cells, workers), len(elsewhere), len(elsewhere))
    by_others = chain.from_iterable(part() for part in elsewhere)
    for nodes, traced in chain(thread_map(partial(_traced, scene), own, workers), by_others):
        relief[nodes], cell[nodes], cell_id[nodes], wet[nodes] = traced
    shape = scene.grid.n_z, scene.grid.n_theta
    return _Baked(relief.reshape(shape), cell.reshape(shape), cell_id.reshape(shape), wet.reshape(shape))


def _jobs(scene: Scene, cells: Sequence[Cell], workers: int) -> list[Job]:
    """Return all nodes to trace."""
    reached = list(thread_map(partial(_reached, scene, cells), range(len(cells)), workers))
    count = np.zeros(scene.grid.n_z * scene.grid.n_theta, np.uint8)
    for nodes in reached:
        count[nodes] += 1
    jobs: list[Job] = []
    shared_nodes, shared_numbers = [np.zeros(0, np.intp)], [np.zeros(0, np.int64)]
    for number, nodes in enumerate(reached):
        alone = count[nodes] == 1
        own = nodes[alone]
        jobs += [(own[i : i + BLOCK], np.array([[number]])) for i in range(0, own.size, BLOCK)]
        shared_nodes.append(nodes[~alone])
        shared_numbers.append(np.full(shared_nodes[-1].size, number))
    node, numbers = np.concatenate(shared_nodes), np.concatenate(shared_numbers)
    order = np.argsort(node, kind="stable")
    node, numbers = node[order], numbers[order]
    for k in range(2, int(count.max(initial=0)) + 1):
        of_k = count[node] == k
        at, here = node[of_k][::k], numbers[of_k].reshape(-1, k)
        jobs += [(at[i : i + BLOCK // k], here[i : i + BLOCK // k]) for i in range(0, at.size, BLOCK // k)]
    return jobs


def _reached(scene: Scene, cells: Sequence[Cell], number: int) -> NDArray[np.intp]:
    """Return the nodes at which a cell's cavity lies behind the wall or has moved it, ascending."""
    grid, displacement = scene.grid, scene.relief.displacement_mm.ravel()
    rows, columns = patch(grid, scene.cells, cells[number], number)
    if not (rows.size and columns.size):
        return np.zeros(0, np.intp)
    every, reached, at_once = fan(grid, scene.cells, rows, columns, number), [], max(1, BLOCK // columns.size)
    for first in range(0, rows.size, at_once):
        part = rows[first : first + at_once]
        row, column = (index.ravel() for index in np.indices((part.size, columns.size)))
        rays, node = every.of(row + first, column), (part[:, None] * grid.n_theta + columns).ravel()
        own = displacement[node] + np.float32(grid.radius_mm)
        near_by = air_mm(scene.cells.inverse, rays, own)[:, 0] > -rays.edge[:, 0]
        reached.append(node[near_by])
    return np.sort(np.concatenate(reached))


def _traced(scene: Scene, job: Job) -> Traced:
    nodes, here = job
    grid = scene.grid
    row, column = np.divmod(nodes, grid.n_theta)
    if here.shape[1] == 1:
        first = int(row[0])
        rows = np.arange(first, int(row[-1]) + 1)
        rays = fan(grid, scene.cells, rows, np.arange(grid.n_theta), int(here[0, 0])).of(row - first, column)
    else:
        rays = radial(grid, scene.cells, row, column, here)
    own = scene.relief.displacement_mm.ravel()[nodes]
    start = own + np.float32(grid.radius_mm)
    limit = np.full_like(start, grid.radius_mm + DEEPEST_MM)
    radius = first_solid(scene.cells, rays, _AlongRadius(start), start, limit)
    radius = np.nan_to_num(radius, nan=grid.radius_mm + DEEPEST_MM)
    at_wall = np.full_like(start, grid.radius_mm)
    open_cells = covers(scene.cells.inverse, rays, at_wall)
    covered, slot = open_cells.any(1), open_cells.argmax(1)
    several = np.flatnonzero(np.count_nonzero(open_cells, axis=1) > 1)
    if len(several):
        slot[several] = _deepest(scene, rays.of(several), open_cells[several], at_wall[several])
    # a rounded rim moves the wall by less than its edge: deeper, the ray has gone into the nearest cavity
    deep = radius - start > rays.edge.max(1)
    slot = np.where(covered, slot, air_mm(scene.cells.inverse, rays, at_wall).argmax(1))
    covered = covered | deep
    number = np.where(covered, rays.numbers(slot), 0).astype(np.int32)
    wet = np.isfinite(first_fluid(scene.cells, rays, start, radius)).astype(np.float32)
    relief = radius - np.float32(grid.radius_mm)
    missing = covered & (relief > np.maximum(own, 0) + np.float32(OPEN_MM))
    return nodes, (relief, missing, number, wet)


def _deepest(scene: Scene, rays: Near, open_cells: Mask, start: Numbers) -> Indices:
    """Return which of a ray's open cells (n, k) reaches deepest, its filling not considered, (n,)."""
    depth = np.zeros(open_cells.shape, start.dtype)
    for slot in range(open_cells.shape[1]):
        which = np.flatnonzero(open_cells[:, slot])
        one, t = replace(rays.of(which).alone(slot), dusty=False), start[which]
        no_bore = _AlongRadius(np.full_like(t, -DEEPEST_MM))
        ends = first_solid(scene.cells, one, no_bore, t, t + np.float32(DEEPEST_MM))
        depth[which, slot] = np.nan_to_num(ends, nan=math.inf)
    return np.asarray(depth.argmax(1))
