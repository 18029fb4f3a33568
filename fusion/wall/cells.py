"""The cells of the one wall, each with what is known of it, and the places where both sides are sure and disagree."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.base.doubt import Doubt
from endoct.base.numeric.regions import Labels, label, label_in_order
from endoct.fusion.result import Contradiction, WallSummary
from endoct.fusion.sides import Placed
from endoct.fusion.wall.both_sides import BothSides, both_sides_of
from endoct.fusion.wall.short_ends import doubt_of_short_ends
from endoct.fusion.wall.wall import BY_BOTH, Wall, wall_from
from endoct.stitching.grid import SurfaceGrid

SURE_OF_CELL = 0.7
"""Samples of a cell with a lower probability count as the error of its area."""
LEAST_MM2 = 0.03
"""Smaller contradictions are none: an outline may be off by as much."""
MOST_COVERED = 0.1
"""Of a contradicted cell the other side shows no more than this."""
FLAT_MM, DEEP_MM = 0.03, 0.1
"""A cell is denied by a median relief below the first, and asserted by one above the second."""
ON_ROWS_MM = 0.03
LEAST_ON_ROWS = 20
"""Depth speaks of a cell by at least so many samples within this distance of a measured row."""
SURE_OF_LIGHT = 0.9
"""The eye is sure of a cell with a median probability of this, and of none with its complement."""


@dataclass(frozen=True)
class WallCell:
    """A cell of the wall: its middle, area, volume and depths, each with its standard error; NaN where not known.

    ``greatest_depth_mm`` is the 95th percentile; ``decided_by_both``, the share of it that both sides decided.
    """

    id: int
    theta_rad: float
    z_mm: float
    area_mm2: float
    area_error_mm2: float
    volume_mm3: float
    volume_error_mm3: float
    mean_depth_mm: float
    greatest_depth_mm: float
    depth_error_mm: float
    decided_by_both: float


def cells_of(wall: Wall) -> tuple[WallCell, ...]:
    """Return the cells of ``wall``, in the order of their z."""
    labels, sample_mm2 = label_in_order(wall.cells), wall.grid.dz_mm * wall.grid.dtheta_mm
    return tuple(_cell(wall, number, part, sample_mm2) for number, part in enumerate(_parts(labels), 1))


def _parts(labels: Labels) -> list[NDArray[np.intp]]:
    """Return the flat indices of the samples of each label 1 … n."""
    inside = np.flatnonzero(labels)
    inside = inside[np.argsort(labels.flat[inside], kind="stable")]
    return np.split(inside, np.flatnonzero(np.diff(labels.flat[inside])) + 1) if inside.size else []


def _cell(wall: Wall, number: int, part: NDArray[np.intp], sample_mm2: float) -> WallCell:
    theta_rad, z_mm = _middle(wall.grid, part)
    probable = wall.probability.flat[part]
    depth_mm, error_mm = wall.relief_mm.flat[part], wall.error_mm.flat[part]
    told = np.isfinite(depth_mm)
    mean_mm, off_mm, deepest_mm = np.nan, np.nan, np.nan
    if told.any():  # of a cell, errors go together: its floor is sides, or is not
        mean_mm, off_mm = float(depth_mm[told].mean()), float(error_mm[told].mean())
        deepest_mm = float(np.percentile(depth_mm[told], 95))
    area_mm2 = part.size * sample_mm2
    unsure_mm2 = float(np.count_nonzero(probable < SURE_OF_CELL)) * sample_mm2
    return WallCell(
        id=number,
        theta_rad=theta_rad,
        z_mm=z_mm,
        area_mm2=area_mm2,
        area_error_mm2=unsure_mm2,
        volume_mm3=area_mm2 * mean_mm,
        volume_error_mm3=float(np.hypot(area_mm2 * off_mm, unsure_mm2 * mean_mm)),
        mean_depth_mm=mean_mm,
        greatest_depth_mm=deepest_mm,
        depth_error_mm=off_mm,
        decided_by_both=float((wall.decided.flat[part] == BY_BOTH).mean()),
    )


def _middle(grid: SurfaceGrid, part: NDArray[np.intp]) -> tuple[float, float]:
    rows, columns = np.unravel_index(part, grid.shape)
    middle_rad = float(np.angle(np.exp(1j * grid.theta_rad[columns]).mean()))
    return middle_rad % (2 * np.pi), float(grid.z_mm[rows].mean())


def write_wall_cells(cells: Sequence[WallCell], path: Path) -> None:
    """Write one row for each cell, columns as the fields of :class:`WallCell`, empty where not known."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(WallCell)])
        writer.writerows(["" if each != each else f"{each:.6g}" for each in astuple(cell)] for cell in cells)


def contradictions_of(sides: BothSides, names: tuple[str, str]) -> tuple[Contradiction, ...]:
    """Return where a side surely shows a cell and the other one, by ``names``, surely shows wall, largest first."""
    light, depth = sides.cells[sides.light_side], sides.cells[sides.depth_side]
    both = sides.observed[0] & sides.observed[1]
    on_rows = np.isfinite(sides.relief_mm) & (sides.from_row_mm <= ON_ROWS_MM)[:, np.newaxis]
    found = [
        *_denied(sides, light & both, depth, on_rows, names[sides.light_side], by_light=True),
        *_denied(sides, depth & both, light, on_rows, names[sides.depth_side], by_light=False),
    ]
    return tuple(sorted(found, key=lambda each: -each.area_mm2))


def _denied(
    sides: BothSides, cells: Mask, other: Mask, on_rows: Mask, name: str, *, by_light: bool
) -> Iterator[Contradiction]:
    """Yield which of ``cells``, those of the side with light or the other one's, the other side surely denies."""
    sample_mm2 = sides.grid.dz_mm * sides.grid.dtheta_mm
    for part in _parts(label(cells)[0]):
        if part.size * sample_mm2 < LEAST_MM2 or other.flat[part].mean() > MOST_COVERED:
            continue
        measured = part[on_rows.flat[part]]
        if measured.size < LEAST_ON_ROWS:
            continue
        relief_mm = float(np.median(sides.relief_mm.flat[measured]))
        probable = sides.probability.flat[part]
        probability = float(np.median(probable[np.isfinite(probable)])) if np.isfinite(probable).any() else np.nan
        sure_light = probability >= SURE_OF_LIGHT if by_light else probability <= 1 - SURE_OF_LIGHT
        sure_depth = relief_mm <= FLAT_MM if by_light else relief_mm >= DEEP_MM
        if sure_light and sure_depth:
            theta_rad, z_mm = _middle(sides.grid, part)
            yield Contradiction(
                shown_by=name, theta_rad=theta_rad, z_mm=z_mm, area_mm2=part.size * sample_mm2,
                relief_mm=relief_mm, probability=probability,
            )  # fmt: skip


def summary_of(cells: Sequence[WallCell], contradictions: tuple[Contradiction, ...]) -> WallSummary:
    """Return what a result says of a wall with these ``cells``; those whose depth is not known have no volume."""
    area_mm2, area_error, volume_mm3, volume_error = (
        np.array([getattr(cell, name) for cell in cells], dtype=np.float64)
        for name in ("area_mm2", "area_error_mm2", "volume_mm3", "volume_error_mm3")
    )
    return WallSummary(
        cells=len(cells),
        area_mm2=float(area_mm2.sum()),
        area_error_mm2=float(area_error.sum()),  # outlines of all cells are too wide together, or too narrow
        volume_mm3=float(np.nansum(volume_mm3)),
        volume_error_mm3=float(np.nansum(volume_error)),
        contradictions=contradictions,
    )


@dataclass(frozen=True, eq=False)
class Joined:
    """The one wall of two sides, its cells, what a result says of it, and what it lets doubt of a side."""

    wall: Wall
    cells: tuple[WallCell, ...]
    summary: WallSummary
    doubts: tuple[Doubt, ...]


def join(placed: Placed) -> Joined | None:
    """Return the one wall of two sides that were aligned, one with measured depth and one without; None of any others.

    Nothing of the comparison rests on it: masks, scores and alignment of both sides stay what they are.
    """
    if (sides := both_sides_of(placed)) is None:
        return None
    wall = wall_from(sides)
    cells, names = cells_of(wall), (placed.sides[0].name, placed.sides[1].name)
    is_drawn = placed.both[sides.light_side].drawing is not None
    doubt = None if is_drawn else doubt_of_short_ends(sides, names)
    summary = summary_of(cells, contradictions_of(sides, names))
    return Joined(wall, cells, summary, () if doubt is None else (doubt,))
