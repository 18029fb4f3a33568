"""Air in the bone around a planned bore: a CT resampled along the plan, with its gradient, in torch."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import LABEL_SIGMA_VOXELS, CtVolume, holds_labels, part_around
from endoct.modalities.ct.trajectory import Trajectory, as_point

STEP_MM = 0.15
"""Distance of the samples, half a clinical voxel. A cubic spline joins voxels, straight lines join these samples."""
ASIDE_MM, BEYOND_MM = 7.0, 7.0
AIR_HU, BONE_HU = -1000.0, 300.0
SPLINE_VOXELS = 16
"""Voxels farther away than this move a cubic spline by less than a billionth of their value."""
LEAST_INSIDE = 0.7
"""Share of the samples around the plan that must lie in the CT."""


@dataclass(frozen=True, eq=False)
class AirAround:
    """The share of air at places of the plan's bore frame.

    ``values``, float32 (1, 4, z, y, x), are the share, 0 for bone to 1 for air, and its derivatives by x, y and z in
    1/mm. ``corner_mm`` is x, y and z of the first sample; ``length_mm`` is that of the plan.
    """

    values: torch.Tensor
    corner_mm: tuple[float, float, float]
    length_mm: float

    def to(self, device: str) -> "AirAround":
        """Return the same on another device of torch."""
        return AirAround(self.values.to(device), self.corner_mm, self.length_mm)

    def share(self, places_mm: torch.Tensor) -> torch.Tensor:
        """Return the share of air at places (…, 3), float32 (…)."""
        return self._sampled(self.values[:, :1], places_mm)[0]

    def share_and_gradient(self, places_mm: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the share at places (…, 3), and its gradient (3, …) in 1/mm, float32."""
        sampled = self._sampled(self.values, places_mm)
        return sampled[0], sampled[1:]

    def _sampled(self, values: torch.Tensor, places_mm: torch.Tensor) -> torch.Tensor:
        extent = torch.tensor(values.shape[:1:-1], dtype=places_mm.dtype, device=places_mm.device) - 1
        corner = torch.tensor(self.corner_mm, dtype=places_mm.dtype, device=places_mm.device)
        within = ((places_mm - corner) * (2 / STEP_MM) / extent - 1).to(torch.float32)
        at = torch.nn.functional.grid_sample(
            values, within.reshape(1, 1, 1, -1, 3), mode="bilinear", padding_mode="border", align_corners=True
        )
        return at.reshape(values.shape[1], *places_mm.shape[:-1])


def air_around(ct: CtVolume, plan: Trajectory) -> AirAround:
    """Return the air around ``plan``. Raises :class:`EndoctError` where the plan lies outside ``ct`` or in no bone."""
    corner = np.array([-ASIDE_MM, -ASIDE_MM, -BEYOND_MM])
    across = 1 + round(2 * ASIDE_MM / STEP_MM)
    shape = (1 + round((plan.length_mm + 2 * BEYOND_MM) / STEP_MM), across, across)
    axes = plan.to_lps[:3, :3]
    ends = np.stack([corner, corner + STEP_MM * (np.array(shape[::-1]) - 1)])
    corners = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3) @ axes.T + plan.to_lps[:3, 3]
    # of a CT of the whole head, only this part is turned into splines
    part = part_around(ct, corners, SPLINE_VOXELS * float(np.linalg.norm(ct.steps_mm, axis=1).max()))
    to_index = np.linalg.inv(ct.steps_mm)
    matrix = (STEP_MM * axes[:, ::-1].T @ to_index).T
    offset = (axes @ corner + plan.to_lps[:3, 3] - part.origin_mm) @ to_index

    def resampled(values: Image, order: int, outside: str) -> Image:
        at = ndimage.affine_transform(values, matrix, offset, shape, np.float32, order, outside)
        return np.asarray(at, dtype=np.float32)

    everywhere = np.ones(part.voxels.shape, np.float32)
    inside = float(resampled(everywhere, 0, "constant").mean()) if part.voxels.size else 0.0
    if inside < LEAST_INSIDE:
        raise EndoctError(
            "the plan lies outside the CT",
            found=f"{inside:.0%} of its surroundings within the CT",
            expected=f"{LEAST_INSIDE:.0%} at least, {ASIDE_MM:g} mm around the axis",
            remedy="check entry, target and --coordinates",
        )
    if holds_labels(ct, "the CT", remedy="export Hounsfield units, air at about -1000"):
        air = ndimage.gaussian_filter((part.voxels == 0).astype(np.float32), LABEL_SIGMA_VOXELS)
        share = resampled(air, 1, "nearest")
    else:
        hounsfield = resampled(part.voxels.astype(np.float32), 3, "nearest")
        dense = hounsfield[hounsfield > BONE_HU]
        if dense.size < 0.02 * hounsfield.size:
            raise EndoctError(
                "there is no bone around the plan",
                found=f"{dense.size / hounsfield.size:.1%} of at least {BONE_HU:g} HU",
                remedy="check entry, target and --coordinates",
            )
        bone = float(np.median(dense))
        share = np.clip((bone - hounsfield) / np.float32(bone - AIR_HU), 0, 1)
    by_z, by_y, by_x = np.gradient(share, STEP_MM)
    values = torch.from_numpy(np.stack([share, by_x, by_y, by_z]).astype(np.float32))[None]
    return AirAround(values, as_point(corner), plan.length_mm)
