"""Masks drawn by hand: as a side of a comparison, or as the truth to score one against."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.fusion.evidence.prepare import MASK_MODALITY
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore
from endoct.fusion.result import MaskScores
from endoct.fusion.scoring.cells import Surface, label_in_order, measure
from endoct.fusion.scoring.scores import mask_scores
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import read_toml, validate
from endoct.stitching.arrays import Mask
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama


class MaskSidecar(BaseModel):
    """The sidecar NAME.toml of a mask image NAME.png."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    modality: Literal["mask"] = Field(description="that this image is a mask")
    bore_diameter_mm: float = Field(ge=0.1, le=100, description="nominal diameter of the drill hole; sets mm along θ")
    z0_mm: float = Field(ge=-1e4, le=1e4, description="place of the first row's centre along the bore, mm")
    dz_mm: float = Field(ge=1e-4, le=100, description="distance of two rows, mm")
    rater: str | None = Field(
        default=None, max_length=100, description="who drew it; left out, as the file's name says"
    )
    session: str | None = Field(default=None, max_length=100, description="when; else as the file's name says")


def read_mask(path: Path, like: Panorama | None = None) -> Panorama:
    """Read a mask as a panorama of the modality "mask": an image, labels in Zarr, or outlines of napari or Fiji.

    :mod:`endoct.fusion.files.drawings` says which files. Rows are z, ascending, columns the full circle of θ from 0. A
    sidecar NAME.toml beside it says where its rows lie; without one it must have as many rows and columns as ``like``
    and lies on its samples, also where these are uneven. Intensity is 0 or 1 and everything is valid. Its provenance
    names ``rater`` and ``session``: by the sidecar, else by the file's name, RATER_SESSION.png; a name without "_" is
    a rater's only session, "1".

    Raises :class:`EndoctError` where the image cannot be read, shows nothing, or nothing says where it lies.
    """
    cell = read_drawing(path, None if like is None else like.grid.shape)
    sidecar = path.with_suffix(".toml")
    if sidecar.is_file():
        told = validate(MaskSidecar, read_toml(sidecar), str(sidecar))
        return _panorama(cell, _grid(cell, told), path, on=None, told=told)
    if like is None or cell.shape != like.grid.shape:
        found = f"{cell.shape[0]} × {cell.shape[1]} samples"
        raise EndoctError(
            f"nothing says where the mask {path} lies",
            found=found,
            expected=f"{like.grid.n_z} × {like.grid.n_theta}, as the {like.modality} panorama has" if like else "",
            remedy=f"draw it on that panorama, or write {sidecar.name} beside it with "
            'modality = "mask", bore_diameter_mm, z0_mm and dz_mm',
        )
    return mask_on(cell, like, path)


def mask_on(cell: Mask, like: Panorama, path: Path) -> Panorama:
    """Return ``cell``, bool on the samples of ``like``, as :func:`read_mask` returns what is drawn there."""
    return _panorama(cell, like.grid, path, on=like)


def score_against(comparison: Comparison, truth: Panorama, tolerance_mm: float = 0.1) -> dict[str, MaskScores]:
    """Return the scores of each side against a mask in side A's frame, by side, over what that side observed.

    On the comparison's grid. Raises :class:`EndoctError` for another bore diameter.
    """
    return score_surface(comparison, on_comparison(comparison, truth), tolerance_mm)


def on_comparison(comparison: Comparison, truth: Panorama) -> Surface:
    """Return a mask in side A's frame on the comparison's grid."""
    grid = comparison.grid
    check_same_bore(grid.radius_mm, truth.grid.radius_mm)
    cells, seen = Placement(truth, IN_PLACE, grid, grid.z_mm, grid.dz_mm).mask(truth.intensity > 0.5, truth.valid)
    return Surface("given truth", cells, seen)


def score_surface(comparison: Comparison, truth: Surface, tolerance_mm: float) -> dict[str, MaskScores]:
    """Return as :func:`score_against` the scores of each side against ``truth`` on the comparison's grid."""
    grid, scores = comparison.grid, {}
    of_truth = label_in_order(truth.mask)
    for k, name in enumerate(comparison.sides):
        side = Surface(name, comparison.mask[k], comparison.valid[k])
        cells = measure((truth, side), (of_truth, label_in_order(side.mask)), grid, aligned=True)
        scores[name] = mask_scores(truth, side, cells, grid, tolerance_mm)
    return scores


def _grid(cell: Mask, sidecar: MaskSidecar) -> SurfaceGrid:
    n_z, n_theta = cell.shape
    radius_mm = sidecar.bore_diameter_mm / 2
    return SurfaceGrid.full_circle(n_z, n_theta, z0_mm=sidecar.z0_mm, dz_mm=sidecar.dz_mm, radius_mm=radius_mm)


def _panorama(
    cell: Mask, grid: SurfaceGrid, path: Path, *, on: Panorama | None, told: MaskSidecar | None = None
) -> Panorama:
    rater, _, session = path.stem.rpartition("_")
    rater, session = (rater, session) if rater else (session, "1")
    return Panorama(
        grid=grid,
        intensity=cell.astype(np.float32),
        depth_mm=None,
        valid=np.ones(cell.shape, np.bool_),
        weight=np.ones(cell.shape, np.float32),
        modality=MASK_MODALITY,
        # a mask drawn on the other side's panorama has its frame; of any other, nobody said
        handedness_known=on is not None,
        travel_known=on is not None,
        provenance={
            "drawn_on_other_side": on is not None,
            "mask": path.name,
            "rater": (told and told.rater) or rater,
            "session": (told and told.session) or session,
        },
    )
