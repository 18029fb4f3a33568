"""The shape of one air cell, and drawing them."""

import math

import numpy as np
from numpy.random import Generator

from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.synthetic.parameters import Bore, Cell, Harmonic

FIRST_HARMONIC = 2


def reach_mm(cell: Cell) -> float:
    """Return a distance from the centre beyond which the cell surely does not extend."""
    outline = 1 + sum(math.hypot(*harmonic) for harmonic in cell.outline)
    return outline * cell.diameter_mm / 2 / math.sqrt(cell.aspect)


def pit_mm(cell: Cell, z_mm: Coordinates, theta_rad: Coordinates, radius_mm: float) -> Coordinates:
    """Return how deep the cell is below the wall, > 0 inside its outline and 0 outside.

    ``z_mm`` (m, 1) and ``theta_rad`` (1, n) broadcast. Its walls fall steeply and its floor is rounded:
    depth · √(1 − s^squareness), where s runs from 0 at the centre to 1 on the outline.
    """
    along = z_mm - cell.z_mm
    around = radius_mm * wrap_rad(theta_rad - cell.theta_rad)
    cos, sin = np.cos(cell.tilt_rad), np.sin(cell.tilt_rad)
    u = (cos * along + sin * around) * np.sqrt(cell.aspect) * 2 / cell.diameter_mm
    v = (cos * around - sin * along) / np.sqrt(cell.aspect) * 2 / cell.diameter_mm
    phi = np.arctan2(v, u)
    outline = np.ones_like(phi)
    for k, (cos_k, sin_k) in enumerate(cell.outline, FIRST_HARMONIC):
        outline += cos_k * np.cos(k * phi) + sin_k * np.sin(k * phi)
    s = np.minimum(np.hypot(u, v) / outline, 1.0)
    pit: Coordinates = cell.depth_mm * np.sqrt(1 - s**cell.squareness)
    return pit


MOST_CELL_FRACTION = 0.295
MOST_OUTLINE = 0.5


def draw_cells(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw cells until the wanted part of the wall is cut away; one that would exceed 0.295 is drawn anew."""
    radius_mm = bore.diameter_mm / 2
    z_mm = np.arange(0, bore.length_mm, 0.02)[:, None]
    theta_rad = np.linspace(0, 2 * np.pi, 512, endpoint=False)[None, :]
    cut = np.zeros((z_mm.size, theta_rad.size), np.bool_)
    cells: list[Cell] = []
    while cut.mean() < bore.cell_fraction:
        cell = _cell(rng, bore)
        near = np.abs(z_mm[:, 0] - cell.z_mm) <= reach_mm(cell)
        more = cut.copy()
        more[near] |= pit_mm(cell, z_mm[near], theta_rad, radius_mm) > 0
        if more.mean() <= MOST_CELL_FRACTION:
            cut = more
            cells.append(cell)
    return tuple(cells)


def _cell(rng: Generator, bore: Bore) -> Cell:
    diameter = float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    orders = np.arange(2, 8)
    outline = 0.3 * rng.normal(size=(orders.size, 2)) / orders[:, None] / math.sqrt(2)
    outline *= min(1.0, MOST_OUTLINE / float(np.hypot(*outline.T).sum()))
    harmonics: tuple[Harmonic, ...] = tuple((float(cos), float(sin)) for cos, sin in outline)
    depth = float(np.exp(rng.uniform(np.log(0.05), np.log(min(1.5, 1.1 * diameter)))))
    return Cell(
        z_mm=float(rng.uniform(0, bore.length_mm)),
        theta_rad=float(rng.uniform(0, 2 * np.pi)),
        diameter_mm=diameter,
        depth_mm=depth,
        bulge_mm=0.0,
        aspect=float(rng.uniform(0.6, 1)),
        tilt_rad=float(rng.uniform(0, np.pi)),
        lean_rad=float(rng.uniform(0, 0.6)),
        lean_direction_rad=float(rng.uniform(0, 2 * np.pi)),
        squareness=float(rng.uniform(3, 9)),
        outline=harmonics,
        edge_mm=0.01,
        lining=float(rng.uniform(0.55, 0.95)),
        rim_gain=float(rng.uniform(0.2, 0.8)) if rng.random() < 0.2 else 0.0,
        filling="air",
        fill_mm=depth,
    )
