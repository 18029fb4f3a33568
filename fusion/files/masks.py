"""Masks drawn by hand: as a side of a comparison, as the truth to score one against, and stored next to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import Named, read_arrays, read_attributes, write_arrays
from endoct.fusion.evidence import MASK_MODALITY
from endoct.fusion.evidence.side import DrawnMask
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore
from endoct.fusion.result import MaskScores
from endoct.fusion.scoring.cells import measure
from endoct.fusion.scoring.overlap import Surface
from endoct.fusion.scoring.raters import MOST_DRAWINGS, Drawing
from endoct.fusion.scoring.scores import mask_scores
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import read_toml, validate
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import stored_grid

DRAWN_STORE = "drawn.zarr"
"""The name of the store of drawn masks, next to ``comparison.zarr`` and on the same grid."""
FORMAT = "endoct-drawn-1"
MAJORITY = "most raters"
"""This stands in place of a rater's name for what most raters drew."""
LONGEST_NAME = 200


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

    :mod:`endoct.fusion.files.drawings` says which files. Rows are z, ascending; columns are the full circle of θ from
    0. A sidecar NAME.toml next to it says where its rows lie. Without one it lies on the samples of ``like``, also
    where these are uneven, and must have as many rows and columns. Rater and session are named by the sidecar, else by
    the file's name, RATER_SESSION.png. A name without "_" is a rater's only session, "1".

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
    """Return ``cells``, bool on the samples of ``like``, as :func:`read_mask` returns a mask drawn there."""
    return DrawnMask(like.grid, cells, *_rater_and_session(path), like, path.name)


def stored_mask(panorama: Panorama) -> DrawnMask | None:
    """Return the mask that ``panorama``, read from a store, was saved from; None for a panorama of another kind."""
    stated = panorama.provenance
    if panorama.modality != MASK_MODALITY or not stated.get("drawn_on_other_side"):
        return None
    rater, session, file = (str(stated.get(name, "")) for name in ("rater", "session", "mask"))
    return DrawnMask(panorama.grid, panorama.intensity > 0.5, rater, session, panorama, file)


def on_comparison(comparison: Comparison, truth: DrawnMask, where: Alignment = IN_PLACE) -> Surface:
    """Return a mask on the comparison's grid; ``where`` it lies in side A's frame."""
    grid = comparison.grid
    check_same_bore(grid.radius_mm, truth.grid.radius_mm)
    everywhere = np.ones(truth.mask.shape, np.bool_)
    return Surface("given truth", *Placement.averaging(truth.grid, where, grid).mask(truth.mask, everywhere))


def score_surface(comparison: Comparison, truth: Surface, tolerance_mm: float) -> dict[str, MaskScores]:
    """Return the scores of each side against ``truth`` on the comparison's grid, by side, over what it observed."""
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


@dataclass(frozen=True)
class DrawnOutline:
    """Drawn masks on disk without the masks: their ``grid``, and of each the rater and the session."""

    grid: SurfaceGrid
    drawn_by: tuple[tuple[str, str], ...]

    @property
    def titles(self) -> tuple[str, ...]:
        """Return what to call each mask: its rater, and the session where that is not the only one."""
        return tuple(rater if session == "1" else f"{rater}, {session}" for rater, session in self.drawn_by)


def save_drawings(drawings: Sequence[Drawing], grid: SurfaceGrid, path: Path) -> None:
    """Write ``drawings``, masks bool (n_z, n_theta) on ``grid``, to ``path``, which must not exist.

    Dims (drawing, z, theta) with coordinates in mm and rad; variables ``mask`` and ``valid``, and ``rater`` and
    ``session`` on dim drawing.
    """
    dims, chunks = ("drawing", "z", "theta"), (1, min(grid.n_z, 512), grid.n_theta)
    arrays = {
        "mask": Named(dims, np.stack([one.mask for one in drawings]), {"long_name": "cells as drawn"}, chunks),
        "valid": Named(dims, np.stack([one.valid for one in drawings]), {"long_name": "where it was drawn"}, chunks),
        "rater": Named(("drawing",), np.array([one.rater for one in drawings], object)),
        "session": Named(("drawing",), np.array([one.session for one in drawings], object)),
        "z": Named(("z",), grid.z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
    }
    write_arrays(path, arrays, {"format": FORMAT, **grid_attributes(grid)}, coordinates=("rater", "session"))


def read_drawn(folder: Path) -> DrawnOutline | None:
    """Return what was drawn of the comparison in ``folder``; None where nothing was.

    Raises :class:`EndoctError` where the store is something else, or damaged.
    """
    path = folder / DRAWN_STORE
    if not path.is_dir():
        return None
    expected = "a store written by `endoct compare`"
    with refusing(f"{path} cannot be read", expected=expected):
        attributes, shape = read_attributes(path), declared(path / "mask", OWN).shape
        names = read_arrays(path, ("rater", "session"))
        drawn_by = tuple(
            (str(rater)[:LONGEST_NAME], str(session)[:LONGEST_NAME])
            for rater, session in zip(names["rater"].tolist(), names["session"].tolist(), strict=True)
        )
        sound = len(shape) == 3 and shape[0] == len(drawn_by) <= MOST_DRAWINGS + 1
        if attributes.get("format") != FORMAT or not sound or declared(path / "valid", OWN).shape != shape:
            raise EndoctError(f"{path} cannot be read", found=f"masks of shape {shape}", expected=expected)
        return DrawnOutline(stored_grid(attributes, shape, f"the masks in {path}"), drawn_by)
