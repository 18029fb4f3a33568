"""Comparisons on disk: ``comparison.zarr``, which ``xarray.open_zarr`` reads, next to ``result.json``."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import plain_name
from endoct.base.files.json_values import an_object, number
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import Named, read_arrays, read_attributes, write_arrays
from endoct.fusion.files.cell_table import PROPERTIES, as_numbers, from_numbers
from endoct.fusion.files.result_file import read_result
from endoct.fusion.geometry.alignment import Alignment, as_covariance
from endoct.fusion.result import Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.store import stored_grid

FORMAT = "endoct-comparison-1"
IMAGES = ("intensity", "depth_mm", "mask", "valid")
_LARGEST = 1e9
"""No length in mm, ratio or the like is larger."""


def save_comparison(comparison: Comparison, path: Path) -> None:
    """Write ``comparison`` to ``path``, which must not exist (see :func:`endoct.base.files.output.new_output`).

    Dims (side, z, theta) with coordinates in mm and rad; variables ``intensity``, ``depth_mm``, ``mask``, ``valid``;
    and ``cells`` on dims (cell, property). Its attributes give the grid, and as JSON the ``alignment`` by which B was
    placed in A's frame, or the ``reason`` why there is none. The rest of the result is left to ``result.json``.
    """
    grid, dims = comparison.grid, ("side", "z", "theta")
    chunks = (1, min(grid.n_z, 512), grid.n_theta)
    cells = "cells as objects; sides by their place among the sides, both = 2"
    said: dict[str, dict[str, str]] = {
        "intensity": {},
        "depth_mm": {"units": "mm"},
        "mask": {"long_name": "cells"},
        "valid": {"long_name": "observed by this side"},
    }
    arrays = {
        **{
            name: Named(dims, np.stack([getattr(side, name) for side in comparison.sides]), said[name], chunks)
            for name in IMAGES
        },
        "cells": Named(("cell", "property"), as_numbers(comparison.cells, comparison.names), {"long_name": cells}),
        "side": Named(("side",), np.array(comparison.names, object)),
        "property": Named(("property",), np.array(PROPERTIES, object)),
        "z": Named(("z",), grid.z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
    }
    attributes = {
        "format": FORMAT,
        **grid_attributes(grid),
        "alignment": json.dumps(None if comparison.alignment is None else asdict(comparison.alignment)),
        "reason": json.dumps(comparison.reason),
    }
    write_arrays(path, arrays, attributes)


def load_comparison(path: Path) -> Comparison:
    """Read the store that :func:`save_comparison` wrote, and the result from the ``result.json`` next to it.

    Grid, sides, alignment and reason are those of the store. Raises :class:`EndoctError` where either is missing,
    something else, or damaged, or where the two are of different sides.
    """
    with refusing(f"{path} is no comparison", expected="a store written by `endoct compare`"):
        attributes = read_attributes(path) if path.is_dir() else {}
        if attributes.get("format") != FORMAT:
            raise EndoctError(f"{path} is no comparison", expected="a store written by `endoct compare`")
        return _comparison(path, read_arrays(path, (*IMAGES, "cells", "side")), attributes)


@dataclass(frozen=True, eq=False)
class ComparisonOutline:
    """A comparison on disk without its images, as in :class:`~endoct.fusion.sides.Comparison`."""

    grid: SurfaceGrid
    names: tuple[str, str]
    alignment: Alignment | None
    result: Result
    cells: tuple[Cell, ...]


def read_outline(path: Path) -> ComparisonOutline:
    """Read all but the images of the store that :func:`save_comparison` wrote, for readers of parts of these.

    Raises :class:`EndoctError` as :func:`load_comparison` does.
    """
    with refusing(f"{path} is no comparison", expected="a store written by `endoct compare`"):
        attributes = read_attributes(path) if path.is_dir() else {}
        if attributes.get("format") != FORMAT:
            raise EndoctError(f"{path} is no comparison", expected="a store written by `endoct compare`")
        what, shape = f"the comparison {path}", declared(path / "mask", OWN).shape
        arrays = read_arrays(path, ("cells", "side"))
        if len(shape) != 3 or shape[0] != 2 or "side" not in arrays:
            raise EndoctError(f"{what} cannot be used", found=f"images of shape {shape}", expected="two sides")
        names, alignment = _names(arrays["side"], what), _stored(attributes, "alignment", what)
        return ComparisonOutline(
            grid=stored_grid(attributes, shape, what),
            names=names,
            alignment=None if alignment is None else _alignment(alignment, what),
            result=_result_of(names, path),
            cells=from_numbers(arrays["cells"], names) if "cells" in arrays else (),
        )


def _result_of(names: tuple[str, str], path: Path) -> Result:
    result = read_result(path.parent)
    if result.sides != names:
        raise EndoctError(
            f"result.json and comparison.zarr in {path.parent} have other sides",
            found=f"{', '.join(result.sides)} and {', '.join(names)}",
        )
    return result


def _comparison(path: Path, arrays: Mapping[str, NDArray[Any]], attributes: Mapping[str, Any]) -> Comparison:
    what = f"the comparison {path}"
    if missing := [name for name in (*IMAGES, "side") if name not in arrays]:
        raise EndoctError(f"{what} is not whole", found=f"no {missing[0]}", remedy="run the comparison again")
    shape = arrays["mask"].shape
    for name in IMAGES:
        found = arrays[name]
        if found.shape != shape or len(shape) != 3 or shape[0] != 2 or found.dtype.kind not in "biuf":
            raise EndoctError(f"{name} of {what} cannot be used", found=f"{found.dtype} {found.shape}")
    alignment, reason = (_stored(attributes, name, what) for name in ("alignment", "reason"))
    if not isinstance(reason, str | None):
        raise EndoctError(f"'reason' of {what} cannot be used", expected="a text or null")
    names = _names(arrays["side"], what)
    result = _result_of(names, path)
    return Comparison(
        grid=stored_grid(attributes, shape, what),
        sides=(_side(names[0], arrays, 0), _side(names[1], arrays, 1)),
        alignment=None if alignment is None else _alignment(alignment, what),
        reason=reason,
        result=result,
        cells=from_numbers(arrays["cells"], names) if "cells" in arrays else (),
    )


def _stored(attributes: Mapping[str, object], name: str, what: str) -> object:
    text = attributes.get(name)
    if not isinstance(text, str):
        raise EndoctError(f"{what} is not whole", found=f"no '{name}' in its attributes")
    value: object = json.loads(text)
    return value


def _side(name: str, arrays: Mapping[str, NDArray[Any]], k: int) -> PlacedSide:
    return PlacedSide(
        name=name,
        intensity=arrays["intensity"][k],
        depth_mm=arrays["depth_mm"][k],
        mask=arrays["mask"][k].astype(np.bool_),
        valid=arrays["valid"][k].astype(np.bool_),
    )


def _names(stored: NDArray[Any], what: str) -> tuple[str, str]:
    """Return the names of the sides, which become names of files."""
    names = [plain_name(name, f"a side of {what}") for name in stored.ravel().tolist()]
    if len(names) != 2 or names[0] == names[1] or "both" in names:
        raise EndoctError(f"{what} cannot be used", found=f"the sides {', '.join(names)}", expected="two that differ")
    return names[0], names[1]


def _alignment(stored: object, what: str) -> Alignment:
    """Return the alignment that was ``stored``, every number finite."""
    what = f"the alignment of {what}"
    values = dict(an_object(stored, what))
    covariance = values.pop("covariance", None)
    for field in fields(Alignment):
        if field.name not in values:
            continue
        if field.type is bool:
            if not isinstance(values[field.name], bool):
                raise EndoctError(f"'{field.name}' of {what} cannot be used", expected="true or false")
        else:
            values[field.name] = number(values, field.name, -_LARGEST, _LARGEST, what)
    if covariance is not None:
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise EndoctError(f"'covariance' of {what} cannot be used", expected="3 × 3 finite numbers")
        covariance = as_covariance(matrix)
    return Alignment(**values, covariance=covariance)
