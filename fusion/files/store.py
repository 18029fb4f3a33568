"""Comparisons on disk: ``comparison.zarr``, which ``xarray.open_zarr`` reads, next to ``result.json``.

Cells are rows: of ``cells.csv`` for people, and of an array of numbers in ``comparison.zarr``.
"""

import csv
import json
import math
import types
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists, plain_name, spreadsheet_text
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import Named, read_arrays, read_attributes, write_arrays
from endoct.fusion.files.result_file import checked, read_result
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import Result, StoredAlignment
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.sides import IMAGES, Comparison, PlacedSide
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.store import load_panorama, stored_grid

FORMAT = "endoct-comparison-1"
PROPERTIES = tuple(field.name for field in fields(Cell))
LATER = ("depth_error_mm", "own_depth_mm", "own_depth_error_mm")
"""Properties that tables of earlier versions lack; they are the last ones."""
COMPARISON_STORE = "comparison.zarr"
"""The store in the folder of a comparison."""
WALL_STORE = "wall.zarr"
"""The store of the one wall of both sides, beside it."""
_KINDS: dict[str, Any] = {field.name: field.type for field in fields(Cell)}
_SIDES = ("side", "depth_of", "seen_by")
"""Properties that name a side. A number stands for it: its place among the sides, and 2 for "both"."""
_MOST = {"side": 1, "depth_of": 1, "seen_by": 2}
LARGEST = 1e9
"""No id, area, depth, length in mm or ratio is larger."""


def write_cells(cells: Sequence[Cell], path: Path) -> None:
    """Write one row for each cell, columns as the fields of :class:`Cell`, empty where unknown."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(PROPERTIES)
        writer.writerows([_text(getattr(cell, name)) for name in PROPERTIES] for cell in cells)


def as_numbers(cells: Sequence[Cell], sides: tuple[str, str]) -> Coordinates:
    """Return float64 (n_cells, n_properties) in the order of ``PROPERTIES``, NaN where unknown."""
    codes = {name: float(k) for k, name in enumerate((*sides, "both"))} | {None: np.nan}
    table = np.full((len(cells), len(PROPERTIES)), np.nan)
    for row, cell in enumerate(cells):
        for column, name in enumerate(PROPERTIES):
            value = getattr(cell, name)
            if name in _SIDES:
                table[row, column] = codes[value]
            elif value is not None:
                table[row, column] = value
    return table


def from_numbers(table: Coordinates, sides: tuple[str, str]) -> tuple[Cell, ...]:
    """Return the cells that :func:`as_numbers` made a table of, now or before ``LATER`` properties came in.

    Raises :class:`EndoctError` for any other table.
    """
    n_earlier = len(PROPERTIES) - len(LATER)
    if table.ndim != 2 or table.shape[1] not in (n_earlier, len(PROPERTIES)) or table.dtype.kind != "f":
        found = f"{table.dtype} {table.shape}"
        raise EndoctError("the table of cells cannot be used", found=found, expected=f"(n, {len(PROPERTIES)}) floats")
    names = (*sides, "both")

    def value(name: str, number: float) -> Any:
        kind = _KINDS[name]
        if math.isnan(number) and isinstance(kind, types.UnionType):
            return None
        # "int | None" holds an int
        inner = next(iter(get_args(kind))) if isinstance(kind, types.UnionType) else kind
        whole, most = name in _SIDES or inner in (int, bool), _MOST.get(name, 1 if inner is bool else LARGEST)
        if not -LARGEST <= number <= most or (whole and (number < 0 or number != int(number))):
            raise EndoctError(f"{name} of a cell cannot be used", found=f"{number:g}")
        return names[int(number)] if name in _SIDES else inner(number)

    cells = tuple(Cell(**{n: value(n, float(x)) for n, x in zip(PROPERTIES, row, strict=False)}) for row in table)
    known = {(cell.side, cell.id) for cell in cells}
    other = {sides[0]: sides[1], sides[1]: sides[0]}
    if len(known) < len(cells) or any(c.partner and (other[c.side], c.partner) not in known for c in cells):
        raise EndoctError("the table of cells cannot be used", found="cells or partners that are not one each")
    return cells


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, str):  # the name of a side, which a plug-in chose
        return spreadsheet_text(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def save_comparison(comparison: Comparison, path: Path) -> None:
    """Write ``comparison`` to ``path``, which must not exist (see :func:`endoct.base.files.output.new_output`).

    The variables ``intensity``, ``depth_mm``, ``mask`` and ``valid`` have dims (side, z, theta), with coordinates in mm
    and rad; ``cells`` has dims (cell, property). The attributes give the grid. As JSON they give the ``alignment`` by
    which B was placed in A's frame, or the ``reason`` why there is none. The rest is left to ``result.json``.
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
        attributes = _attributes(path)
        return _comparison(path, read_arrays(path, (*IMAGES, "cells", "side")), attributes)


def load_compared(folder: Path) -> Comparison:
    """Return what `endoct compare` wrote to ``folder``. Raises :class:`EndoctError` as :func:`load_comparison` does."""
    comparison, wall = load_comparison(folder / COMPARISON_STORE), folder / WALL_STORE
    return replace(comparison, wall=load_panorama(wall)) if exists(wall) else comparison


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
        attributes = _attributes(path)
        what, shape = f"the comparison {path}", declared(path / "mask", OWN).shape
        arrays = read_arrays(path, ("cells", "side"))
        if len(shape) != 3 or shape[0] != 2 or "side" not in arrays:
            raise EndoctError(f"{what} cannot be used", found=f"images of shape {shape}", expected="two sides")
        names = _names(arrays["side"], what)
        return ComparisonOutline(
            grid=stored_grid(attributes, shape, what),
            names=names,
            alignment=_alignment(attributes, what),
            result=_result_of(names, path),
            cells=from_numbers(arrays["cells"], names) if "cells" in arrays else (),
        )


def _attributes(path: Path) -> Mapping[str, Any]:
    attributes = read_attributes(path) if path.is_dir() else {}
    if attributes.get("format") != FORMAT:
        raise EndoctError(f"{path} is no comparison", expected="a store written by `endoct compare`")
    return attributes


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
    reason = _stored(attributes, "reason", what)
    if not isinstance(reason, str | None):
        raise EndoctError(f"'reason' of {what} cannot be used", expected="a text or null")
    names = _names(arrays["side"], what)
    result = _result_of(names, path)
    return Comparison(
        grid=stored_grid(attributes, shape, what),
        sides=(_side(names[0], arrays, 0, result), _side(names[1], arrays, 1, result)),
        alignment=_alignment(attributes, what),
        reason=reason,
        result=result,
        cells=from_numbers(arrays["cells"], names) if "cells" in arrays else (),
    )


def _stored(attributes: Mapping[str, object], name: str, of: str) -> object:
    text = attributes.get(name)
    if not isinstance(text, str):
        raise EndoctError(f"{of} is not whole", found=f"no '{name}' in its attributes")
    value: object = json.loads(text)
    return value


def _side(name: str, arrays: Mapping[str, NDArray[Any]], k: int, result: Result) -> PlacedSide:
    return PlacedSide(
        name=name,
        intensity=arrays["intensity"][k],
        depth_mm=arrays["depth_mm"][k],
        mask=arrays["mask"][k].astype(np.bool_),
        valid=arrays["valid"][k].astype(np.bool_),
        planes=result.planes.get(name, ()),
    )


def _names(stored: NDArray[Any], of: str) -> tuple[str, str]:
    """Return the names of the sides, which become names of files."""
    names = [plain_name(name, f"a side of {of}") for name in stored.ravel().tolist()]
    if len(names) != 2 or names[0] == names[1] or "both" in names:
        raise EndoctError(f"{of} cannot be used", found=f"the sides {', '.join(names)}", expected="two that differ")
    return names[0], names[1]


def _alignment(attributes: Mapping[str, object], of: str) -> Alignment | None:
    stored = _stored(attributes, "alignment", of)
    return None if stored is None else checked(StoredAlignment, stored, f"the alignment of {of}").to_alignment()
