"""The cells of a comparison for the page's table: what each measures, and in words what the other side made of it."""

from collections.abc import Iterator, Sequence

from endoct.fusion.scoring.cells import Cell
from endoct.workbench.page.description import CellPart, CellState


def cell_parts(cells: Sequence[Cell], names: tuple[str, str], *, aligned: bool) -> Iterator[CellPart]:
    """Yield every cell as the page shows it."""
    for cell in cells:
        other = names[1] if cell.side == names[0] else names[0]
        state, why = _seen(cell, other, aligned=aligned)
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
            partner=cell.partner,
            overlap=cell.overlap,
            state=state,
            why=why,
        )


def _seen(cell: Cell, other: str, *, aligned: bool) -> tuple[CellState, str]:
    """Return what the other side made of a cell."""
    if not aligned:
        return "alone", "not aligned: nobody knows where it lies on the other side"
    partner = f"{other} {cell.partner}"
    if cell.is_matched and cell.partner:
        return "matched", f"is {partner}: overlap {cell.overlap:.2f}"
    if not cell.counts:
        return "not observed", f"not covered: {other} observed {cell.observed_by_other:.0%} of it"
    if cell.partner:
        return "overlapping", f"overlaps {partner} by {cell.overlap:.2f}, less than half"
    return "missed", f"missed: {other} observed {cell.observed_by_other:.0%} of it and shows wall"
