"""Panoramas on disk: Zarr stores that ``xarray.open_zarr`` reads."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

FORMAT = "endoct-panorama-1"


def save_panorama(panorama: Panorama, path: Path) -> None:
    """Write ``panorama`` to ``path``, which must not exist (see :func:`endoct.stitching.output.new_output`).

    Dims (z, theta) with coordinates in mm and rad; ``intensity``, ``valid``, ``weight``, ``depth_mm`` where
    there is depth; the per-frame quality on the dim named ``frame_dim``.
    """
    surface = ("z", "theta")
    variables: dict[str, tuple[Any, Any, dict[str, str]]] = {
        "intensity": (surface, panorama.intensity, {}),
        "valid": (surface, panorama.valid, {}),
        "weight": (surface, panorama.weight, {}),
    }
    if panorama.depth_mm is not None:
        variables["depth_mm"] = (surface, panorama.depth_mm, {"units": "mm"})
    coordinates: dict[str, tuple[Any, Any, dict[str, str]]] = {
        "z": ("z", panorama.z_mm, {"units": "mm"}),
        "theta": ("theta", panorama.grid.theta_rad, {"units": "rad"}),
    }
    frame_z = f"{panorama.frame_dim}_z_mm"
    for name, values in panorama.per_frame.items():
        dims = (panorama.frame_dim, *(f"{name}_{axis}" for axis in range(1, values.ndim)))
        if name == frame_z:
            coordinates[name] = (dims, values, {"units": "mm"})
        else:
            variables[name] = (dims, values, {})
    grid = panorama.grid
    attributes = {
        "format": FORMAT,
        "modality": panorama.modality,
        "frame_dim": panorama.frame_dim,
        "handedness_known": panorama.handedness_known,
        "travel_known": panorama.travel_known,
        "radius_mm": grid.radius_mm,
        "z0_mm": grid.z0_mm,
        "dz_mm": grid.dz_mm,
        "theta0_rad": grid.theta0_rad,
        "provenance": json.dumps(panorama.provenance),
    }
    write_dataset(xr.Dataset(variables, coordinates, attributes), path)


def write_dataset(dataset: xr.Dataset, path: Path, *, group: str | None = None) -> None:
    """Write ``dataset`` as Zarr 3 to ``path`` (or a group in it), which must not exist.

    Metadata are consolidated, so that a plain ``xarray.open_zarr(path)`` is fast and warns of nothing.
    """
    with warnings.catch_warnings():
        # consolidated metadata are not in the Zarr 3 specification yet; readers that do not know them ignore them
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        dataset.to_zarr(path, mode="w-", group=group, zarr_format=3, consolidated=True)


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
        with xr.open_zarr(path, chunks=None) as dataset:
            return _panorama(dataset.load())
    except (OSError, ValueError, KeyError) as error:
        raise EndoctError(f"{path} cannot be read", found=str(error), remedy="unroll the recording again") from error


def _panorama(dataset: xr.Dataset) -> Panorama:
    attributes = dataset.attrs
    surface = {"intensity", "valid", "weight", "depth_mm"}
    per_frame = {str(name): v.values for name, v in dataset.data_vars.items() if name not in surface}
    frame_z = f"{attributes['frame_dim']}_z_mm"
    if frame_z in dataset.coords:
        per_frame[frame_z] = dataset[frame_z].values
    n_z, n_theta = dataset["intensity"].shape
    grid = SurfaceGrid.full_circle(
        n_z,
        n_theta,
        z0_mm=attributes["z0_mm"],
        dz_mm=attributes["dz_mm"],
        theta0_rad=attributes["theta0_rad"],
        radius_mm=attributes["radius_mm"],
    )
    return Panorama(
        grid=grid,
        z_mm=dataset["z"].values,
        intensity=dataset["intensity"].values,
        depth_mm=dataset["depth_mm"].values if "depth_mm" in dataset else None,
        valid=dataset["valid"].values.astype(np.bool_),
        weight=dataset["weight"].values,
        modality=attributes["modality"],
        handedness_known=bool(attributes["handedness_known"]),
        travel_known=bool(attributes["travel_known"]),
        frame_dim=attributes["frame_dim"],
        per_frame=per_frame,
        provenance=json.loads(attributes["provenance"]),
    )
