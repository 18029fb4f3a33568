"""What a comparison folder holds, read back for its report."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from endoct.fusion.comparison import Comparison, load_comparison
from endoct.fusion.evidence.prepare import MASK_MODALITY
from endoct.fusion.files.result_file import read_result
from endoct.fusion.scoring.cells import Cell
from endoct.modalities.contract import Picture
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.contents import check_intact
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.report.pictures import load_pictures


@dataclass(frozen=True, eq=False)
class SideFindings:
    """One side of a comparison.

    ``intensity``, ``depth_mm`` (None where the side has no depth), ``mask`` (cells) and ``valid`` lie on the
    comparison's grid, (n_z, n_theta); ``panorama`` is what the side saw on its own rows; ``pictures`` of single
    frames by the frame's place in the order of ascending z.
    """

    name: str
    intensity: Image
    depth_mm: Image | None
    mask: Mask
    valid: Mask
    panorama: Panorama
    pictures: Mapping[int, tuple[Picture, ...]]

    @property
    def is_drawn_mask(self) -> bool:
        """Whether the side is a mask drawn by hand: it has no intensity worth showing."""
        return self.panorama.modality == MASK_MODALITY

    @property
    def frame_z_mm(self) -> Coordinates:
        """Place of every frame, float64 (n_frames,), mm, in the side's own frame; empty where unknown."""
        places = self.panorama.per_frame.get(f"{self.panorama.frame_dim}_z_mm")
        return np.empty(0) if places is None else np.asarray(places.values, dtype=np.float64)


@dataclass(frozen=True)
class Overlap:
    """How far two masks agree: ``of`` what with what, ``where``, and the scores (Jaccard index, Dice, areas).

    ``interval`` is that of the Jaccard index, bootstrapped over cells; None where it is not known. ``is_detail`` says
    that others tell more at a glance: of several raters, what most agree on.
    """

    of: tuple[str, str]
    where: str
    scores: Mapping[str, float | None]
    interval: tuple[float, float] | None = None
    is_detail: bool = False


@dataclass(frozen=True, eq=False)
class Findings:
    """A comparison folder: ``result`` as in ``result.json``, the common grid in A's frame, the sides, their cells."""

    result: Mapping[str, Any]
    grid: SurfaceGrid
    sides: tuple[SideFindings, SideFindings]
    cells: tuple[Cell, ...] = ()

    @property
    def aligned(self) -> bool:
        """Whether the two sides could be brought onto each other; if not, nothing may be overlaid or scored."""
        return bool(self.result["aligned"])

    @property
    def overlaps(self) -> tuple[Overlap, ...]:
        """Every agreement that was scored: of the two sides where they are aligned, and with masks given as truth."""
        return tuple(_overlaps(self.result))


def read_findings(folder: Path) -> Findings:
    """Read what ``endoct compare`` wrote. Raises :class:`EndoctError` where ``folder`` is no whole comparison."""
    check_intact(folder)
    result = read_result(folder)
    comparison = load_comparison(folder / "comparison.zarr")
    if tuple(result["sides"]) != comparison.sides:
        found = f"{', '.join(result['sides'])} and {', '.join(comparison.sides)}"
        raise EndoctError(f"result.json and comparison.zarr in {folder} have other sides", found=found)
    pictures = load_pictures(folder / "pictures")
    a, b = (_side(comparison, k, name, folder, pictures.get(name, {})) for k, name in enumerate(comparison.sides))
    return Findings(result, comparison.grid, (a, b), comparison.cells)


def _side(
    comparison: Comparison, k: int, name: str, folder: Path, pictures: Mapping[int, tuple[Picture, ...]]
) -> SideFindings:
    depth_mm = comparison.depth_mm[k]
    return SideFindings(
        name=name,
        intensity=comparison.intensity[k],
        depth_mm=depth_mm if np.isfinite(depth_mm).any() else None,
        mask=comparison.mask[k],
        valid=comparison.valid[k],
        panorama=load_panorama(folder / "panoramas" / f"{name}.zarr"),
        pictures=pictures,
    )


def _overlaps(result: Mapping[str, Any]) -> Iterator[Overlap]:
    if result["aligned"]:
        first, second = result["sides"]
        scores = result.get("scores") or {}
        grid = scores.get("grid", {})
        numbers = {"jaccard": result["jaccard"], "dice": result["dice"]} | _numbers(grid)
        yield Overlap((first, second), "on the common grid", numbers, _interval(grid))
        if rows := scores.get("own_rows"):
            where = f"on the own rows of {rows['rows_of']}, not interpolated"
            yield Overlap((first, second), where, _numbers(rows), _interval(rows))
    consensus = (result.get("raters") or {}).get("consensus", {})
    for path, sides in (result.get("truth") or {}).items():
        for side, scores in sides.items():
            where = f"against {Path(path).name}"
            yield Overlap((side, "given truth"), where, _numbers(scores), _interval(scores), bool(consensus))
    for name, told in consensus.items():
        for side, scores in told["sides"].items():
            where = f"against what the raters agree on ({name})"
            yield Overlap((side, "consensus"), where, _numbers(scores), _interval(scores), name != "majority")


def _interval(scores: Mapping[str, Any]) -> tuple[float, float] | None:
    interval = scores.get("jaccard_interval")
    return None if interval is None else (interval[0], interval[1])


def _numbers(scores: Mapping[str, Any]) -> dict[str, float | None]:
    return {key: value for key, value in scores.items() if value is None or isinstance(value, int | float)}
