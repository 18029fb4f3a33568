"""The bore's wall: its relief, its cells, and what both instruments need to know of its surface."""

from dataclasses import dataclass, fields

import numpy as np

from endoct.stitching.arrays import Image
from endoct.synthetic.bone.albedo import albedo_of, rim_light
from endoct.synthetic.bone.baking import TracedElsewhere, bake
from endoct.synthetic.bone.maps import WallMaps
from endoct.synthetic.bone.scene import Scene, build_scene
from endoct.synthetic.sample.parameters import Sample


@dataclass(frozen=True, eq=False)
class Wall(WallMaps):
    """The maps, and the ``scene`` they were baked from."""

    scene: Scene

    def maps(self) -> WallMaps:
        """Return the maps alone, without the scene, which takes long to send to another process."""
        return WallMaps(**{field.name: getattr(self, field.name) for field in fields(WallMaps)})


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
