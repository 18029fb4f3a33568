"""The wall of a bore through three-dimensional bone: radial rays through the nodes that lie in air."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image, Mask
from endoct.synthetic.bone.cavities import cavities
from endoct.synthetic.bone.cavity import Indices, Near, near
from endoct.synthetic.bone.field import EDGE_MM, STEEPEST, Field, joined_with_bore
from endoct.synthetic.bone.relief import WallGrid
from endoct.synthetic.bone.scene import Scene
from endoct.synthetic.bone.tracing import BLOCK, first_solid
from endoct.synthetic.elementary import Numbers

DEEPEST_MM = 2.5
OPEN_MM = 0.01  # a cell is open where the first surface lies this much beyond the bore's own wall


def blocks_of_wall(grid: WallGrid) -> list[NDArray[np.intp]]:
    """Return the nodes of a wall in blocks to trace together."""
    every = np.arange(grid.n_z * grid.n_theta)
    return [every[first : first + BLOCK] for first in range(0, every.size, BLOCK)]


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
    """Return what :mod:`endoct.synthetic.bone.baking` wants of ``nodes`` (n,), of those that lie in air or near it."""
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
