"""Cells as rows: of ``cells.csv`` for people, of an array of numbers for ``comparison.zarr``."""

import csv
import types
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from endoct.fusion.objects import Cell
from endoct.stitching.arrays import Coordinates
from endoct.stitching.names import spreadsheet_text

PROPERTIES = tuple(field.name for field in fields(Cell))
_KINDS: dict[str, Any] = {field.name: field.type for field in fields(Cell)}
_SIDES = ("side", "depth_of", "seen_by")
"""Properties that name a side; as a number its place among the sides, and 2 for "both"."""


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
    """Return the cells that :func:`as_numbers` made a table of."""
    names = (*sides, "both")

    def value(name: str, number: float) -> Any:
        if not np.isfinite(number):
            return None
        if name in _SIDES:
            return names[int(number)]
        kind = _KINDS[name]
        # "int | None" holds an int
        return next(iter(get_args(kind)))(number) if isinstance(kind, types.UnionType) else kind(number)

    return tuple(Cell(**{n: value(n, float(x)) for n, x in zip(PROPERTIES, row, strict=True)}) for row in table)


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, str):  # the name of a side, which a plug-in chose
        return spreadsheet_text(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
