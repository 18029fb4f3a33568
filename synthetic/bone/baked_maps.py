"""The maps of a wall that tracing gives: its relief, the cells that open into the bore, and where it is wet.

Rays are traced radially through the nodes that cells can reach; elsewhere the wall is the bore's. Nodes that only one
cell reaches are traced cell by cell. In three-dimensional bone, rays are traced through the nodes that lie in air. What
is traced at once stays within :data:`endoct.synthetic.bone.rays.BLOCK`. Other processes may trace parts of the wall: a
node's place does not depend on which others are traced with it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.synthetic.bone.cavities import Indices, Near, air_mm, cavities, covers, near
from endoct.synthetic.bone.field import EDGE_MM, STEEPEST, Field, joined_with_bore
from endoct.synthetic.bone.rays import BLOCK, fan, first_fluid, first_solid, patch, radial
from endoct.synthetic.bone.scene import Scene, build_scene
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Cell, Sample

DEEPEST_MM = 2.5
OPEN_MM = 0.01
"""A cell is open where the first surface lies this much beyond the bore's own wall."""
SHARE_ELSEWHERE = 2
"""Another process takes so many jobs for each that this one does, which has more to load and other work besides."""
Job = tuple[NDArray[np.intp], NDArray[np.int64]]
"""Nodes (n,) to trace together, and the cells at each, (n, k), or (1, 1) where it is the same one."""
Traced = tuple[NDArray[np.intp], tuple[Image, Mask, NDArray[np.int32], Image]]
"""The nodes of a job, and there the relief, whether the wall is missing, the open cell, and wet."""
TracedElsewhere = Sequence[Callable[[], list[Traced]]]
"""Each returns what :func:`part_of_wall` makes of part 0, 1, … of as many, once another process has made it."""


@dataclass(frozen=True, eq=False)
class _Radial:
    """Bore and field along radial rays through nodes of the wall, (n,) each."""

    field: Field
    wall_mm: Numbers
    cos: Numbers
    sin: Numbers
    z_mm: Numbers

    def of(self, which: Indices) -> "_Radial":
        parts = (values.take(which) for values in (self.wall_mm, self.cos, self.sin, self.z_mm))
        return _Radial(self.field, *parts)

    def at(self, t: Numbers) -> tuple[Numbers, Numbers]:
        clear = joined_with_bore(self.wall_mm - t, self.field.clear_mm(*self.places(t)))
        return clear, np.full_like(t, STEEPEST)

    def places(self, t: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        return t * self.cos, t * self.sin, self.z_mm


def traced_in_field(
    scene: Scene, field: Field, nodes: NDArray[np.intp]
) -> tuple[NDArray[np.intp], tuple[Image, Mask, NDArray[np.int32], Image]]:
    """Return those of ``nodes`` (n,) that lie in air or near it, and the values of the maps there."""
    row, column = np.divmod(nodes, scene.grid.n_theta)
    theta = 2 * math.pi / scene.grid.n_theta * column
    own = scene.relief.displacement_mm.ravel()[nodes]
    bore = _Radial(
        field,
        own + np.float32(scene.grid.radius_mm),
        np.cos(theta).astype(np.float32),
        np.sin(theta).astype(np.float32),
        (scene.grid.dz_mm * row).astype(np.float32),
    )
    near_air = np.flatnonzero(field.air_mm(*bore.places(bore.wall_mm)) > -EDGE_MM)
    nodes, own, bore = nodes[near_air], own[near_air], bore.of(near_air)
    nominal = np.full_like(own, scene.grid.radius_mm)
    limit = nominal + np.float32(DEEPEST_MM)
    met = first_solid(scene.cells, _no_cells(len(nodes)), bore, bore.wall_mm, limit)
    radius = np.nan_to_num(met, nan=scene.grid.radius_mm + DEEPEST_MM)
    at_wall = bore.places(nominal)
    deep = radius - bore.wall_mm > EDGE_MM
    covered = (field.air_mm(*at_wall) > 0) | deep
    # the cell that the ray has gone into, and where it stops at once that of the wall
    inside = np.minimum(nominal + np.float32(field.step_mm), np.maximum(radius, nominal))
    number = np.where(covered, field.cell_at(*bore.places(inside)), 0).astype(np.int32)
    relief = radius - nominal
    missing = covered & (number > 0) & (relief > np.maximum(own, 0) + np.float32(OPEN_MM))
    level = field.level_mm[number]
    wet = (field.depth_mm(*bore.places(radius)) > level).astype(np.float32)
    return nodes, (relief, missing, number, wet)


def _no_cells(n: int) -> Near:
    """Return rays without any planted cavity."""
    nothing = cavities((), 1.0)
    return near(nothing, np.zeros((1, 0), np.intp), np.zeros((n, 3)), np.zeros((n, 3)), np.float32)


@dataclass(frozen=True, eq=False)
class Baked:
    """Maps (n_z, n_θ), as :class:`endoct.synthetic.bone.wall.WallMaps` says."""

    relief_mm: Image
    cell: Mask
    cell_id: NDArray[np.int32]
    wet: Image


def bake(scene: Scene, cells: Sequence[Cell], workers: int, elsewhere: TracedElsewhere) -> Baked:
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
    return Baked(relief.reshape(shape), cell.reshape(shape), cell_id.reshape(shape), wet.reshape(shape))


def part_of_wall(sample: Sample, part: int, parts: int) -> list[Traced]:
    """Trace what falls to helper ``part`` of ``parts``: they help the process that builds the wall."""
    scene = build_scene(sample)
    return [_traced(scene, job) for job in _part(_jobs(scene, sample.bore.cells, 1), part, parts)]


def _part(jobs: list[Job], part: int, parts: int) -> list[Job]:
    """Return the jobs of helper ``part`` of ``parts``; part ``parts`` is the process that builds the wall."""
    of = [k // SHARE_ELSEWHERE for k in range(SHARE_ELSEWHERE * parts + 1)]
    return [job for index, job in enumerate(jobs) if of[index % len(of)] == part]


def _jobs(scene: Scene, cells: Sequence[Cell], workers: int) -> list[Job]:
    """Return all nodes to trace, in jobs that do not depend on who does them."""
    if scene.field is not None:
        every = np.arange(scene.grid.n_z * scene.grid.n_theta)
        return [(every[k : k + BLOCK], np.zeros((1, 0), np.int64)) for k in range(0, every.size, BLOCK)]
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


@dataclass(frozen=True, eq=False)
class _AlongRadius:
    """The bore along radial rays through nodes of the wall, of which it has that radius."""

    wall_mm: Numbers

    def of(self, which: Indices) -> "_AlongRadius":
        return _AlongRadius(self.wall_mm.take(which))

    def at(self, t: Numbers) -> tuple[Numbers, Numbers]:
        return self.wall_mm - t, np.ones_like(t)


def _traced(scene: Scene, job: Job) -> Traced:
    if scene.field is not None:
        return traced_in_field(scene, scene.field, job[0])
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
    """Return which of a ray's open cells (n, k) reaches deepest, whatever fills it, (n,)."""
    depth = np.zeros(open_cells.shape, start.dtype)
    for slot in range(open_cells.shape[1]):
        which = np.flatnonzero(open_cells[:, slot])
        one, t = replace(rays.of(which).alone(slot), dusty=False), start[which]
        no_bore = _AlongRadius(np.full_like(t, -DEEPEST_MM))
        ends = first_solid(scene.cells, one, no_bore, t, t + np.float32(DEEPEST_MM))
        depth[which, slot] = np.nan_to_num(ends, nan=math.inf)
    return np.asarray(depth.argmax(1))
