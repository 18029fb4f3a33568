"""The bore's wall: its relief, its cells, and what both instruments need to know of its surface.

The maps are baked: rays are traced radially through the nodes that cells can reach; elsewhere the wall is the bore's.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.synthetic.cavity import Near, clearance, covers, in_one_thread
from endoct.synthetic.opening import patch, radial
from endoct.synthetic.parameters import Cell, Sample
from endoct.synthetic.randomness import Stage, generator
from endoct.synthetic.relief import BoreRelief, WallGrid, texture
from endoct.synthetic.scene import BLOCK, STEP_MM, BoreAlong, Scene, build_scene, first_fluid, first_solid

LOOKUP_COLUMNS = 1024
DEEPEST_MM = 2.5
OPEN_MM = 0.01  # a cell is open where the first surface lies this much beyond the bore's own wall
RIM_MM = 0.02


@dataclass(frozen=True, eq=False)
class Wall:
    """Maps of the wall on a grid (z, θ) of the bore frame, of the ``scene`` they were baked from.

    Row k is z = k·``dz_mm`` from the mouth, column j is θ = j·2π/n. ``relief_mm``: wall radius minus
    ``radius_mm``, the first solid surface along the radial ray. ``cell``: the surface at the nominal radius is
    missing; ``cell_id``: 1 + the index in the sample of the cell whose cavity is open there, of the deepest where
    several meet, 0 elsewhere; it is kept where dust fills the opening, which is not missing then. ``albedo``:
    relative reflectance; ``rim``: light added on bright rims of cells. ``slope_z``, ``slope_theta``: ∂r/∂z and
    ∂r/(r ∂θ). ``wet``: fluid lies over the place, 0 or 1.
    """

    radius_mm: float
    dz_mm: float
    relief_mm: Image
    cell: Mask
    cell_id: NDArray[np.int32]
    albedo: Image
    rim: Image
    slope_z: Image
    slope_theta: Image
    wet: Image
    scene: Scene

    @property
    def dtheta_rad(self) -> float:
        """Step of the columns, rad."""
        return 2 * math.pi / int(self.relief_mm.shape[1])

    def at(self, image: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Image:
        """Return one of the maps at scattered places (1-D arrays of one length), bilinear, cyclic in θ."""
        n = z_mm.size
        rows = np.zeros(-(-n // LOOKUP_COLUMNS) * LOOKUP_COLUMNS, np.float32)
        columns = np.zeros_like(rows)
        np.clip(z_mm / self.dz_mm, 0, image.shape[0] - 1, out=rows[:n], casting="same_kind")
        columns[:n] = np.mod(theta_rad, 2 * np.pi) / self.dtheta_rad
        shape = (-1, LOOKUP_COLUMNS)
        found = cv2.remap(
            image, columns.reshape(shape), rows.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        return np.asarray(found, dtype=np.float32).ravel()[:n]


@dataclass(frozen=True, eq=False)
class _Baked:
    """The maps (n_z, n_θ) that tracing gives, and those of the cells' inside and rims."""

    relief_mm: Image
    cell: Mask
    cell_id: NDArray[np.int32]
    wet: Image


def build_wall(sample: Sample) -> Wall:
    """Return the wall that ``sample`` describes."""
    scene = build_scene(sample)
    grid, bore = scene.grid, sample.bore
    baked = _bake(scene, bore.cells)
    rng = generator(sample.bore_seed, Stage.WALL, 1)
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
        albedo=_albedo(sample, grid, scene.relief, baked, rng),
        rim=_rims(bore.cells, baked, grid),
        slope_z=np.gradient(relief, np.float32(grid.dz_mm), axis=0).astype(np.float32, copy=False),
        slope_theta=slope_theta,
        wet=baked.wet,
        scene=scene,
    )


def _albedo(sample: Sample, grid: WallGrid, relief: BoreRelief, baked: _Baked, rng: np.random.Generator) -> Image:
    """Return mottled bone, darkened by smears and in the cells by their lining."""
    bore = sample.bore
    albedo = 0.6 * texture(rng, grid, 0.15)
    albedo += 0.6 * texture(rng, grid, 0.04)
    albedo += 0.5 * relief.fine
    # the drill's mark shows on the wall it has cut, not inside the cells
    albedo += np.where(baked.cell_id > 0, np.float32(0), np.float32(0.5) * relief.grooves)
    albedo *= np.float32(bore.texture)
    albedo += 1
    np.clip(albedo, 0.3, 1.6, out=albedo)
    smears = np.clip((texture(rng, grid, 0.25) - 1.4) / 0.4, 0, 1)
    albedo *= 1 - np.float32(bore.smear) * smears
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
    wide = np.pad(bright, ((0, 0), (pad, pad)), mode="wrap")
    blurred = cv2.GaussianBlur(wide, (0, 0), sigmaX=sigma_theta, sigmaY=sigma_z)[:, pad:-pad]
    return np.asarray(2 * np.abs(bright - blurred), dtype=np.float32)


@in_one_thread
@torch.inference_mode()
def _bake(scene: Scene, cells: tuple[Cell, ...]) -> _Baked:
    """Trace radial rays through the nodes of the wall that cells reach."""
    device, n_theta = scene.device, scene.grid.n_theta
    layers, reached = _cells_at_nodes(scene, cells)
    relief = scene.relief.displacement_mm.ravel().copy()
    cell = np.zeros(relief.size, np.bool_)
    cell_id, wet = np.zeros(relief.size, np.int32), np.zeros(relief.size, np.float32)
    count = (layers[:, reached] >= 0).sum(0)
    for k in range(1, layers.shape[0] + 1):
        nodes_k = reached[count == k]
        for first in range(0, nodes_k.size, max(1, BLOCK // k)):
            nodes = nodes_k[first : first + max(1, BLOCK // k)]
            own = torch.as_tensor(relief[nodes], device=device)
            here = torch.as_tensor(layers[:k, nodes].T.astype(np.int64), device=device)
            rays = radial(scene.grid, scene.cells, nodes // n_theta, nodes % n_theta, here)
            radius, number, covered, fluid = _trace(scene, rays, own)
            surface = (radius - scene.grid.radius_mm).cpu().numpy()
            relief[nodes], cell_id[nodes] = surface, number.cpu().numpy()
            open_ = surface > np.maximum(own.cpu().numpy(), 0) + np.float32(OPEN_MM)
            cell[nodes] = covered.cpu().numpy() & open_
            wet[nodes] = fluid.cpu().numpy()
    shape = scene.grid.n_z, n_theta
    return _Baked(relief.reshape(shape), cell.reshape(shape), cell_id.reshape(shape), wet.reshape(shape))


def _along_radius(wall_mm: Tensor) -> BoreAlong:
    def bore(which: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
        return wall_mm[which] - t, torch.ones_like(t)

    return bore


def _cells_at_nodes(scene: Scene, cells: tuple[Cell, ...]) -> tuple[NDArray[np.int16], NDArray[np.intp]]:
    """Return the cells whose cavity may lie behind each node, int16 (k, n_z·n_θ) ending in −1, and the nodes
    at which the bore's own wall is missing or moved, ascending.
    """
    grid, patches = scene.grid, []
    reached = np.zeros(grid.n_z * grid.n_theta, np.bool_)
    displacement = scene.relief.displacement_mm
    table = scene.cells.inverse.to(torch.float32)
    for number, cell in enumerate(cells):
        rows, columns = patch(grid, scene.cells, cell, number)
        if not rows.size:
            continue
        row, column = (index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
        alone = torch.full((row.size, 1), number, device=scene.device)
        rays = radial(scene.grid, scene.cells, row, column, alone)
        own = torch.as_tensor(displacement[row, column] + np.float32(grid.radius_mm), device=scene.device)
        air = clearance(table, rays, own).air_mm[:, 0]
        node = row * grid.n_theta + column
        reached[node[(air > -rays.edge[:, 0]).cpu().numpy()]] = True
        patches.append((number, node))
    count = np.zeros(reached.size, np.int16)
    for _, node in patches:
        count[node] += 1
    layers = np.full((max(1, int(count.max(initial=0))), reached.size), -1, np.int16)
    count[:] = 0
    for number, node in patches:
        some = node[reached[node]]
        layers[count[some], some] = number
        count[some] += 1
    return layers, np.flatnonzero(reached)


def _trace(scene: Scene, rays: Near, own: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return of radial rays: radius of the first surface, the open cell's number, whether one is, and wet."""
    start = own + scene.grid.radius_mm
    bore = _along_radius(start)
    limit = torch.full_like(start, scene.grid.radius_mm + DEEPEST_MM)
    radius = torch.nan_to_num(first_solid(scene, rays, bore, start, limit), nan=scene.grid.radius_mm + DEEPEST_MM)
    table = scene.cells.inverse.to(torch.float32)
    at_wall = torch.full_like(start, scene.grid.radius_mm)
    open_cells = covers(table, rays, at_wall)
    several = open_cells.to(torch.int8).cumsum(1)[:, -1] > 1
    slot = open_cells.to(torch.int8).argmax(1)
    if several.any():
        which = torch.nonzero(several)[:, 0]
        slot[which] = _deepest(table, rays.of(which), open_cells[which], at_wall[which])
    covered = open_cells.any(1)
    number = torch.where(covered, rays.cell.gather(1, slot[:, None])[:, 0] + 1, 0)
    fluid = torch.isfinite(first_fluid(scene, rays, start, radius))
    return radius, number, covered, fluid


def _deepest(table: Tensor, rays: Near, open_cells: Tensor, start: Tensor) -> Tensor:
    """Return which of a ray's open cells (n, k) reaches deepest, its filling not considered, int64 (n,)."""
    depth = torch.zeros(open_cells.shape, dtype=start.dtype, device=start.device)
    for slot in range(open_cells.shape[1]):
        which = torch.nonzero(open_cells[:, slot])[:, 0]
        one, t = replace(rays.of(which).alone(slot), dusty=False), start[which]
        while len(which):
            step = clearance(table, one, t).step_mm[:, 0]
            depth[which, slot] = t
            on = step > 0
            which, t = which[on], (t + step.clamp_min(STEP_MM))[on]
            one = one.of(torch.nonzero(on)[:, 0])
    return depth.argmax(1)
