"""Two panoramas of one made-up bore, with everything known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

RADIUS_MM = 1.25


@dataclass(frozen=True)
class Cells:
    """Elliptic pits: place along the bore (mm), around it (rad), radius (mm), flatness, depth (mm)."""

    z_mm: NDArray[np.float64]
    theta_rad: NDArray[np.float64]
    radius_mm: NDArray[np.float64]
    flatness: NDArray[np.float64]
    depth_mm: NDArray[np.float64]

    @classmethod
    def drawn(cls, seed: int, length_mm: float = 12.0) -> "Cells":
        rng = np.random.default_rng(seed)
        n = round(5 * length_mm)
        radius_mm = np.exp(rng.uniform(np.log(0.15), np.log(0.6), n))
        return cls(
            rng.uniform(0, length_mm, n),
            rng.uniform(0, 2 * np.pi, n),
            radius_mm,
            rng.uniform(0.6, 1.0, n),
            rng.uniform(0.15, 0.8, n),
        )

    def relief_mm(self, z_mm: NDArray[np.float64], theta_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depth behind the wall at every z × θ."""
        relief = np.zeros((z_mm.size, theta_rad.size))
        for z, theta, radius, flatness, depth in zip(
            self.z_mm, self.theta_rad, self.radius_mm, self.flatness, self.depth_mm, strict=True
        ):
            rows = np.flatnonzero(np.abs(z_mm - z) < radius)
            across = RADIUS_MM * (np.mod(theta_rad - theta + np.pi, 2 * np.pi) - np.pi)
            squared = ((z_mm[rows] - z)[:, np.newaxis] / radius) ** 2 + (across / (radius * flatness)) ** 2
            relief[rows] = np.maximum(relief[rows], depth * np.clip(1 - squared**3, 0, None))
        return relief

    def seen_mm(self, z_mm: NDArray[np.float64], theta_rad: NDArray[np.float64], slant: float) -> NDArray[np.float64]:
        """Return the depth at which rays end that meet z × θ of the wall and go on by ``slant`` mm for 1 mm outward."""
        if slant == 0:
            return self.relief_mm(z_mm, theta_rad)
        depths = np.linspace(0.8, 0, 17)
        seen = np.full((z_mm.size, theta_rad.size), depths[0])
        for depth in depths:
            seen[self.relief_mm(z_mm + slant * depth, theta_rad) <= depth] = depth
        return seen


@dataclass(frozen=True)
class Pair:
    """A: intensity only, dense rows. B: depth, wide rows. And where B truly lies in A's frame."""

    a: Panorama
    b: Panorama
    truth: Alignment
    cells_a: NDArray[np.bool_]
    cells_b: NDArray[np.bool_]


def panorama(
    intensity: NDArray[np.floating],
    *,
    dz_mm: float,
    depth_mm: NDArray[np.floating] | None = None,
    valid: NDArray[np.bool_] | None = None,
    modality: str = "camera",
    known: bool = True,
    radius_mm: float = RADIUS_MM,
) -> Panorama:
    """Return a panorama that starts at z = 0 and θ = 0."""
    n_z, n_theta = intensity.shape
    grid = SurfaceGrid.full_circle(n_z, n_theta, z0_mm=0.0, dz_mm=dz_mm, radius_mm=radius_mm)
    valid = np.ones(intensity.shape, np.bool_) if valid is None else valid
    return Panorama(
        grid=grid,
        intensity=np.asarray(intensity, np.float32),
        depth_mm=None if depth_mm is None else np.asarray(depth_mm, np.float32),
        valid=valid,
        weight=valid.astype(np.float32),
        modality=modality,
        handedness_known=known,
        travel_known=known,
    )


def make_pair(
    seed: int = 0,
    *,
    mirrored: bool = False,
    z_reversed: bool = False,
    theta_shift_rad: float = 2.0,
    z_scale: float = 1.0,
    overlap: float = 0.8,
    bright_cells: bool = False,
    known: bool = False,
    other_bore: bool = False,
    rows: int = 30,
    slant: float = 0.0,
) -> Pair:
    rng = np.random.default_rng(seed + 1000)
    bore = Cells.drawn(seed)
    n_theta, dz_a, dz_b = 512, 0.05, 0.2
    length = rows * dz_b
    theta = 2 * np.pi / n_theta * np.arange(n_theta)
    z_a = dz_a * np.arange(round(length / dz_a))
    z_b = dz_b * np.arange(rows)
    sense, direction = (-1 if mirrored else 1), (-1 if z_reversed else 1)
    z_shift = (1 - overlap) * length + (z_scale * z_b[-1] if z_reversed else 0.0)
    truth = Alignment(np.mod(theta_shift_rad, 2 * np.pi), z_shift, z_scale, mirrored, z_reversed)
    relief_a = bore.seen_mm(z_a, theta, slant)
    theta_b = np.mod(theta_shift_rad + sense * theta, 2 * np.pi)
    seen_by_b = Cells.drawn(seed + 500) if other_bore else bore
    z_of_b = z_shift + z_scale * direction * z_b
    order = np.argsort(z_of_b)
    relief_b = seen_by_b.relief_mm(z_of_b[order], theta_b)[np.argsort(order)]
    light = 1 + 0.3 * np.cos(theta - 1)
    dark = light * np.exp(-relief_a / 0.4) * (1 + 0.05 * rng.normal(size=relief_a.shape)) + 0.02
    wall = 0.03 * np.cos(theta - 2) + 0.01 * np.sin(z_b / 2)[:, np.newaxis]
    depth = relief_b + wall + 0.008 * rng.normal(size=relief_b.shape)
    a = panorama(1.5 - dark if bright_cells else dark, dz_mm=dz_a, known=known)
    b = panorama(
        rng.gamma(2, 1, relief_b.shape) / (1 + 3 * relief_b), dz_mm=dz_b, depth_mm=depth, modality="ranger", known=known
    )
    return Pair(a, b, truth, relief_a > 0.02, relief_b > 0.02)
