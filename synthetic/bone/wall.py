"""The bore's wall as maps: its relief, cells and albedo, and what else both instruments need to know of its surface.

The bone is mottled, smeared, lined in some cells and bright along some rims. The endoscope needs these maps only.
"""

import math
from dataclasses import dataclass, fields
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import pad_circle
from endoct.synthetic.bone.baked_maps import TracedElsewhere, bake
from endoct.synthetic.bone.density import BoneDensity, density_of
from endoct.synthetic.bone.relief import BoreRelief, WallGrid, textures
from endoct.synthetic.bone.scene import Contents, Scene, build_scene
from endoct.synthetic.sample.parameters import Sample

LOOKUP_COLUMNS = 1024
"""Places that are looked up at once lie in rows of this length."""
RIM_MM = 0.02
"""Rims are made bright by a blur of this σ."""
COARSER = 4
"""Density is looked up on a grid coarser by this in θ and z: 0.04 mm, less than a channel is wide."""


@dataclass(frozen=True, eq=False)
class WallMaps:
    """Maps of the wall on a grid (z, θ) of the bore frame.

    Row k is z = k·``dz_mm`` from the mouth, column j is θ = j·2π/n. ``relief_mm``: wall radius minus
    ``radius_mm``, the first solid surface along the radial ray. ``cell``: the surface at the nominal radius is
    missing. ``cell_id``: 1 + the index in the sample of the cell whose cavity is open there, 0 elsewhere. Where several
    meet it is the deepest, and it is kept where dust fills the opening, which is not missing then. ``albedo``: relative
    reflectance; ``rim``: light added on bright rims of cells. ``slope_z``, ``slope_theta``: ∂r/∂z and ∂r/(r ∂θ).
    ``wet``: fluid lies over the place, 0 or 1.
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

    @property
    def dtheta_rad(self) -> float:
        """Step of the columns, rad."""
        return 2 * math.pi / int(self.relief_mm.shape[1])

    @cached_property
    def relief_range_mm(self) -> tuple[float, float]:
        """The least and the largest relief."""
        return float(self.relief_mm.min()), float(self.relief_mm.max())

    def at(self, image: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Image:
        """Return one of the maps at scattered places (1-D arrays of one length), bilinear, cyclic in θ."""
        n = z_mm.size
        rows = np.zeros(-(-n // LOOKUP_COLUMNS) * LOOKUP_COLUMNS, np.float32)
        columns = np.zeros_like(rows)
        np.clip(z_mm / self.dz_mm, 0, image.shape[0] - 1, out=rows[:n], casting="same_kind")
        columns[:n] = np.mod(theta_rad, 2 * np.pi) / self.dtheta_rad
        shape = (-1, LOOKUP_COLUMNS)
        values = cv2.remap(
            image, columns.reshape(shape), rows.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        return np.asarray(values, dtype=np.float32).ravel()[:n]


@dataclass(frozen=True, eq=False)
class Wall(WallMaps):
    """The maps, and the ``scene`` they were baked from."""

    scene: Scene

    def maps(self) -> WallMaps:
        """Return the maps alone, without the scene, which takes long to send to another process."""
        return WallMaps(**{field.name: getattr(self, field.name) for field in fields(WallMaps)})


def albedo_of(
    sample: Sample,
    grid: WallGrid,
    relief: BoreRelief,
    contents: Contents,
    relief_mm: Image,
    cell_id: NDArray[np.int32],
    workers: int,
) -> Image:
    """Return mottled bone, darker where it is less dense, under smears, and in the cells by their lining."""
    bore = sample.bore
    albedo, finer, smears = textures(sample, grid, 4, (0.15, 0.04, 0.25), workers)
    albedo *= 0.6
    albedo += 0.6 * finer
    albedo += 0.5 * relief.fine
    # the drill's mark shows on the wall it has cut, not inside the cells
    albedo += np.where(cell_id > 0, np.float32(0), np.float32(0.5) * relief.grooves)
    albedo *= np.float32(bore.texture)
    albedo += 1
    np.clip(albedo, 0.3, 1.6, out=albedo)
    albedo *= 1 - np.float32(bore.smear) * np.clip((smears - 1.4) / 0.4, 0, 1)
    albedo *= contents.lining[cell_id]
    if relief.ink is not None and bore.tube is not None:
        albedo *= 1 - np.float32(1 - bore.tube.ink) * relief.ink
    density = density_of(sample)
    if density is not None:
        albedo *= _albedo_of_density(density, grid, relief_mm)
    return albedo


def _albedo_of_density(density: BoneDensity, grid: WallGrid, relief_mm: Image) -> Image:
    """Return the factor of density in the wall's albedo, looked up on a grid ``COARSER`` times coarser."""
    rows, columns = (-(-n // COARSER) for n in (grid.n_z, grid.n_theta))
    z = ((np.arange(rows) + 0.5) * (grid.n_z / rows) - 0.5).astype(np.float32)[:, None]
    theta = ((np.arange(columns) + 0.5) * (grid.n_theta / columns) - 0.5).astype(np.float32)
    radius = grid.radius_mm + relief_mm[np.rint(z[:, 0]).astype(np.intp)][:, np.rint(theta).astype(np.intp)]
    theta *= np.float32(2 * math.pi / grid.n_theta)
    coarse = density.albedo(
        radius * np.cos(theta), radius * np.sin(theta), np.broadcast_to(z * grid.dz_mm, radius.shape)
    )
    wide = pad_circle(coarse, 1)
    every = grid.n_theta // columns
    large = cv2.resize(wide, (wide.shape[1] * every, grid.n_z), interpolation=cv2.INTER_LINEAR)
    return np.asarray(large[:, every:-every], np.float32)


def rim_light(contents: Contents, grid: WallGrid, cell_id: NDArray[np.int32]) -> Image:
    """Return the light added along the outlines of the openings of cells with bright rims."""
    if not contents.rim_gain.any():
        return np.zeros(cell_id.shape, np.float32)
    bright = contents.rim_gain[cell_id]
    sigma_z, sigma_theta = RIM_MM / grid.dz_mm, RIM_MM / grid.dtheta_mm
    pad = math.ceil(4 * sigma_theta)
    wide = pad_circle(bright, pad)
    blurred = cv2.GaussianBlur(wide, (0, 0), sigmaX=sigma_theta, sigmaY=sigma_z)[:, pad:-pad]
    return np.asarray(2 * np.abs(bright - blurred), dtype=np.float32)


def build_wall(sample: Sample, workers: int = 1, elsewhere: TracedElsewhere = ()) -> Wall:
    """Return the wall that ``sample`` describes, made by ``workers`` threads, and in part ``elsewhere``.

    Neither changes the wall.
    """
    scene = build_scene(sample, workers=workers)
    grid, cells = scene.grid, sample.bore.cells
    baked = bake(scene, cells, workers, elsewhere)
    return Wall(
        radius_mm=grid.radius_mm,
        dz_mm=grid.dz_mm,
        relief_mm=baked.relief_mm,
        cell=baked.cell,
        cell_id=baked.cell_id,
        albedo=albedo_of(sample, grid, scene.relief, scene.contents, baked.relief_mm, baked.cell_id, workers),
        rim=rim_light(scene.contents, grid, baked.cell_id),
        slope_z=np.gradient(baked.relief_mm, np.float32(grid.dz_mm), axis=0).astype(np.float32, copy=False),
        slope_theta=_slope_theta(baked.relief_mm, grid.dtheta_mm),
        wet=baked.wet,
        scene=scene,
    )


def _slope_theta(relief_mm: Image, dtheta_mm: float) -> Image:
    """Return ∂r/(r ∂θ) by central differences, around the circle."""
    slope = np.empty_like(relief_mm)
    slope[:, 1:-1] = relief_mm[:, 2:] - relief_mm[:, :-2]
    slope[:, 0] = relief_mm[:, 1] - relief_mm[:, -1]
    slope[:, -1] = relief_mm[:, 0] - relief_mm[:, -2]
    slope *= np.float32(1 / (2 * dtheta_mm))
    return slope
