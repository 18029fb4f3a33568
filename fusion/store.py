"""Comparisons on disk: ``comparison.zarr``, which ``xarray.open_zarr`` reads."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from endoct.fusion.cell_table import PROPERTIES, as_numbers, from_numbers
from endoct.fusion.outcome import Comparison
from endoct.fusion.pose import Alignment, as_covariance
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import write_dataset

FORMAT = "endoct-comparison-1"


def save_comparison(comparison: Comparison, path: Path) -> None:
    """Write ``comparison`` to ``path``, which must not exist (see :func:`endoct.stitching.output.new_output`).

    Dims (side, z, theta) with coordinates in mm and rad; variables ``intensity``, ``depth_mm``, ``mask``, ``valid``;
    and ``cells`` on dims (cell, property).
    """
    grid, dims = comparison.grid, ("side", "z", "theta")
    dataset = xr.Dataset(
        {
            "intensity": (dims, comparison.intensity),
            "depth_mm": (dims, comparison.depth_mm, {"units": "mm"}),
            "mask": (dims, comparison.mask, {"long_name": "cells"}),
            "valid": (dims, comparison.valid, {"long_name": "observed by this side"}),
            "cells": (
                ("cell", "property"),
                as_numbers(comparison.cells, comparison.sides),
                {"long_name": "cells as objects; sides by their place among the sides, both = 2"},
            ),
        },
        {
            "side": ("side", list(comparison.sides)),
            "property": ("property", list(PROPERTIES)),
            "z": ("z", grid.z_mm, {"units": "mm"}),
            "theta": ("theta", grid.theta_rad, {"units": "rad"}),
        },
        {
            "format": FORMAT,
            "radius_mm": grid.radius_mm,
            "z0_mm": grid.z0_mm,
            "dz_mm": grid.dz_mm,
            "theta0_rad": grid.theta0_rad,
            "alignment": json.dumps(None if comparison.alignment is None else asdict(comparison.alignment)),
            "reason": json.dumps(comparison.reason),
            "result": json.dumps(comparison.result),
        },
    )
    for name in ("intensity", "depth_mm", "mask", "valid"):
        dataset[name].encoding["chunks"] = (1, min(grid.n_z, 512), grid.n_theta)
    # a text of fixed width is no Zarr 3 data type that other readers know
    for name in ("side", "property"):
        dataset[name] = dataset[name].astype(object)
    write_dataset(dataset, path)


def load_comparison(path: Path) -> Comparison:
    """Read what :func:`save_comparison` wrote. Raises :class:`EndoctError` where it is something else."""
    try:
        with xr.open_zarr(path, chunks=None) as dataset:
            dataset.load()
        attributes = dataset.attrs
        if attributes.get("format") != FORMAT:
            raise ValueError("no comparison")
        _, n_z, n_theta = dataset["mask"].shape
        alignment = json.loads(attributes["alignment"])
        first, second = (str(name) for name in dataset["side"].values)
        return Comparison(
            grid=SurfaceGrid.full_circle(
                n_z,
                n_theta,
                z0_mm=attributes["z0_mm"],
                dz_mm=attributes["dz_mm"],
                theta0_rad=attributes["theta0_rad"],
                radius_mm=attributes["radius_mm"],
            ),
            sides=(first, second),
            intensity=dataset["intensity"].values,
            depth_mm=dataset["depth_mm"].values,
            mask=dataset["mask"].values.astype(np.bool_),
            valid=dataset["valid"].values.astype(np.bool_),
            alignment=None if alignment is None else _alignment(alignment),
            reason=json.loads(attributes["reason"]),
            result=json.loads(attributes["result"]),
            cells=from_numbers(dataset["cells"].values, (first, second)) if "cells" in dataset else (),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EndoctError(
            f"{path} is no comparison", found=str(error), expected="a store written by `endoct compare`"
        ) from error


def _alignment(stored: dict[str, Any]) -> Alignment:
    covariance = stored.get("covariance")
    return Alignment(**{**stored, "covariance": None if covariance is None else as_covariance(np.array(covariance))})
