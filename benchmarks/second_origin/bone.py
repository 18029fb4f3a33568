"""Bone with air in it: segmented slices of a real one, or ellipsoids, and a straight bore through it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

Floats = NDArray[np.floating[Any]]
MADE_MM, MADE_VOXELS = 0.15, 300
WALL_MM, DEEPEST_MM = 0.03, 2.2
"""Between places of the wall, and how far behind it a floor is looked for."""
REACH_MM = 11.0
"""Of bone beside and beyond a bore."""


@dataclass(frozen=True, eq=False)
class Bone:
    """``air`` (k, j, i) float32, 1 in air and 0 in bone; the voxel [k, j, i] lies at ``voxel_mm`` · (i, j, k)."""

    air: NDArray[np.float32]
    voxel_mm: float

    def share(self, places_mm: Floats) -> NDArray[np.float32]:
        """Return the share of air at places (…, 3), float32 (…); beyond the bone as at its border."""
        at = np.moveaxis(places_mm[..., ::-1] / self.voxel_mm, -1, 0)
        low = np.maximum(np.floor(at.reshape(3, -1).min(axis=1)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(at.reshape(3, -1).max(axis=1)).astype(int) + 3, self.air.shape)
        part = self.air[tuple(slice(a, max(b, a + 1)) for a, b in zip(low, high, strict=True))]
        shifted = at - low.reshape(3, *[1] * (at.ndim - 1))
        return np.asarray(ndimage.map_coordinates(part, shifted, order=1, mode="nearest"), dtype=np.float32)


def segmented(folder: Path, voxel_mm: float) -> Bone:
    """Return the bone in a folder of slices, where it is where their last channel is not 0."""
    # numbers are not padded alike: plane000, plane0010, plane00100
    slices = sorted(folder.glob("*.png"), key=lambda path: (len(path.stem), path.stem))
    air = np.stack([np.asarray(Image.open(path))[..., -1] == 0 for path in slices])
    return Bone(air.astype(np.float32), voxel_mm)


def made_of_ellipsoids(rng: Generator, bore: Floats, length_mm: float, *, sparse: bool) -> Bone:
    """Return bone with sharp cells around a bore (4, 4): all along it, or in one third of it and on 4 to 8 % of it."""
    air = np.zeros((MADE_VOXELS,) * 3, np.float32)
    third = rng.uniform(0, 2 / 3) * length_mm
    ends = (third, third + length_mm / 3) if sparse else (-4.0, length_mm + 4.0)
    wanted = rng.uniform(0.04, 0.08) if sparse else rng.uniform(0.1, 0.3)
    bone = Bone(air, MADE_MM)
    for number in range(4000):
        middle = bore[:3, :3] @ np.array([*(6 * _in_disc(rng)), rng.uniform(*ends)]) + bore[:3, 3]
        _carve(air, middle, np.exp(rng.normal(np.log(0.75), 0.45, 3)), rng)
        if number % 4 == 3 and (bone.share(wall_places(bore, length_mm, 1.25, 0.1)) > 0.5).mean() > wanted:
            break
    return bone


def wall_places(bore: Floats, length_mm: float, radius_mm: float, step_mm: float) -> Floats:
    """Return places (n_z, n_theta, 3) of a bore's wall, rows from its mouth on."""
    n_theta = round(2 * np.pi * radius_mm / step_mm)
    z, theta = np.arange(0, length_mm, step_mm), 2 * np.pi / n_theta * np.arange(n_theta)
    rays = np.stack([np.cos(theta), np.sin(theta)], axis=-1) @ bore[:3, :2].T
    return np.asarray(bore[:3, 3] + z[:, None, None] * bore[:3, 2] + radius_mm * rays)


def drilled_line(bone: Bone, rng: Generator, length_mm: float) -> Floats:
    """Return a bore frame (4, 4) in a real bone whose wall has 4 to 40 % air, all of it inside the bone."""
    extent = bone.voxel_mm * (np.array(bone.air.shape[::-1]) - 1)
    for _ in range(20_000):
        bore = frame(rng.uniform(REACH_MM / 2, extent - REACH_MM / 2), rng)
        end = bore[:3, 3] + length_mm * bore[:3, 2]
        if (end < REACH_MM / 2).any() or (end > extent - REACH_MM / 2).any():
            continue
        air = bone.share(wall_places(bore, length_mm, 1.25, 0.3)) > 0.5
        far = bone.share(wall_places(bore, length_mm, 4.0, 0.8)) > 0.5
        if 0.04 < air.mean() < 0.4 and far.mean() < 0.5 and air.mean(axis=1).max() < 0.85:
            return bore
    raise ValueError("no line through this bone was found")


def frame(origin_mm: Floats, rng: Generator) -> Floats:
    """Return a frame (4, 4), any direction as likely."""
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    placed = np.eye(4)
    placed[:3, :3] = turned * np.sign(np.linalg.det(turned))
    placed[:3, 3] = origin_mm
    return placed


def _carve(air: NDArray[np.float32], middle_mm: Floats, radii_mm: Floats, rng: Generator) -> None:
    reach = float(radii_mm.max())
    low = np.maximum(np.floor((middle_mm - reach) / MADE_MM).astype(int), 0)
    high = np.minimum(np.ceil((middle_mm + reach) / MADE_MM).astype(int) + 1, air.shape[0])
    if (high <= low).any():
        return
    x, y, z = (MADE_MM * np.arange(a, b) - m for a, b, m in zip(low, high, middle_mm, strict=True))
    k, j, i = np.meshgrid(z, y, x, indexing="ij")
    along = np.stack([i, j, k], axis=-1) @ frame(middle_mm, rng)[:3, :3]
    inside = ((along / radii_mm) ** 2).sum(axis=-1) < 1
    air[low[2] : high[2], low[1] : high[1], low[0] : high[0]][inside] = 1


def _in_disc(rng: Generator) -> Floats:
    angle = rng.uniform(0, 2 * np.pi)
    return np.asarray(np.sqrt(rng.random()) * np.array([np.cos(angle), np.sin(angle)]))
