"""What a comparison folder holds, read back for its report."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.fusion.files.store import load_comparison
from endoct.fusion.result import Overlap, Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.sides import PlacedSide
from endoct.modalities.contract import Picture
from endoct.stitching.contents import check_intact
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import load_panorama
from endoct.workbench.report.pictures import load_pictures
from endoct.workbench.report.side_findings import SideFindings


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
class Findings:
    """A comparison folder: its result, the common grid in A's frame, the sides, their cells."""

    result: Result
    grid: SurfaceGrid
    sides: tuple[SideFindings, SideFindings]
    cells: tuple[Cell, ...] = ()

    @property
    def aligned(self) -> bool:
        """Whether the two sides could be brought onto each other; if not, nothing may be overlaid or scored."""
        return self.result.aligned


def read_findings(folder: Path) -> Findings:
    """Read what ``endoct compare`` wrote. Raises :class:`EndoctError` where ``folder`` is no whole comparison."""
    check_intact(folder)
    comparison = load_comparison(folder / "comparison.zarr")
    pictures = load_pictures(folder / "pictures")
    a, b = (_side(side, folder, pictures.get(side.name, {})) for side in comparison.sides)
    return Findings(comparison.result, comparison.grid, (a, b), comparison.cells)


def _side(side: PlacedSide, folder: Path, pictures: Mapping[int, tuple[Picture, ...]]) -> SideFindings:
    return SideFindings(
        name=side.name,
        intensity=side.intensity,
        depth_mm=side.depth_mm if np.isfinite(side.depth_mm).any() else None,
        mask=side.mask,
        valid=side.valid,
        panorama=load_panorama(folder / "panoramas" / f"{side.name}.zarr"),
        pictures=pictures,
    )


def overlaps_of(result: Result) -> tuple[NamedOverlap, ...]:
    """Return every overlap that was scored: of the two sides, and with masks given as truth."""
    return tuple(_overlaps(result))


def _overlaps(result: Result) -> Iterator[NamedOverlap]:
    if on_grid := result.overlap:
        yield NamedOverlap(result.sides, "on the common grid", on_grid)
        if own_rows := result.scores.own_rows if result.scores else None:
            yield NamedOverlap(result.sides, f"on the rows of {own_rows.rows_of}, not interpolated", own_rows)
    for path, sides in (result.truth or {}).items():
        for side, scores in sides.items():
            yield NamedOverlap((side, "given truth"), f"against {Path(path).name}", scores, bool(result.raters))
    for name, consensus in (result.raters.consensus if result.raters else {}).items():
        for side, scores in consensus.sides.items():
            where = f"against what the raters agree on ({name})"
            yield NamedOverlap((side, "consensus"), where, scores, name != "majority")
