"""Panoramas on disk: Zarr stores that ``xarray.open_zarr`` reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.zarr_store import Named, read_arrays, write_arrays

FORMAT = "endoct-panorama-1"


def save_panorama(panorama: Panorama, path: Path) -> None:
    """Write ``panorama`` to ``path``, which must not exist (see :func:`endoct.stitching.output.new_output`).

    Dims (z, theta) with coordinates in mm and rad; ``intensity``, ``valid``, ``weight``, ``depth_mm`` where
    there is depth; the per-frame quality on the dim named ``frame_dim``.
    """
    surface, units_mm = ("z", "theta"), {"units": "mm"}
    arrays = {
        "intensity": Named(surface, panorama.intensity),
        "valid": Named(surface, panorama.valid),
        "weight": Named(surface, panorama.weight),
        "z": Named(("z",), panorama.z_mm, units_mm),
        "theta": Named(("theta",), panorama.grid.theta_rad, {"units": "rad"}),
    }
    if panorama.depth_mm is not None:
        arrays["depth_mm"] = Named(surface, panorama.depth_mm, units_mm)
    frame_z = f"{panorama.frame_dim}_z_mm"
    for name, values in panorama.per_frame.items():
        dims = (panorama.frame_dim, *(f"{name}_{axis}" for axis in range(1, values.ndim)))
        arrays[name] = Named(dims, values, units_mm if name == frame_z else {})
    grid = panorama.grid
    attributes = {
        "format": FORMAT,
        "modality": panorama.modality,
        "frame_dim": panorama.frame_dim,
        "handedness_known": panorama.handedness_known,
        "travel_known": panorama.travel_known,
        **grid_attributes(grid),
        "provenance": json.dumps(panorama.provenance),
    }
    write_arrays(path, arrays, attributes, coordinates=[frame_z] if frame_z in arrays else ())


def grid_attributes(grid: SurfaceGrid) -> dict[str, float]:
    """Return the attributes of a store from which :func:`stored_grid` makes ``grid`` again."""
    return {"radius_mm": grid.radius_mm, "z0_mm": grid.z0_mm, "dz_mm": grid.dz_mm, "theta0_rad": grid.theta0_rad}


def stored_grid(attributes: Mapping[str, Any], shape: tuple[int, ...]) -> SurfaceGrid:
    """Return the full circle that a store describes, whose images of ``shape`` end in the dims (z, theta)."""
    n_z, n_theta = shape[-2:]
    return SurfaceGrid.full_circle(
        n_z,
        n_theta,
        z0_mm=attributes["z0_mm"],
        dz_mm=attributes["dz_mm"],
        theta0_rad=attributes["theta0_rad"],
        radius_mm=attributes["radius_mm"],
    )


def is_panorama(path: Path) -> bool:
    """Say whether ``path`` is a store that :func:`save_panorama` wrote."""
    try:
        return bool(json.loads((path / "zarr.json").read_text())["attributes"]["format"] == FORMAT)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def load_panorama(path: Path) -> Panorama:
    """Read what :func:`save_panorama` wrote. Raises :class:`EndoctError` where it is something else."""
    if not is_panorama(path):
        raise EndoctError(
            f"{path} is no panorama",
            expected="a store written by `endoct unroll`",
            remedy="unroll the recording first",
        )
    try:
        return _panorama(*read_arrays(path))
    except (OSError, ValueError, KeyError) as error:
        raise EndoctError(f"{path} cannot be read", found=str(error), remedy="unroll the recording again") from error


def _panorama(arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> Panorama:
    surface = {"intensity", "valid", "weight", "depth_mm", "z", "theta"}
    return Panorama(
        grid=stored_grid(attributes, arrays["intensity"].shape),
        z_mm=arrays["z"],
        intensity=arrays["intensity"],
        depth_mm=arrays.get("depth_mm"),
        valid=arrays["valid"].astype(np.bool_),
        weight=arrays["weight"],
        modality=attributes["modality"],
        handedness_known=bool(attributes["handedness_known"]),
        travel_known=bool(attributes["travel_known"]),
        frame_dim=attributes["frame_dim"],
        per_frame={name: values for name, values in arrays.items() if name not in surface},
        provenance=json.loads(attributes["provenance"]),
    )
