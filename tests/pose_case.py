"""A CT of made-up cells with a bore in it, and what two instruments see of its wall: sampled, not rendered."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.ct.trajectory import Trajectory, axes_at
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame

VOXEL_MM, SHAPE = 0.3, (74, 56, 52)
ORIGIN = np.array([-35.0, 20.0, -8.0])
"""Of the CT, LPS; its voxels run along i to the left, j to the back, k to the head."""
AIR_HU, BONE_HU = -1000.0, 1400.0
RADIUS_MM, LENGTH_MM, SEEN_MM = 1.25, 12.0, (0.8, 11.2)
RAS = np.array([-1.0, -1.0, 1.0])
NERVE_ASIDE_MM, NERVE_RADIUS_MM = 3.2, 0.7


@dataclass(frozen=True, eq=False)
class PoseCase:
    """A bore off its ``plan``: ``to_lps`` of the true bore frame; ``seed`` of the bone."""

    seed: int
    plan: Trajectory
    to_lps: Coordinates

    @classmethod
    def drawn(cls, seed: int = 5) -> "PoseCase":
        rng = np.random.default_rng(seed)
        middle = ORIGIN + VOXEL_MM * (np.array(SHAPE[::-1]) - 1) / 2
        to_plan = axes_at(middle, np.array([0.12, -0.1, 1.0]))
        entry = middle - LENGTH_MM / 2 * to_plan[:3, 2]
        plan = Trajectory(_point(entry), _point(entry + LENGTH_MM * to_plan[:3, 2]))
        aside, tilt = rng.uniform(-0.5, 0.5, 2), np.radians(rng.uniform(-1.2, 1.2, 2))
        inward = plan.to_lps[:3, :3] @ np.array([np.tan(tilt[0]), np.tan(tilt[1]), 1.0])
        start = plan.to_lps[:3, :3] @ np.array([*aside, 0.3]) + plan.to_lps[:3, 3]
        return cls(seed, plan, axes_at(start, inward))

    @cached_property
    def air(self) -> Image:
        """The share of air in every voxel of the CT, (k, j, i)."""
        field = ndimage.gaussian_filter(np.random.default_rng(self.seed).normal(size=SHAPE), 0.55 / VOXEL_MM)
        sharp = np.clip((field / field.std() - 0.45) * 3, 0, 1)
        return np.asarray(ndimage.gaussian_filter(sharp, 0.4), dtype=np.float32)

    def write_ct(self, path: Path, *, turned: bool = False, sheared: bool = False, labels: bool = False) -> Path:
        """Write the CT, or its labels; ``turned``: the first two axes run to the right and the front."""
        voxels = self.labels if labels else np.rint(BONE_HU + (AIR_HU - BONE_HU) * self.air).astype(np.int16)
        direction, origin = np.eye(3), ORIGIN
        if turned:
            voxels, direction = voxels[:, ::-1, ::-1], np.diag([-1.0, -1.0, 1.0])
            origin = ORIGIN + VOXEL_MM * np.array([SHAPE[2] - 1, SHAPE[1] - 1, 0.0])
        if sheared:
            direction = np.array([[1.0, 0.2, 0], [0, np.sqrt(1 - 0.04), 0], [0, 0, 1.0]])
        image = sitk.GetImageFromArray(np.ascontiguousarray(voxels))
        image.SetSpacing((VOXEL_MM,) * 3)
        image.SetOrigin(origin.tolist())
        image.SetDirection(direction.ravel().tolist())
        if labels:  # as 3D Slicer names segments, where the format has room for that
            for number, name in enumerate(("bone", "facial nerve")):
                image.SetMetaData(f"Segment{number}_Name", name)
                image.SetMetaData(f"Segment{number}_LabelValue", str(number + 1))
        sitk.WriteImage(image, str(path))
        return path

    @property
    def labels(self) -> Image:
        """0 air, 1 bone, 2 a nerve that crosses beside the bore, 2 mm before its end, along x of the bore frame."""
        places = np.stack(np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij"), axis=-1)[..., ::-1] * VOXEL_MM
        local = (places + ORIGIN - self.to_lps[:3, 3]) @ self.to_lps[:3, :3]
        apart = np.hypot(local[..., 1] - NERVE_ASIDE_MM, local[..., 2] - (LENGTH_MM - 2))
        return np.where(apart < NERVE_RADIUS_MM, 2, self.air < 0.5).astype(np.uint8)

    def share(self, local_mm: Coordinates) -> Image:
        """Return the share of air at places (…, 3) of the true bore frame."""
        index = (local_mm @ self.to_lps[:3, :3].T + self.to_lps[:3, 3] - ORIGIN) / VOXEL_MM
        at = ndimage.map_coordinates(self.air, np.moveaxis(index[..., ::-1], -1, 0), order=1, mode="nearest")
        return np.asarray(at, dtype=np.float32)

    def panorama(self, modality: str, *, turn_rad: float = 0.7, columns: int = 192) -> Panorama:
        """Return what an instrument sees: "ranger" depth and intensity, "camera" intensity alone."""
        grid = SurfaceGrid.full_circle(
            round((SEEN_MM[1] - SEEN_MM[0]) / 0.1) + 1, columns, z0_mm=0.0, dz_mm=0.1, radius_mm=RADIUS_MM
        )
        rng = np.random.default_rng([self.seed, len(modality)])
        z, theta = np.meshgrid(grid.z_mm + SEEN_MM[0], grid.theta_rad + turn_rad, indexing="ij")

        def at(behind_mm: float) -> Image:
            radius = RADIUS_MM + behind_mm
            return self.share(np.stack([radius * np.cos(theta), radius * np.sin(theta), z], axis=-1))

        wall = at(0.05) + 0.05 * rng.normal(size=grid.shape).astype(np.float32)
        depth = np.full(grid.shape, 1.4, np.float32)
        for behind in np.arange(1.4, -0.01, -0.05):
            depth[at(float(behind)) < 0.5] = behind
        valid = np.ones(grid.shape, np.bool_)
        return Panorama(
            grid=grid,
            intensity=np.maximum(1 - 0.7 * wall, 0.02).astype(np.float32),
            depth_mm=depth if modality == "ranger" else None,
            valid=valid,
            weight=valid.astype(np.float32),
            modality=modality,
            handedness_known=True,
            travel_known=True,
            frame_dim="frame",
            per_frame={"frame_z_mm": PerFrame(grid.z_mm, "mm", "place along the bore")},
            provenance={"parameters": {}, "inputs": {f"{modality}.tif": "0" * 64}},
        )


def text(place: tuple[float, float, float] | Coordinates) -> str:
    """Return a place as the command line takes it."""
    return ",".join(repr(float(value)) for value in place)


def _point(place: Coordinates) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in place)
    return x, y, z
