"""The task "wall": the one wall of a bore, by what an endoscope and an OCT show of it together.

Both sides lie in their true place on one fine grid, in the endoscope's frame: to find that place is another task, and
a method that joins them is not judged by how it was found. Each side's cells are endoct's, so that all methods join
the same. A case is judged where both sides observed the wall, whatever a method knows of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.fusion.comparison import on_one_grid
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.geometry.alignment import SearchOutcome
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.side_cells import doubts_of_side, segment_sides
from endoct.fusion.sides import Placed
from endoct.fusion.wall.both_sides import BothSides, both_sides_of
from endoct.fusion.wall.wall import wall_from
from endoct.workbench.bench.cases.specimens import PRESET_WORDS, load_side, simulated
from endoct.workbench.bench.program import read_array, write_array, write_given
from endoct.workbench.bench.task import SUCCESS, Case, Exchange, Range, Task, draw
from endoct.workbench.bench.tasks.depth import DEEPEST_MM, Depths
from endoct.workbench.pipeline.truth import TrueMap, load_truth, true_cells, true_pose, true_relief

GOOD_ENOUGH = 0.88
"""Jaccard index from which a wall counts as a success."""


@dataclass(frozen=True, eq=False)
class ShownPair:
    """What a method gets.

    ``sides``: what both show. ``intensity``: float32 (n_z, n_theta), the endoscope's, 0 where it observed nothing.
    ``believed``: the side of which endoct doubts less, by its place in ``sides``; the endoscope where it doubts both
    alike.
    """

    sides: BothSides
    intensity: Image
    believed: int

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return what both sides show as arrays by name: on the grid, and ``rows_…`` on the rows of OCT."""
        sides, rows = self.sides, self.sides.rows
        by_side = {
            f"{name}_{of}": getattr(sides, of)[place]
            for name, place in (("endoscope", sides.light_side), ("oct", sides.depth_side))
            for of in ("cells", "observed")
        }
        names = "probability", "relief_mm", "parallax_mm", "parallax_error_mm", "darkness"
        of_rows = {f"rows_{name}": getattr(rows, name) for name in ("z_mm", "relief_mm", "cells", "brightness")}
        return {"intensity": self.intensity, **by_side, **{name: getattr(sides, name) for name in names}, **of_rows}


@dataclass(frozen=True, eq=False)
class JoinedWall:
    """What a method answers, arrays (n_z, n_theta).

    ``cells``: bool. ``relief_mm``: float32, how far the surface lies behind the bore's wall, NaN where that is not
    known; None of a method that tells no depth.
    """

    cells: Mask
    relief_mm: Image | None = None


WallCase = Case[ShownPair, Depths]


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> WallCase:
    """Return a case: both sides of a simulated specimen, and the true wall."""
    drawn = draw(seed, index, ranges)
    with simulated(str(drawn["recipe"]), seed, index) as folder:
        case = case_of(Path(folder) / "specimen")
    return replace(case, name=f"{seed}-{index}", conditions=drawn)


def case_of(specimen: Path) -> WallCase:
    """Return the case of a folder laid out as a simulated specimen; its panoramas may be there as well.

    Raises :class:`EndoctError` where it holds no pair of which OCT measures depth, or no truth.
    """
    truth = load_truth(specimen)
    a, b = (load_side(specimen, name) for name in ("endoscope", "oct"))
    pose = true_pose(a, truth)
    lies = TrueMap(a.z_mm, pose, true_pose(b, truth)).alignment(b.z_mm)
    both, parameters = two_sides(a, b), CompareParameters()
    cells = segment_sides(*both, lies, parameters, "dark")
    placed = on_one_grid(both, cells, SearchOutcome(lies), parameters)
    if (sides := both_sides_of(placed)) is None:
        raise EndoctError(f"{specimen} holds no pair for a wall", expected="an endoscope, and an OCT with depth")
    onto = placed.samplings[0].onto(placed.grid)
    everywhere = np.ones(a.grid.shape, np.bool_)
    cell, _ = onto.mask(true_cells(truth, pose, a), everywhere)
    true = Depths(onto.known(true_relief(truth, pose, a), everywhere), cell)
    pair = ShownPair(sides, placed.sides[sides.light_side].intensity, believed_side(placed, sides))
    return Case(specimen.name, pair, true, {"specimen": specimen.name})


def believed_side(placed: Placed, sides: BothSides) -> int:
    """Return the side of which endoct doubts less, by its place; the one with light where it doubts both alike."""
    doubted = [len(doubts_of_side(*of)) for of in zip(placed.both, placed.cells, strict=True)]
    return sides.depth_side if doubted[sides.depth_side] < doubted[sides.light_side] else sides.light_side


def judge(case: WallCase, answer: JoinedWall) -> dict[str, float]:
    """Score a wall where both sides observed it. Raises :class:`EndoctError` for an answer that is no wall."""
    sides, true = case.given.sides, case.truth
    cells = np.asarray(answer.cells)
    if cells.shape != sides.grid.shape or cells.dtype != np.bool_:
        raise EndoctError("that is no mask", found=f"{cells.dtype} {cells.shape}", expected=f"bool {sides.grid.shape}")
    judged = sides.observed[0] & sides.observed[1] & np.isfinite(true.relief_mm)
    overlaps = [jaccard(mask, true.cell, judged) for mask in (cells, *sides.cells)]
    overlap, *alone = (1.0 if each is None else each for each in overlaps)  # no cell, and none answered
    scores = {SUCCESS: float(overlap >= GOOD_ENOUGH), "jaccard": overlap, "ahead": overlap - max(alone)}
    return scores if answer.relief_mm is None else scores | _of_depth(np.asarray(answer.relief_mm), cells, true, judged)


def _of_depth(relief_mm: NDArray[Any], cells: Mask, true: Depths, judged: Mask) -> dict[str, float]:
    """Return how far depth in true cells and the volume of all are off; what is not known is the bore's wall."""
    if relief_mm.shape != cells.shape or relief_mm.dtype.kind != "f":
        raise EndoctError("that is no depth", found=f"{relief_mm.dtype} {relief_mm.shape}", expected=f"{cells.shape}")
    answered_mm = np.clip(np.nan_to_num(relief_mm), -DEEPEST_MM, DEEPEST_MM)
    true_mm, cell = np.clip(true.relief_mm, -DEEPEST_MM, DEEPEST_MM), true.cell & judged
    if not cell.any():
        return {}
    volume = float(answered_mm[cells & judged].sum() / true_mm[cell].sum())
    return {"depth_um": float(1e3 * np.abs(answered_mm - true_mm)[cell].mean()), "volume_off": abs(volume - 1)}


def ours(pair: ShownPair) -> JoinedWall:
    """Join both sides as `endoct compare` does."""
    wall = wall_from(pair.sides)
    return JoinedWall(wall.cells, wall.relief_mm)


def _write_pair(pair: ShownPair, folder: Path) -> None:
    grid, believed = pair.sides.grid, pair.believed == pair.sides.depth_side
    facts = {
        "z_mm": grid.z_mm.tolist(),
        "theta_rad": grid.theta_rad.tolist(),
        "radius_mm": grid.radius_mm,
        "believed": "oct" if believed else "endoscope",
    }
    write_given(folder, facts, **pair.arrays())


def _write_wall(answer: JoinedWall, folder: Path) -> None:
    write_array("cells", answer.cells, folder)
    if answer.relief_mm is not None:
        write_array("relief_mm", answer.relief_mm, folder)


def _read_wall(_pair: ShownPair, folder: Path) -> JoinedWall:
    has_depth = (folder / "relief_mm.npy").is_file()
    cells = read_array(folder, "cells")
    if cells.dtype.kind not in "bu":
        raise EndoctError("cells.npy is no mask", found=f"{cells.dtype}", expected="bool or u8")
    return JoinedWall(np.asarray(cells, np.bool_), read_array(folder, "relief_mm") if has_depth else None)


TASK = Task(
    name="wall",
    title="one wall of what an endoscope and an OCT show of a bore",
    signature=(
        "method(pair: endoct.workbench.bench.tasks.wall.ShownPair) -> JoinedWall\n"
        "Its cells and, where the method has them, depths in mm behind the bore's wall, on the samples of "
        "pair.sides.grid. Both sides lie there in their true place; a depth that is NaN counts as 0."
    ),
    cases=cases,
    judge=judge,
    ranges={"recipe": ("quick",)},
    optional={"recipe": PRESET_WORDS},
    scores={
        "jaccard": "Jaccard index of the cells where both sides observed the wall",
        "ahead": "Jaccard index minus that of the better side, which only the truth tells",
        "depth_um": "mean error of depth in true cells, to 1.5 mm, µm",
        "volume_off": "error of the volume of all cells, of the true one",
    },
    own=lambda specimen: [case_of(specimen)],
    against="endoct",
    exchange=Exchange(write=_write_pair, read=_read_wall, answer=_write_wall),
    success=f"a Jaccard index of at least {GOOD_ENOUGH:g}, or no sample marked where there is no cell",
)
