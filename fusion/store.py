"""Comparisons on disk: ``comparison.zarr``, which ``xarray.open_zarr`` reads."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from endoct.fusion.cell_table import PROPERTIES, as_numbers, from_numbers
from endoct.fusion.outcome import Comparison
from endoct.fusion.pose import Alignment, as_covariance
from endoct.stitching.errors import EndoctError
from endoct.stitching.store import grid_attributes, stored_grid
from endoct.stitching.zarr_store import Named, read_arrays, write_arrays

FORMAT = "endoct-comparison-1"


def save_comparison(comparison: Comparison, path: Path) -> None:
    """Write ``comparison`` to ``path``, which must not exist (see :func:`endoct.stitching.output.new_output`).

    Dims (side, z, theta) with coordinates in mm and rad; variables ``intensity``, ``depth_mm``, ``mask``, ``valid``;
    and ``cells`` on dims (cell, property).
    """
    grid, dims = comparison.grid, ("side", "z", "theta")
    chunks = (1, min(grid.n_z, 512), grid.n_theta)
    cells = "cells as objects; sides by their place among the sides, both = 2"
    arrays = {
        "intensity": Named(dims, comparison.intensity, chunks=chunks),
        "depth_mm": Named(dims, comparison.depth_mm, {"units": "mm"}, chunks),
        "mask": Named(dims, comparison.mask, {"long_name": "cells"}, chunks),
        "valid": Named(dims, comparison.valid, {"long_name": "observed by this side"}, chunks),
        "cells": Named(("cell", "property"), as_numbers(comparison.cells, comparison.sides), {"long_name": cells}),
        "side": Named(("side",), np.array(comparison.sides, object)),
        "property": Named(("property",), np.array(PROPERTIES, object)),
        "z": Named(("z",), grid.z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
    }
    attributes = {
        "format": FORMAT,
        **grid_attributes(grid),
        "alignment": json.dumps(None if comparison.alignment is None else asdict(comparison.alignment)),
        "reason": json.dumps(comparison.reason),
        "result": json.dumps(comparison.result),
    }
    write_arrays(path, arrays, attributes)


def load_comparison(path: Path) -> Comparison:
    """Read what :func:`save_comparison` wrote. Raises :class:`EndoctError` where it is something else."""
    try:
        arrays, attributes = read_arrays(path)
        if attributes.get("format") != FORMAT:
            raise ValueError("no comparison")
        alignment = json.loads(attributes["alignment"])
        first, second = (str(name) for name in arrays["side"])
        return Comparison(
            grid=stored_grid(attributes, arrays["mask"].shape),
            sides=(first, second),
            intensity=arrays["intensity"],
            depth_mm=arrays["depth_mm"],
            mask=arrays["mask"].astype(np.bool_),
            valid=arrays["valid"].astype(np.bool_),
            alignment=None if alignment is None else _alignment(alignment),
            reason=json.loads(attributes["reason"]),
            result=json.loads(attributes["result"]),
            cells=from_numbers(arrays["cells"], (first, second)) if "cells" in arrays else (),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EndoctError(
            f"{path} is no comparison", found=str(error), expected="a store written by `endoct compare`"
        ) from error


def _alignment(stored: dict[str, Any]) -> Alignment:
    covariance = stored.get("covariance")
    return Alignment(**{**stored, "covariance": None if covariance is None else as_covariance(np.array(covariance))})
