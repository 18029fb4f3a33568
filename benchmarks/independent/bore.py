"""A bore whose cells have star-shaped, ragged outlines; everything else about the wall follows from noise."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.independent.recipe import BoreRecipe

Floats = NDArray[np.floating[Any]]
Map = NDArray[np.float32]
STEP_MM = 0.006
GAP_MM = 0.06
_HARMONICS = np.arange(2, 8)


@dataclass(frozen=True)
class Cell:
    """One cell: its centre, mean radius, outline (amplitude and phase of each harmonic), floor and brightness."""

    theta_rad: float
    z_mm: float
    radius_mm: float
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]
    depth_mm: float
    slope: tuple[float, float]
    steepness: float
    brightness: float

    def level(self, across_mm: Floats, along_mm: Floats) -> Floats:
        """Return distance from the centre over that of the outline: under 1 inside the cell."""
        angle = np.arctan2(along_mm, across_mm)[..., None] * _HARMONICS
        outline = 1 + (np.array(self.amplitude) * np.cos(angle + np.array(self.phase))).sum(axis=-1)
        return np.asarray(np.hypot(across_mm, along_mm) / (self.radius_mm * outline))


@dataclass(frozen=True, eq=False)
class Bore:
    """A bore on a fine (z, θ) grid from z = 0, θ = 0; ``level`` < 1 in cells, ``relief_mm`` behind the wall.

    ``number`` is the cell that is nearest in level, an index into ``cells``. ``albedo`` is the wall's own brightness
    about 1, ``scatter`` that of the bone in OCT; the two are unrelated.
    """

    radius_mm: float
    cells: tuple[Cell, ...]
    level: Map
    relief_mm: Map
    number: NDArray[np.int32]
    albedo: Map
    scatter: Map

    @property
    def length_mm(self) -> float:
        return float(self.level.shape[0] * STEP_MM)

    def places(self, theta_rad: Floats, z_mm: Floats) -> tuple[Floats, Floats]:
        """Return fractional (row, column) on the maps; columns wrap within the map."""
        columns = np.mod(theta_rad, 2 * np.pi) * (self.level.shape[1] / (2 * np.pi))
        return np.asarray(z_mm) / STEP_MM, columns

    def at(self, values: Map, theta_rad: Floats, z_mm: Floats) -> Map:
        """Return a map's values at places on the wall, bilinearly; the nearest row beyond the ends."""
        rows, columns = np.broadcast_arrays(*self.places(theta_rad, z_mm))
        rows = np.clip(rows, 0, values.shape[0] - 1.001)
        row, column = rows.astype(np.intp), columns.astype(np.intp)
        down, right = (rows - row).astype(np.float32), (columns - column).astype(np.float32)
        column %= values.shape[1]
        beside = (column + 1) % values.shape[1]
        upper = values[row, column] * (1 - right) + values[row, beside] * right
        lower = values[row + 1, column] * (1 - right) + values[row + 1, beside] * right
        return np.asarray(upper * (1 - down) + lower * down, dtype=np.float32)

    def nearest(self, values: NDArray[np.int32] | Map, theta_rad: Floats, z_mm: Floats) -> NDArray[Any]:
        """Return a map's values at the nearest samples."""
        rows, columns = self.places(theta_rad, z_mm)
        row = np.clip(np.rint(rows), 0, values.shape[0] - 1).astype(np.intp)
        return np.asarray(values[row, np.rint(columns).astype(np.intp) % values.shape[1]])

    def is_cell(self, theta_rad: Floats, z_mm: Floats) -> NDArray[np.bool_]:
        """Return where the wall at r = R is missing (any shape)."""
        return self.at(self.level, theta_rad, z_mm) < 1


def drill(recipe: BoreRecipe, rng: Generator) -> Bore:
    """Return a bore with cells that do not touch; fewer than asked for where they find no room."""
    radius = recipe.diameter_mm / 2
    shape = round(recipe.length_mm / STEP_MM), round(2 * np.pi * radius / STEP_MM)
    level = np.full(shape, 9.0, np.float32)
    relief = np.zeros(shape, np.float32)
    number = np.zeros(shape, np.int32)
    cells: list[Cell] = []
    for _ in range(40 * recipe.cells):
        if len(cells) == recipe.cells:
            break
        cell = _draw(recipe, rng)
        if all(
            np.hypot(radius * _wrap(cell.theta_rad - c.theta_rad), cell.z_mm - c.z_mm)
            > 1.15 * (cell.radius_mm + c.radius_mm) + GAP_MM
            for c in cells
        ):
            _carve(cell, len(cells), radius, level, relief, number)
            cells.append(cell)
    wall = level >= 1
    rough = recipe.roughness_mm * _noise(shape, 0.05, rng)
    relief += np.where(wall, rough, 2 * rough).astype(np.float32)
    albedo = 1 + recipe.texture * (0.75 * _noise(shape, 0.03, rng) + 0.65 * _noise(shape, 0.25, rng))
    scatter = np.exp(0.35 * _noise(shape, 0.09, rng) + 0.25 * _noise(shape, 0.6, rng))
    return Bore(
        radius,
        tuple(cells),
        level,
        relief,
        number,
        np.maximum(albedo, 0.2).astype(np.float32),
        scatter.astype(np.float32),
    )


def _draw(recipe: BoreRecipe, rng: Generator) -> Cell:
    amplitude = recipe.ragged * rng.normal(size=_HARMONICS.size) / (_HARMONICS - 1) ** 0.8
    amplitude *= min(1.0, 0.55 / max(float(np.abs(amplitude).sum()), 1e-9))
    tilt, way = rng.uniform(0, recipe.floor_slope), rng.uniform(0, 2 * np.pi)
    return Cell(
        theta_rad=float(rng.uniform(0, 2 * np.pi)),
        z_mm=float(rng.uniform(*recipe.cells_mm)),
        radius_mm=float(rng.uniform(*recipe.size_mm) / 2),
        amplitude=tuple(amplitude.tolist()),
        phase=tuple(rng.uniform(0, 2 * np.pi, _HARMONICS.size).tolist()),
        depth_mm=float(rng.uniform(*recipe.depth_mm)),
        slope=(float(tilt * np.cos(way)), float(tilt * np.sin(way))),
        steepness=float(rng.uniform(3, 9)),
        brightness=float(rng.uniform(*recipe.floor_brightness)),
    )


def _carve(cell: Cell, index: int, radius_mm: float, level: Map, relief: Map, number: NDArray[np.int32]) -> None:
    reach = 1.8 * cell.radius_mm
    n_z, n_theta = level.shape
    rows = np.arange(max(0, int((cell.z_mm - reach) / STEP_MM)), min(n_z, int((cell.z_mm + reach) / STEP_MM) + 2))
    turn = 2 * np.pi / n_theta
    half = min(n_theta // 2 - 1, int(reach / (radius_mm * turn)) + 2)
    columns = round(cell.theta_rad / turn) + np.arange(-half, half + 1)
    across = radius_mm * (columns * turn - cell.theta_rad)[None, :]
    along = (rows * STEP_MM - cell.z_mm)[:, None]
    across, along = np.broadcast_arrays(across, along)
    own = cell.level(across, along)
    place = np.ix_(rows, columns % n_theta)
    floor = cell.depth_mm * (1 + (cell.slope[0] * across + cell.slope[1] * along) / cell.radius_mm)
    depth = np.maximum(floor, 0.12) * np.sqrt(np.clip(1 - own**cell.steepness, 0, 1))
    nearer = own < level[place]
    level[place] = np.where(nearer, own, level[place])
    number[place] = np.where(nearer, index, number[place])
    relief[place] = np.maximum(relief[place], depth)


def _noise(shape: tuple[int, int], length_mm: float, rng: Generator) -> Floats:
    """Return smooth noise of unit variance, periodic around the bore."""
    coarse = max(1, int(length_mm / STEP_MM / 3))
    small = shape[0] // coarse + 8, max(8, round(shape[1] / coarse))
    sigma = length_mm / STEP_MM / coarse
    values = ndimage.gaussian_filter(rng.normal(size=small), sigma, mode="wrap")
    values /= values.std()
    rows = np.arange(shape[0]) / coarse
    columns = np.arange(shape[1]) * (small[1] / shape[1])
    return _periodic(values, rows, columns)


def _periodic(values: Floats, rows: Floats, columns: Floats) -> Floats:
    row, column = rows.astype(np.intp), columns.astype(np.intp)
    down, right = (rows - row)[:, None], columns - column
    n = values.shape[1]
    upper = values[row][:, column % n] * (1 - right) + values[row][:, (column + 1) % n] * right
    lower = values[row + 1][:, column % n] * (1 - right) + values[row + 1][:, (column + 1) % n] * right
    return np.asarray(upper * (1 - down) + lower * down)


def _wrap(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
