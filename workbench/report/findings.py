"""What a report needs of a comparison, just made or read back from its folder."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.files.contents import check_intact
from endoct.fusion.files.store import load_compared
from endoct.fusion.result import Overlap, Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.modalities.contract import Picture
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.report.pictures import load_pictures
from endoct.workbench.report.side_findings import BothSides, SideFindings

BY_LI = "by Li's threshold alone"


@dataclass(frozen=True)
class NamedOverlap:
    """An overlap and what it is ``of`` and ``where``.

    ``is_detail``: it belongs into a table, not into the headline, as a single rater where there is a consensus.
    """

    of: tuple[str, str]
    where: str
    overlap: Overlap
    is_detail: bool = False


@dataclass(frozen=True, eq=False)
class Findings(BothSides):
    """A comparison for its report: both sides on the common grid, its result and their cells."""

    result: Result
    cells: tuple[Cell, ...] = ()


def read_findings(folder: Path) -> Findings:
    """Read what ``endoct compare`` wrote. Raises :class:`EndoctError` where ``folder`` is no whole comparison."""
    check_intact(folder)
    comparison = load_compared(folder)
    pictures = load_pictures(folder / "pictures")
    panoramas = [load_panorama(folder / "panoramas" / f"{name}.zarr") for name in comparison.names]
    return findings_of(comparison, panoramas, pictures)


def findings_of(
    comparison: Comparison, panoramas: Sequence[Panorama], pictures: Mapping[str, Mapping[int, tuple[Picture, ...]]]
) -> Findings:
    """Return what there is to report of ``comparison``; ``panoramas`` of its sides, ``pictures`` by their names."""
    both = both_sides(comparison.grid, comparison.sides, panoramas, pictures, aligned=comparison.result.aligned)
    return Findings(both.grid, both.sides, both.aligned, comparison.result, comparison.cells)


def both_sides(
    grid: SurfaceGrid,
    placed: tuple[PlacedSide, PlacedSide],
    panoramas: Sequence[Panorama],
    pictures: Mapping[str, Mapping[int, tuple[Picture, ...]]],
    *,
    aligned: bool,
) -> BothSides:
    """Return both sides as they are ``placed`` on the common ``grid``."""
    a, b = (
        SideFindings(
            name=side.name,
            intensity=side.intensity,
            depth_mm=side.depth_mm if np.isfinite(side.depth_mm).any() else None,
            mask=side.mask,
            valid=side.valid,
            panorama=panorama,
            pictures=pictures.get(side.name, {}),
            planes=side.planes,
        )
        for side, panorama in zip(placed, panoramas, strict=True)
    )
    return BothSides(grid, (a, b), aligned)


def overlaps_of(result: Result) -> Iterator[NamedOverlap]:
    """Yield every overlap that was scored: of the two sides, and with masks given as truth."""
    if on_grid := result.overlap:
        yield NamedOverlap(result.sides, "on the common grid", on_grid)
        if own_rows := result.scores.own_rows if result.scores else None:
            yield NamedOverlap(result.sides, f"on the rows of {own_rows.rows_of}, not interpolated", own_rows)
        if by_li := result.by_li:
            yield NamedOverlap(result.sides, f"{BY_LI}, on the common grid", by_li.grid)
            where = f"{BY_LI}, on the rows of {by_li.own_rows.rows_of}"
            yield NamedOverlap(result.sides, where, by_li.own_rows, is_detail=True)
    for path, sides in (result.truth or {}).items():
        for side, scores in sides.items():
            yield NamedOverlap((side, "given truth"), f"against {Path(path).name}", scores, bool(result.raters))
    for name, consensus in (result.raters.consensus if result.raters else {}).items():
        for side, scores in consensus.sides.items():
            where = f"against what the raters agree on ({name})"
            yield NamedOverlap((side, "consensus"), where, scores, name != "majority")
