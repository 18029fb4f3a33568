"""Masks drawn by hand: as a side of a comparison, or as the truth to score one against."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.drawn_mask import MASK_MODALITY, DrawnMask
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore
from endoct.fusion.result import MaskScores
from endoct.fusion.scoring.cells import measure
from endoct.fusion.scoring.scores import mask_scores
from endoct.fusion.scoring.surface import Surface
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import read_toml, validate
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


def read_mask(path: Path, like: Panorama | None = None) -> DrawnMask:
    """Read a mask: an image, labels in Zarr, or outlines of napari or Fiji.

    :mod:`endoct.fusion.files.drawings` says which files. Rows are z, ascending, columns the full circle of θ from 0. A
    sidecar NAME.toml next to it says where its rows lie; without one it must have as many rows and columns as ``like``
    and lies on its samples, also where these are uneven. Rater and session are named by the sidecar, else by the
    file's name, RATER_SESSION.png; a name without "_" is a rater's only session, "1".

    Raises :class:`EndoctError` where the image cannot be read, shows nothing, or nothing says where it lies.
    """
    cells = read_drawing(path, None if like is None else like.grid.shape)
    sidecar = path.with_suffix(".toml")
    if sidecar.is_file():
        stated = validate(MaskSidecar, read_toml(sidecar), str(sidecar))
        return DrawnMask(_grid(cells, stated), cells, *_rater_and_session(path, stated), None, path.name)
    if like is None or cells.shape != like.grid.shape:
        found = f"{cells.shape[0]} × {cells.shape[1]} samples"
        raise EndoctError(
            f"nothing says where the mask {path} lies",
            found=found,
            expected=f"{like.grid.n_z} × {like.grid.n_theta}, as the {like.modality} panorama has" if like else "",
            remedy=f"draw it on that panorama, or write {sidecar.name} next to it with "
            'modality = "mask", bore_diameter_mm, z0_mm and dz_mm',
        )
    return mask_on(cells, like, path)


def mask_on(cells: Mask, like: Panorama, path: Path) -> DrawnMask:
    """Return ``cells``, bool on the samples of ``like``, as :func:`read_mask` returns what is drawn there."""
    return DrawnMask(like.grid, cells, *_rater_and_session(path), like, path.name)


def stored_mask(panorama: Panorama) -> DrawnMask | None:
    """Return the mask that ``panorama``, read from a store, was saved from; None for a panorama of another kind."""
    stated = panorama.provenance
    if panorama.modality != MASK_MODALITY or not stated.get("drawn_on_other_side"):
        return None
    rater, session, file = (str(stated.get(name, "")) for name in ("rater", "session", "mask"))
    return DrawnMask(panorama.grid, panorama.intensity > 0.5, rater, session, panorama, file)


def score_against(comparison: Comparison, truth: DrawnMask, tolerance_mm: float = 0.1) -> dict[str, MaskScores]:
    """Return the scores of each side against a mask in side A's frame, by side, over what that side observed.

    On the comparison's grid. Raises :class:`EndoctError` for another bore diameter.
    """
    return score_surface(comparison, on_comparison(comparison, truth), tolerance_mm)


def on_comparison(comparison: Comparison, truth: DrawnMask) -> Surface:
    """Return a mask in side A's frame on the comparison's grid."""
    grid = comparison.grid
    check_same_bore(grid.radius_mm, truth.grid.radius_mm)
    everywhere = np.ones(truth.mask.shape, np.bool_)
    return Surface("given truth", *Placement.averaging(truth.grid, IN_PLACE, grid).mask(truth.mask, everywhere))


def score_surface(comparison: Comparison, truth: Surface, tolerance_mm: float) -> dict[str, MaskScores]:
    """Return as :func:`score_against` the scores of each side against ``truth`` on the comparison's grid."""
    grid, scores = comparison.grid, {}
    for side in comparison.sides:
        outlined = Surface(side.name, side.mask, side.valid)  # a mask has no relief to compare with
        cells = measure(truth, outlined, grid, aligned=True)
        scores[side.name] = mask_scores(truth, outlined, cells, grid, tolerance_mm)
    return scores


def _grid(cells: Mask, sidecar: MaskSidecar) -> SurfaceGrid:
    n_z, n_theta = cells.shape
    radius_mm = sidecar.bore_diameter_mm / 2
    return SurfaceGrid.full_circle(n_z, n_theta, z0_mm=sidecar.z0_mm, dz_mm=sidecar.dz_mm, radius_mm=radius_mm)


def _rater_and_session(path: Path, sidecar: MaskSidecar | None = None) -> tuple[str, str]:
    """Return who drew the mask at ``path`` and when: by its sidecar, else by its name, RATER_SESSION.png."""
    rater, _, session = path.stem.rpartition("_")
    rater, session = (rater, session) if rater else (session, "1")
    return (sidecar and sidecar.rater) or rater, (sidecar and sidecar.session) or session
