"""What a comparison folder holds, read back for its report."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from endoct.modalities.contract import Picture
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.pictures import load_pictures


@dataclass(frozen=True, eq=False)
class SideFindings:
    """One side of a comparison.

    ``intensity``, ``depth_mm`` (None where the side has no depth), ``mask`` (cells) and ``valid`` lie on the
    comparison's grid, (n_z, n_theta); ``panorama`` is what the side saw on its own rows; ``pictures`` of single
    frames by the frame's place in the order of ascending z.
    """

    name: str
    intensity: Image
    depth_mm: Image | None
    mask: Mask
    valid: Mask
    panorama: Panorama
    pictures: Mapping[int, tuple[Picture, ...]]

    @property
    def is_drawn_mask(self) -> bool:
        """Whether the side is a mask drawn by hand: it has no intensity worth showing."""
        return self.panorama.modality == "mask"

    @property
    def frame_z_mm(self) -> Coordinates:
        """Place of every frame, float64 (n_frames,), mm, in the side's own frame; empty where unknown."""
        values = self.panorama.per_frame.get(f"{self.panorama.frame_dim}_z_mm", np.empty(0))
        return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Findings:
    """A comparison folder: ``result`` as in ``result.json``, the common grid in side A's frame, and the sides."""

    result: Mapping[str, Any]
    grid: SurfaceGrid
    sides: tuple[SideFindings, SideFindings]

    @property
    def aligned(self) -> bool:
        """Whether the two sides could be brought onto each other; if not, nothing may be overlaid."""
        return bool(self.result["aligned"])


def read_findings(folder: Path) -> Findings:
    """Read what ``endoct compare`` wrote. Raises :class:`EndoctError` where ``folder`` is no whole comparison."""
    try:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        with xr.open_zarr(folder / "comparison.zarr", chunks=None) as dataset:
            dataset.load()
        names = tuple(str(name) for name in dataset["side"].values)
        panoramas = [load_panorama(folder / "panoramas" / f"{name}.zarr") for name in names]
        z_mm, theta_rad = dataset["z"].values, dataset["theta"].values
    except (OSError, ValueError, KeyError) as error:
        raise EndoctError(
            f"{folder} is no comparison", found=str(error), expected="a folder written by `endoct compare`"
        ) from error
    pictures = load_pictures(folder / "pictures")
    steps_mm = np.diff(z_mm)
    grid = SurfaceGrid.full_circle(
        z_mm.size,
        theta_rad.size,
        z0_mm=float(z_mm[0]),
        dz_mm=float(np.median(steps_mm)) if steps_mm.size else panoramas[0].grid.dz_mm,
        theta0_rad=float(theta_rad[0]),
        radius_mm=panoramas[0].grid.radius_mm,
    )
    a, b = (
        _side(dataset.sel(side=name), name, panorama, pictures.get(name, {}))
        for name, panorama in zip(names, panoramas, strict=True)
    )
    return Findings(result, grid, (a, b))


def _side(part: xr.Dataset, name: str, panorama: Panorama, pictures: Mapping[int, tuple[Picture, ...]]) -> SideFindings:
    depth_mm = part["depth_mm"].values if "depth_mm" in part else None
    return SideFindings(
        name=name,
        intensity=part["intensity"].values,
        depth_mm=depth_mm if depth_mm is not None and np.isfinite(depth_mm).any() else None,
        mask=part["mask"].values.astype(np.bool_),
        valid=part["valid"].values.astype(np.bool_),
        panorama=panorama,
        pictures=pictures,
    )
