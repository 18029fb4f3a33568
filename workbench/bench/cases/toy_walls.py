"""Toy walls with cells, in milliseconds: for sweeps over one difficulty at a time.

A caricature, not the simulator: cells are superellipses of one size, placed at random, and what an instrument makes
of them is a formula. Of an OCT, the detection of the wall's echo among noise; of an endoscope, darkness, light and
noise. What it says about a method's breaking point is to be checked on simulated recordings.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import gaussian, wrap_rad
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.task import Range, rng_of

RADIUS_MM, LENGTH_MM, PITCH_MM = 1.25, 6.0, 0.2
N_ASCANS, N_COLUMNS, ROW_MM = 1000, 1024, 0.02
SHALLOWEST_MM, DEEPEST_MM = 0.05, 1.5
SQUARENESS = 8.0
"""Exponent of a cell's profile. 2 is a bowl; drilled holes of the simulator have 5 to 12."""
RANGES: Mapping[str, Range] = {
    "signal_db": (3.0, 30.0),
    "cell_mm": (0.2, 1.5),
    "fill": (0.08, 0.3),
    "missing": (0.0, 0.3),
    "unevenness": (0.0, 1.0),
}
"""``signal_db``: the wall's echo over the noise in power, or the wall's brightness over the noise's deviation, in dB.
``cell_mm``: diameter of the cells; slices of the OCT are 0.2 mm apart. ``fill``: share of the wall that is cells.
``missing``: share of the slices, of 0.2 mm, that are not valid. ``unevenness``: of the light (1: by half around the
wall and along it), and of the wall's course (1: 0.1 mm off the circle)."""

SPECKLES, DEPTH_SAMPLES, SPECKLE_COLUMNS = 4, 256, 5
"""Independent speckles that are averaged, depth samples that compete with the wall, columns that share a speckle."""
RESOLUTION_MM = 0.006
CELL_ECHO_DB = -4.0
COUNTS_A_DB = 2.5
GREY_WALL_MM, GREY_BLUR_MM, TEXTURE, TEXTURE_MM = 0.25, 0.02, 0.05, 0.06


@dataclass(frozen=True, eq=False)
class ToyWall:
    """What is true at the centres of samples: ``relief_mm`` float64, ``cell`` bool, both (n_z, n_theta)."""

    relief_mm: Coordinates
    cell: Mask


def toy_panorama(seed: int, index: int, modality: str, conditions: Mapping[str, float]) -> tuple[Panorama, Mask]:
    """Return a panorama of the ``modality`` "depth" or "intensity" and the true cells at its samples."""
    rng = rng_of(seed, index, f"noise of {modality}")
    dz_mm, n_theta = (PITCH_MM, N_ASCANS) if modality == "depth" else (ROW_MM, N_COLUMNS)
    n_z = round(LENGTH_MM / dz_mm)
    grid = SurfaceGrid.full_circle(n_z, n_theta, z0_mm=dz_mm / 2, dz_mm=dz_mm, radius_mm=RADIUS_MM)
    wall = _wall(rng_of(seed, index, "cells"), grid, conditions["cell_mm"], conditions["fill"])
    if modality == "depth":
        intensity, depth_mm = _as_oct(rng, grid, wall, conditions)
    else:
        intensity, depth_mm = _as_endoscope(rng, grid, wall, conditions), None
    valid = _valid(rng_of(seed, index, "missing"), grid, conditions["missing"])
    panorama = Panorama(
        grid=grid,
        intensity=np.where(valid, intensity, 0.0),
        depth_mm=None if depth_mm is None else np.where(valid, depth_mm, 0.0),
        valid=valid,
        weight=valid.astype(np.float32),
        modality="oct" if modality == "depth" else "endoscope",
        handedness_known=True,
        travel_known=True,
    )
    return panorama, wall.cell


def _wall(rng: np.random.Generator, grid: SurfaceGrid, cell_mm: float, fill: float) -> ToyWall:
    """Place cells of about one diameter until ``fill`` of the wall is theirs; they may touch."""
    relief = np.zeros(grid.shape)
    placed_mm2, area_mm2 = 0.0, 2 * np.pi * RADIUS_MM * LENGTH_MM
    while placed_mm2 < -np.log1p(-fill) * area_mm2:  # cells placed at random overlap
        radius_mm, flatness = 0.5 * cell_mm * rng.uniform(0.85, 1.15), rng.uniform(0.7, 1.0)
        depth_mm = min(np.exp(rng.uniform(np.log(SHALLOWEST_MM), np.log(DEEPEST_MM))), 1.5 * cell_mm)
        z_mm, theta_rad = rng.uniform(0, LENGTH_MM), rng.uniform(0, 2 * np.pi)
        placed_mm2 += np.pi * radius_mm**2 * flatness
        along = (grid.z_mm - z_mm) / radius_mm
        across = RADIUS_MM * wrap_rad(grid.theta_rad - theta_rad) / (radius_mm * flatness)
        near = np.ix_(np.abs(along) < 1, np.abs(across) < 1)
        squared = along[np.abs(along) < 1, np.newaxis] ** 2 + across[np.abs(across) < 1] ** 2
        relief[near] = np.maximum(relief[near], depth_mm * np.clip(1 - squared ** (SQUARENESS / 2), 0, None))
    return ToyWall(relief, relief > 0)


def _as_oct(
    rng: np.random.Generator, grid: SurfaceGrid, wall: ToyWall, conditions: Mapping[str, float]
) -> tuple[Image, Image]:
    """Return (intensity, depth) as a finder of the strongest echo in each A-scan would give them."""
    blocks = (grid.n_z, grid.n_theta // SPECKLE_COLUMNS)
    wide = (1, SPECKLE_COLUMNS)
    signal = 10 ** (conditions["signal_db"] / 10) * np.where(wall.cell, 10 ** (CELL_ECHO_DB / 10), 1.0)
    speckle = np.kron(rng.gamma(SPECKLES, 1 / SPECKLES, blocks), np.ones(wide))
    # the strongest of many samples of noise, drawn at once
    strongest = special.gammaincinv(SPECKLES, rng.random(blocks) ** (1 / DEPTH_SAMPLES)) * (1 / SPECKLES)
    noise = np.kron(strongest, np.ones(wide))
    echo = (1 + signal) * speckle
    blur = np.kron(rng.normal(size=blocks), np.ones(wide)) * RESOLUTION_MM * (1 + 1 / np.sqrt(signal))
    anywhere = np.kron(rng.uniform(-0.3, DEEPEST_MM, blocks), np.ones(wide))
    depth = np.where(echo > noise, wall.relief_mm + _course_mm(rng, grid, conditions) + blur, anywhere)
    intensity = 100 + COUNTS_A_DB * 10 * np.log10(np.maximum(echo, noise))
    return intensity.astype(np.float32), depth.astype(np.float32)


def _course_mm(rng: np.random.Generator, grid: SurfaceGrid, conditions: Mapping[str, float]) -> Coordinates:
    """Return how far the wall lies off the circle: two harmonics that turn along z, and slices off their place."""
    z, theta = grid.z_mm[:, np.newaxis], grid.theta_rad
    course = np.zeros(grid.shape)
    for harmonic, share in ((1, 0.7), (2, 0.3)):
        phase, twist = rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.3)
        course += 0.1 * share * np.cos(harmonic * theta + phase + twist * z)
    return np.asarray(conditions["unevenness"] * (course + rng.normal(0, 0.005, (grid.n_z, 1))))


def _as_endoscope(rng: np.random.Generator, grid: SurfaceGrid, wall: ToyWall, conditions: Mapping[str, float]) -> Image:
    """Return the brightness of a wall in which deep cells are dark, and shallow ones grey."""
    albedo = 1 + TEXTURE * _texture(rng, grid)
    bright = albedo * (0.15 + 0.85 * np.exp(-wall.relief_mm / GREY_WALL_MM))
    blurred = gaussian(bright.astype(np.float32), GREY_BLUR_MM / grid.dz_mm, GREY_BLUR_MM / grid.dtheta_mm)
    uneven, phase = conditions["unevenness"], rng.uniform(0, 2 * np.pi)
    light = (1 + 0.5 * uneven * np.cos(grid.theta_rad - phase)) * (
        1 - 0.4 * uneven * (grid.z_mm[:, np.newaxis] / LENGTH_MM)
    )
    noise = 10 ** (-conditions["signal_db"] / 20) * rng.normal(size=grid.shape)
    return np.asarray(np.maximum(blurred * light + noise, 0), dtype=np.float32)


def _texture(rng: np.random.Generator, grid: SurfaceGrid) -> Image:
    grain = rng.normal(size=grid.shape).astype(np.float32)
    smooth = gaussian(grain, TEXTURE_MM / grid.dz_mm, TEXTURE_MM / grid.dtheta_mm)
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def _valid(rng: np.random.Generator, grid: SurfaceGrid, missing: float) -> Mask:
    n_slices = round(LENGTH_MM / PITCH_MM)
    lost = rng.permutation(n_slices)[: round(missing * n_slices)]
    slices = np.minimum((grid.z_mm / PITCH_MM).astype(int), n_slices - 1)
    return np.repeat(~np.isin(slices, lost)[:, np.newaxis], grid.n_theta, axis=1)
