"""How light or dark the bone of a wall is: mottled, smeared, lined in some cells and bright along some rims."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.stitching.circle import pad_circle
from endoct.synthetic.bone.contents import Contents
from endoct.synthetic.bone.relief import BoreRelief, WallGrid, textures
from endoct.synthetic.sample.parameters import Sample

RIM_MM = 0.02


def albedo_of(
    sample: Sample,
    grid: WallGrid,
    relief: BoreRelief,
    contents: Contents,
    cell_id: NDArray[np.int32],
    workers: int,
) -> Image:
    """Return mottled bone, darkened by smears and in the cells by their lining."""
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
    return albedo


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
