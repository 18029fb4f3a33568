"""Strips of a toy bore wall, each sampled where the probe truly was, in milliseconds.

A caricature, not the simulator. The wall is a fine random texture with dark pits, whose floors show past their rims.
The probe has light, dirt and scratches of its own, the sensor has noise. A pixel of a strip looks up the wall at its
own place; nothing is unrolled.
"""

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import map_coordinates

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.circle import gaussian
from endoct.stitching.strip import Strip
from endoct.workbench.bench.task import Range, rng_of

RADIUS_MM, PITCH_MM, VISIBLE_MM = 1.25, 0.2, 0.85
N_STRIPS, N_ROWS, N_COLUMNS = 20, 64, 512
WALL_STEP_MM, WALL_COLUMNS = 0.01, 1024
RANGES: Mapping[str, Range] = {
    "jitter": (0.0, 0.2),
    "roll_deg": (0.0, 5.0),
    "dropped": (0.0, 0.3),
    "pattern": (0.0, 0.3),
    "texture": (0.01, 0.6),
    "pits": (0.0, 0.2),
}
"""``jitter``: rms of the feed, relative. ``roll_deg``: rms from frame to frame. ``dropped``: share of frames lost
without a gap in the numbers. ``pattern``: rms of what is fixed to the probe, and ``texture``: of the wall, both of the
logarithm of the brightness. ``pits``: share of the wall."""

TEXTURE_MM = (0.03, 0.12)
NOISE = 0.015
EXPOSURE = 0.03
PIT_MM, PIT_DEPTH_MM, PIT_DARKNESS = (0.2, 0.8), (0.05, 0.8), 0.8
SLANT = (0.1, 0.5)
"""A ray advances by so much z for 1 mm outward, at the first and the last row: cot(2a − ψ) of a cone of 45°."""


def toy_strips(
    seed: int, index: int, conditions: Mapping[str, float]
) -> tuple[tuple[Strip, ...], Coordinates, Coordinates]:
    """Return strips, their true z, mm, and roll, rad, float64 (n,), for the conditions of :data:`RANGES`."""
    rng = rng_of(seed, index, "motion")
    steps = 1 + rng.geometric(1 - conditions["dropped"], N_STRIPS - 1) - 1
    feeds = [PITCH_MM * np.clip(1 + conditions["jitter"] * rng.normal(size=k), 0.2, None).sum() for k in steps]
    z_mm = np.concatenate([[0.0], np.cumsum(feeds)])
    roll_rad = np.concatenate([[0.0], np.cumsum(np.deg2rad(conditions["roll_deg"]) * rng.normal(size=N_STRIPS - 1))])
    layers = _wall(rng_of(seed, index, "wall"), float(z_mm[-1]) + VISIBLE_MM + 0.6, conditions)
    light = _light(rng_of(seed, index, "probe"), conditions["pattern"])
    noise = rng_of(seed, index, "noise")
    rows_mm = VISIBLE_MM * ((np.arange(N_ROWS) + 0.5) / N_ROWS - 0.5)
    theta_rad = 2 * np.pi / N_COLUMNS * np.arange(N_COLUMNS, dtype=np.float64)
    whole = np.ones((N_ROWS, N_COLUMNS), np.bool_)
    strips = []
    for z, roll in zip(z_mm, roll_rad, strict=True):
        bright = np.exp(_log_brightness(layers, z + rows_mm, theta_rad + roll) + light + EXPOSURE * noise.normal())
        samples = np.maximum(bright + NOISE * noise.normal(size=whole.shape), 1e-3).astype(np.float32)
        strips.append(Strip(rows_mm, theta_rad, samples, None, whole, whole.astype(np.float32)))
    return tuple(strips), z_mm, roll_rad


def _wall(rng: np.random.Generator, length_mm: float, conditions: Mapping[str, float]) -> Image:
    """Return (depth of pits in mm, log brightness of the bone, log brightness of floors), float32 (3, z, θ)."""
    shape = int(length_mm / WALL_STEP_MM), WALL_COLUMNS
    column_mm = 2 * np.pi * RADIUS_MM / WALL_COLUMNS
    textures = []
    for _ in range(2):
        parts = [rng.normal(size=shape).astype(np.float32) for _ in TEXTURE_MM]
        smooth = [gaussian(p, mm / WALL_STEP_MM, mm / column_mm) for p, mm in zip(parts, TEXTURE_MM, strict=True)]
        total = np.sum([s / s.std() for s in smooth], axis=0)
        textures.append(conditions["texture"] * total / total.std())
    depth = np.zeros(shape, np.float32)
    z, theta = np.mgrid[: shape[0], :WALL_COLUMNS].astype(np.float32)
    while (depth > 0).mean() < conditions["pits"]:
        at_z, at_theta = rng.uniform(0, shape[0]), rng.uniform(0, WALL_COLUMNS)
        across = (np.mod(theta - at_theta + WALL_COLUMNS / 2, WALL_COLUMNS) - WALL_COLUMNS / 2) * column_mm
        pit = np.hypot((z - at_z) * WALL_STEP_MM, across) < rng.uniform(*PIT_MM) / 2
        depth[pit] = rng.uniform(*PIT_DEPTH_MM)
    floor = textures[1] - PIT_DARKNESS * np.minimum(1, 0.3 + depth)
    return np.stack([depth, textures[0], floor]).astype(np.float32)


def _log_brightness(layers: Image, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
    """Return the log brightness at places (rows, columns) of the wall; in pits, of the floor the ray goes on to."""
    slant = np.linspace(*SLANT, z_mm.size)[:, np.newaxis]
    columns = np.broadcast_to(theta_rad / (2 * np.pi) * WALL_COLUMNS, (z_mm.size, theta_rad.size))
    rows = np.broadcast_to(((z_mm + VISIBLE_MM / 2) / WALL_STEP_MM)[:, np.newaxis], columns.shape)

    def at_wall(layer: int, deeper_mm: Coordinates | float, order: int) -> Coordinates:
        at = rows + deeper_mm * slant / WALL_STEP_MM
        return np.asarray(map_coordinates(layers[layer], [at, columns], order=order, mode="grid-wrap"))

    depth = at_wall(0, 0.0, 0)
    return np.where(depth > 0, at_wall(2, depth, 1), at_wall(1, 0.0, 1))


def _light(rng: np.random.Generator, pattern: float) -> Coordinates:
    """Return the logarithm of what the probe itself does to the light, float64 (rows, columns)."""
    rows = np.linspace(-1, 1, N_ROWS)[:, np.newaxis]
    theta = 2 * np.pi / N_COLUMNS * np.arange(N_COLUMNS)
    slow = -0.3 * rows**2 + 0.25 * np.cos(theta - rng.uniform(0, 2 * np.pi))
    grain = gaussian(rng.normal(size=(N_ROWS, N_COLUMNS)).astype(np.float32), 1.5, 1.5)
    ring = np.exp(-0.5 * ((rows - rng.uniform(-0.8, 0.8)) / 0.04) ** 2)
    return np.asarray(slow + pattern * (grain / grain.std() + 2 * ring))
