"""The shape of one air cell."""

import math

import numpy as np

from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.synthetic.parameters import Cell

FIRST_HARMONIC = 2


def reach_mm(cell: Cell) -> float:
    """Return a distance from the centre beyond which the cell surely does not extend."""
    outline = 1 + sum(math.hypot(*harmonic) for harmonic in cell.outline)
    return outline * cell.diameter_mm / 2 / math.sqrt(cell.aspect)


def pit_mm(cell: Cell, z_mm: Coordinates, theta_rad: Coordinates, radius_mm: float) -> Coordinates:
    """Return how deep the cell is below the wall, > 0 inside its outline and 0 outside.

    ``z_mm`` (m, 1) and ``theta_rad`` (1, n) broadcast. Its walls fall steeply and its floor is rounded:
    depth · √(1 − s^steepness), where s runs from 0 at the centre to 1 on the outline.
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
    pit: Coordinates = cell.depth_mm * np.sqrt(1 - s**cell.steepness)
    return pit
