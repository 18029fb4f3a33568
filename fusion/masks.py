"""Masks drawn by hand: as a side of a comparison, or as the truth to score one against."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.fusion.outcome import Comparison
from endoct.fusion.placement import IN_PLACE, Placement, check_same_bore
from endoct.fusion.prepare import MASK_MODALITY
from endoct.fusion.scores import agreement
from endoct.modalities.acquisition import read_toml, validate
from endoct.modalities.recording import open_stack
from endoct.stitching.arrays import Mask
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama


class MaskSidecar(BaseModel):
    """The sidecar NAME.toml of a mask image NAME.png."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    modality: Literal["mask"] = Field(description="that this image is a mask")
    bore_diameter_mm: float = Field(gt=0, description="nominal diameter of the drill hole; sets mm along θ")
    z0_mm: float = Field(description="place of the first row's centre along the bore, mm")
    dz_mm: float = Field(gt=0, description="distance of two rows, mm")


def read_mask(path: Path, like: Panorama | None = None) -> Panorama:
    """Read a mask image (PNG, TIFF, …; what is not zero is cell) as a panorama of the modality "mask".

    Rows are z, ascending, columns the full circle of θ from 0. A sidecar NAME.toml beside it says where its rows
    lie; without one it must have as many rows and columns as ``like`` and lies on its samples, also where these
    are uneven. Intensity is 0 or 1 and everything is valid.

    Raises :class:`EndoctError` where the image cannot be read, shows nothing, or nothing says where it lies.
    """
    if path.is_dir():
        raise EndoctError(
            f"{path} is no mask", found="a folder", expected="one image drawn over a panorama, PNG or TIFF"
        )
    stack = open_stack(path)
    if len(stack) != 1:
        raise EndoctError(f"{path} is no mask", found=f"{len(stack)} images", expected="one")
    samples = stack[0]
    cell: Mask = samples != 0 if samples.ndim == 2 else np.any(samples != 0, axis=2)
    if not cell.any() or cell.all():
        raise EndoctError(f"the mask {path} shows no cells", found="one and the same value everywhere")
    sidecar = path.with_suffix(".toml")
    if sidecar.is_file():
        return _panorama(cell, _grid(cell, validate(MaskSidecar, read_toml(sidecar), str(sidecar))), path, on=None)
    if like is None or cell.shape != like.grid.shape:
        found = f"{cell.shape[0]} × {cell.shape[1]} samples"
        raise EndoctError(
            f"nothing says where the mask {path} lies",
            found=found,
            expected=f"{like.grid.n_z} × {like.grid.n_theta}, as the {like.modality} panorama has" if like else "",
            remedy=f"draw it on that panorama, or write {sidecar.name} beside it with "
            'modality = "mask", bore_diameter_mm, z0_mm and dz_mm',
        )
    return _panorama(cell, like.grid, path, on=like)


def score_against(comparison: Comparison, truth: Panorama) -> dict[str, Any]:
    """Return each side's agreement with a mask in side A's frame, by side, over the samples that side observed.

    On the comparison's grid; JSON-serialisable, as :meth:`endoct.fusion.scores.Agreement.as_json`. Raises
    :class:`EndoctError` for another bore diameter.
    """
    grid = comparison.grid
    check_same_bore(comparison.grid.radius_mm, truth.grid.radius_mm)
    cells, seen = Placement(truth, IN_PLACE, grid, grid.z_mm, grid.dz_mm).mask(truth.intensity > 0.5, truth.valid)
    area_mm2 = grid.dz_mm * grid.dtheta_mm
    return {
        side: agreement(comparison.mask[k], cells, comparison.valid[k] & seen, area_mm2).as_json()
        for k, side in enumerate(comparison.sides)
    }


def _grid(cell: Mask, sidecar: MaskSidecar) -> SurfaceGrid:
    n_z, n_theta = cell.shape
    radius_mm = sidecar.bore_diameter_mm / 2
    return SurfaceGrid.full_circle(n_z, n_theta, z0_mm=sidecar.z0_mm, dz_mm=sidecar.dz_mm, radius_mm=radius_mm)


def _panorama(cell: Mask, grid: SurfaceGrid, path: Path, *, on: Panorama | None) -> Panorama:
    return Panorama(
        grid=grid,
        z_mm=grid.z_mm if on is None else on.z_mm,
        intensity=cell.astype(np.float32),
        depth_mm=None,
        valid=np.ones(cell.shape, np.bool_),
        weight=np.ones(cell.shape, np.float32),
        modality=MASK_MODALITY,
        # a mask drawn on the other side's panorama has its frame; of any other, nobody said
        handedness_known=on is not None,
        travel_known=on is not None,
        provenance={"notes": [], "drawn_on_other_side": on is not None, "mask": path.name},
    )
