"""The bore's wall: its relief, its cells, and what both instruments need to know of its surface."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.synthetic.cells import pit_mm, reach_mm
from endoct.synthetic.parameters import Sample
from endoct.synthetic.presets import PRESETS
from endoct.synthetic.randomness import Stage, generator, smooth_field

LOOKUP_COLUMNS = 1024


@dataclass(frozen=True, eq=False)
class Wall:
    """Maps of the wall on a grid (z, θ) of the bore frame.

    Row k is z = k·``dz_mm`` from the mouth, column j is θ = j·2π/n. ``relief_mm``: wall radius minus
    ``radius_mm``, the first surface along the radial ray. ``cell``: the surface at the nominal radius is
    missing; ``cell_id``: 1 + the cell's index in the sample, of the deepest where cells meet, 0 elsewhere.
    ``albedo``: relative reflectance; ``rim``: light added on bright rims of cells. ``slope_z``,
    ``slope_theta``: ∂r/∂z and ∂r/(r ∂θ).
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


def build_wall(sample: Sample) -> Wall:
    """Return the wall that ``sample`` describes."""
    bore, preset = sample.bore, PRESETS[sample.preset]
    radius_mm, dz_mm, n_theta = bore.diameter_mm / 2, preset.wall_dz_mm, preset.wall_n_theta
    z_mm = np.arange(0, bore.length_mm, dz_mm)[:, None]
    theta_rad = 2 * math.pi / n_theta * np.arange(n_theta, dtype=np.float64)[None, :]
    shape = z_mm.size, n_theta
    dtheta_mm = 2 * np.pi * radius_mm / n_theta
    rng = generator(sample.bore_seed, Stage.WALL)

    def texture(scale_mm: float) -> Image:
        return smooth_field(rng, shape, scale_mm / dz_mm, scale_mm / dtheta_mm)

    pit = np.zeros(shape, np.float32)
    cell_id = np.zeros(shape, np.int32)
    lining = np.ones(shape, np.float32)
    rim = np.zeros(shape, np.float32)
    for number, cell in enumerate(bore.cells, 1):
        reach = reach_mm(cell) + 0.1
        rows = slice(*np.searchsorted(z_mm[:, 0], [cell.z_mm - reach, cell.z_mm + reach]))
        depth = pit_mm(cell, z_mm[rows], theta_rad, radius_mm).astype(np.float32)
        deepest = depth > pit[rows]
        pit[rows][deepest] = depth[deepest]
        cell_id[rows][deepest] = number
        lining[rows][deepest] = cell.lining
        if cell.rim_gain > 0:
            inside = (depth > 0).astype(np.float32)
            edge = np.abs(inside - cv2.GaussianBlur(inside, (0, 0), sigmaX=0.02 / dtheta_mm, sigmaY=0.02 / dz_mm))
            rim[rows] = np.maximum(rim[rows], 2 * cell.rim_gain * edge)

    fine = texture(0.012)
    floor = np.clip(1 + 0.12 * texture(0.08) + 0.04 * fine, 0.5, 1.4)
    grooves = np.sin(2 * np.pi * z_mm / bore.drill_mark_pitch_mm + theta_rad + 0.6 * texture(0.5))
    grooves *= bore.drill_mark_depth_mm * np.clip(0.6 + 0.5 * texture(0.9), 0, 1.5)
    smooth = bore.wander_mm * texture(1.1) + bore.taper_mm * (z_mm / bore.length_mm - 0.5)
    opened = pit > 0
    surface = smooth + np.where(opened, pit * floor, grooves) + bore.roughness_mm * fine
    relief = np.asarray(surface, dtype=np.float32)

    smears = np.clip((texture(0.25) - 1.4) / 0.4, 0, 1)
    mottle = 0.6 * texture(0.15) + 0.6 * texture(0.04) + 0.5 * texture(0.015)
    grain = 0.5 * grooves / bore.drill_mark_depth_mm
    albedo = np.clip(1 + bore.texture * (mottle + np.where(opened, 0, grain)), 0.3, 1.6)
    albedo *= (1 - bore.smear * smears) * lining
    slope_theta = (np.roll(relief, -1, axis=1) - np.roll(relief, 1, axis=1)) / (2 * dtheta_mm)
    return Wall(
        radius_mm=radius_mm,
        dz_mm=dz_mm,
        relief_mm=relief,
        cell=opened,
        cell_id=cell_id,
        albedo=albedo.astype(np.float32),
        rim=rim,
        slope_z=np.gradient(relief, dz_mm, axis=0).astype(np.float32),
        slope_theta=slope_theta.astype(np.float32),
    )
