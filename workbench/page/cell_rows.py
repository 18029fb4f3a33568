"""The cells of a comparison as rows of the page's table: what each measures, and what the other side has there.

Where there is a truth, the rows also say whether it has a cell there.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.errors import refusing
from endoct.base.zarr.zarr_store import read_arrays
from endoct.fusion.files.masks import DRAWN_STORE, MAJORITY, read_drawn
from endoct.fusion.scoring.cells import OBSERVED, Cell
from endoct.fusion.segmentation.regions import label_in_order
from endoct.workbench.page.description import CellPart, CellState

REAL = 0.5
"""A cell is right where the truth covers at least this share of it, as half of it must overlap to match."""


def cell_parts(
    cells: Sequence[Cell], names: tuple[str, str], real: Mapping[tuple[str, int], bool], *, aligned: bool
) -> Iterator[CellPart]:
    """Yield every cell as the page shows it; ``real`` by side and number as :func:`cells_by_truth` has it."""
    for cell in cells:
        other = names[1] if cell.side == names[0] else names[0]
        is_real = real.get((cell.side, cell.id))
        state, why = _seen(cell, other, aligned=aligned)
        truth = "" if is_real is None else f"; the truth has {'a cell' if is_real else 'no cell'} there"
        yield CellPart(
            side=cell.side,
            id=cell.id,
            theta_rad=cell.theta_rad,
            z_mm=cell.z_mm,
            area_mm2=cell.area_mm2,
            diameter_mm=cell.diameter_mm,
            depth_median_mm=cell.depth_median_mm,
            depth_p95_mm=cell.depth_p95_mm,
            volume_mm3=cell.volume_mm3,
            depth_of=cell.depth_of,
            contrast=cell.contrast,
            touches_edge=cell.touches_edge,
            observed_by_other=cell.observed_by_other,
            covered=cell.covered,
            seen_by=cell.seen_by,
            partner=cell.partner,
            overlap=cell.overlap,
            state=state,
            why=why + truth,
            is_real=is_real,
        )


def _seen(cell: Cell, other: str, *, aligned: bool) -> tuple[CellState, str]:
    """Return what the other side has where a cell lies."""
    if not aligned:
        return "not aligned", "not aligned: nobody knows where it lies on the other side"
    partner = f"{other} {cell.partner}"
    if cell.is_matched and cell.partner:
        return "matched", f"is {partner}: overlap {cell.overlap:.2f}"
    if not cell.counts:
        return "not observed", f"not covered: {other} observed {cell.observed_by_other:.0%} of it"
    if cell.partner:
        return "overlapping", f"overlaps {partner} by {cell.overlap:.2f}, less than half"
    return "alone", f"only {cell.side}: {other} observed {cell.observed_by_other:.0%} of it and has wall there"


def cells_by_truth(folder: Path, names: tuple[str, str]) -> dict[tuple[str, int], bool]:
    """Return of the cells of a comparison in ``folder``, by side and number, whether the truth has a cell there.

    The truth is the one mask that was given, or what most raters drew. Cells of which it was given for less than half
    are left out; all are where there is no truth. Raises :class:`EndoctError` where a store is damaged.
    """
    k = _truth(folder)
    if k is None:
        return {}
    with refusing(f"{folder} cannot be read"):
        truth = read_arrays(folder / DRAWN_STORE, ("mask", "valid"))
        masks = read_arrays(folder / "comparison.zarr", ("mask",))["mask"]
    return {
        (side, number): is_real
        for side, mask in zip(names, masks, strict=True)
        for number, is_real in _real(mask, truth["mask"][k], truth["valid"][k])
    }


def _truth(folder: Path) -> int | None:
    """Return which of the drawn masks is the truth."""
    drawn = read_drawn(folder)
    if drawn is None:
        return None
    raters = [rater for rater, _ in drawn.drawn_by]
    if len(raters) == 1:
        return 0
    return raters.index(MAJORITY) if MAJORITY in raters else None


def _real(mask: Mask, truth: Mask, valid: Mask) -> Iterator[tuple[int, bool]]:
    labels = label_in_order(mask)
    n = int(labels.max(initial=0)) + 1
    area, known, covered = (
        np.bincount(labels[where], minlength=n) for where in (np.ones_like(mask), valid, truth & valid)
    )
    for number in range(1, n):
        if known[number] >= OBSERVED * area[number]:
            yield number, bool(covered[number] >= REAL * known[number])
