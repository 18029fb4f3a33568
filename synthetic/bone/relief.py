"""The bore's own wall without cells: how far it departs from a cylinder, as a map over (z, θ).

A printed tube to calibrate by has grooves and rings besides, and ink in its grooves.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator

from endoct.base.arrays import Image
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import gaussian, pad_circle
from endoct.synthetic.sample.parameters import Sample, Tube
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.randomness import Stage, generator, smooth_field

SAMPLES_A_SIGMA = 4
"""A smooth texture is drawn on a grid with so many samples a σ, enough for cubic enlargement."""
BORDER = 4
"""So many samples are repeated beyond the turn, so that the enlargement is cyclic."""
FINE_MM = 0.012
BRIM_MM = 0.01
"""The ink of a tube begins over this much of a groove's depth."""


@dataclass(frozen=True)
class WallGrid:
    """The nodes (z, θ) of the wall's maps: z = k·``dz_mm`` from the mouth, θ = j·2π/``n_theta``."""

    n_z: int
    n_theta: int
    dz_mm: float
    radius_mm: float

    @property
    def dtheta_mm(self) -> float:
        """Step along the nominal wall between columns, mm."""
        return 2 * math.pi * self.radius_mm / self.n_theta


@dataclass(frozen=True, eq=False)
class BoreRelief:
    """Maps over the wall's grid, float32 (n_z, n_theta), of the bore without its cells.

    ``displacement_mm``: wall radius minus the nominal radius; ``grooves``: the drill's mark, relative, about
    ±1; ``fine``: what is rough in it, rms 1; ``ink``: the share of ink on a tube's marks, None where there is none.
    """

    displacement_mm: Image
    grooves: Image
    fine: Image
    ink: Image | None = None


def wall_grid(sample: Sample) -> WallGrid:
    """Return the grid of the wall's maps."""
    preset, bore = PRESETS[sample.preset], sample.bore
    n_z = int(np.arange(0, bore.length_mm, preset.wall_dz_mm).size)
    return WallGrid(n_z, preset.wall_n_theta, preset.wall_dz_mm, bore.diameter_mm / 2)


def texture(rng: Generator, grid: WallGrid, scale_mm: float) -> Image:
    """Return a Gaussian random field on the grid, float32, mean about 0, rms 1, cyclic in θ.

    It is white noise blurred by a Gaussian of σ = ``scale_mm``. A coarse one is drawn on a coarser grid and enlarged.
    """
    rows, columns = scale_mm / grid.dz_mm, scale_mm / grid.dtheta_mm
    every_row = max(1, int(rows / SAMPLES_A_SIGMA))
    every_column = 2 ** max(0, int(math.log2(columns / SAMPLES_A_SIGMA))) if columns > SAMPLES_A_SIGMA else 1
    every_column = math.gcd(every_column, grid.n_theta)
    shape = -(-grid.n_z // every_row), grid.n_theta // every_column
    if every_row == every_column == 1:
        noise = gaussian(rng.standard_normal(shape, dtype=np.float32), rows, columns)
        return np.asarray(noise / np.sqrt(np.mean(np.square(noise, dtype=np.float64))), dtype=np.float32)
    coarse = smooth_field(rng, shape, rows / every_row, columns / every_column)
    wide = pad_circle(coarse, BORDER)
    size = wide.shape[1] * every_column, wide.shape[0] * every_row
    large = cv2.resize(wide, size, interpolation=cv2.INTER_CUBIC)
    first = BORDER * every_column
    return np.ascontiguousarray(large[: grid.n_z, first : first + grid.n_theta], dtype=np.float32)


def textures(sample: Sample, grid: WallGrid, first: int, scales_mm: Sequence[float], workers: int) -> list[Image]:
    """Return a :func:`texture` for each scale, drawn from the wall's generators ``first``, ``first`` + 1, …"""
    each = [(generator(sample.bore_seed, Stage.WALL, k), scale) for k, scale in enumerate(scales_mm, first)]
    return list(thread_map(lambda one: texture(one[0], grid, one[1]), each, workers))


def bore_relief(sample: Sample, workers: int = 1) -> BoreRelief:
    """Return the relief of the drilled bore: taper, wander, the drill's helical mark and roughness."""
    bore, grid = sample.bore, wall_grid(sample)
    phase, strength, fine, wander = textures(sample, grid, 0, (0.5, 0.9, FINE_MM, 1.1), workers)
    z_mm = (grid.dz_mm * np.arange(grid.n_z, dtype=np.float32))[:, None]
    turns = (np.arange(grid.n_theta, dtype=np.float32) / grid.n_theta)[None, :]
    phase *= 0.6
    phase += np.float32(2 * math.pi) * np.mod(z_mm / np.float32(bore.drill_mark_pitch_mm) + turns, 1)
    grooves = np.sin(phase, out=phase)
    strength *= 0.5
    strength += 0.6
    grooves *= np.clip(strength, 0, 1.5, out=strength)
    displacement = wander
    displacement *= np.float32(bore.wander_mm)
    displacement += np.float32(bore.taper_mm) * (z_mm / np.float32(bore.length_mm) - np.float32(0.5))
    displacement += np.float32(bore.drill_mark_depth_mm) * grooves
    displacement += np.float32(bore.roughness_mm) * fine
    if bore.tube is None:
        return BoreRelief(displacement, grooves, fine)
    marks_mm, ink = tube_relief(bore.tube, grid.radius_mm, z_mm, np.asarray(2 * math.pi * turns, np.float32))
    displacement += marks_mm
    return BoreRelief(displacement, grooves, fine, ink)


def tube_relief(tube: Tube, radius_mm: float, z_mm: Image, theta_rad: Image) -> tuple[Image, Image]:
    """Return how much farther from the axis than its bore the tube is, and the share of ink, at z (n, 1) and θ (m,).

    Both are float32 (n, m). Rings and grooves add up; where grooves cross, the deeper counts. Edges are rounded.
    """
    z = z_mm / np.float32(tube.stretch)
    rings = sum(
        _inside(np.abs(z - np.float32(middle)) - np.float32(width / 2), tube.edge_mm)
        for middle, width in ((tube.narrow_z_mm, tube.narrow_width_mm), (tube.wide_z_mm, tube.wide_width_mm))
    )
    helix = np.float32(2 * math.pi / tube.helix_lead_mm) * z + np.float32(tube.helix_theta_rad)
    grooves = np.maximum(
        _inside(np.abs(_arc_mm(theta_rad, radius_mm)) - np.float32(tube.groove_width_mm / 2), tube.edge_mm),
        _inside(np.abs(_arc_mm(theta_rad - helix, radius_mm)) - np.float32(tube.helix_width_mm / 2), tube.edge_mm),
    )
    depth_error_mm = tube.depth_error * tube.sigma_depth_mm
    relief = (tube.ring_depth_mm + depth_error_mm) * rings + (tube.groove_depth_mm + depth_error_mm) * grooves
    relief += tube.bore_error * tube.sigma_bore_mm / 2
    below_brim = tube.groove_depth_mm * grooves - np.float32(tube.brim_mm)
    return np.asarray(relief, np.float32), np.asarray(np.clip(below_brim / BRIM_MM, 0, 1), np.float32)


def _arc_mm(theta_rad: Image, radius_mm: float) -> Image:
    """Return the way along the circumference from θ = 0, mm."""
    turned = np.mod(theta_rad + np.float32(math.pi), np.float32(2 * math.pi)) - np.float32(math.pi)
    return np.asarray(np.float32(radius_mm) * turned, np.float32)


def _inside(beyond_mm: Image, edge_mm: float) -> Image:
    """Return 1 well inside an outline, 0 well outside."""
    return np.asarray(0.5 - 0.5 * np.tanh(beyond_mm * np.float32(2 / edge_mm)), np.float32)
