"""Cells as rows: of ``cells.csv`` for people, of an array of numbers for ``comparison.zarr``."""

import csv
import math
import types
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import spreadsheet_text
from endoct.fusion.scoring.cells import Cell

PROPERTIES = tuple(field.name for field in fields(Cell))
_KINDS: dict[str, Any] = {field.name: field.type for field in fields(Cell)}
_SIDES = ("side", "depth_of", "seen_by")
"""Properties that name a side; as a number its place among the sides, and 2 for "both"."""
_MOST = {"side": 1, "depth_of": 1, "seen_by": 2}
LARGEST = 1e9
"""No id, area or depth is larger."""


def write_cells(cells: Sequence[Cell], path: Path) -> None:
    """Write one row a cell, columns as the fields of :class:`Cell`, empty where unknown."""
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
    """Return the cells that :func:`as_numbers` made a table of. Raises :class:`EndoctError` for any other table."""
    if table.ndim != 2 or table.shape[1] != len(PROPERTIES) or table.dtype.kind != "f":
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

    cells = tuple(Cell(**{n: value(n, float(x)) for n, x in zip(PROPERTIES, row, strict=True)}) for row in table)
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
