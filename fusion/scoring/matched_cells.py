"""How far the cells of two sides agree as objects: which are matched, what these measure, and how they drift apart."""

from collections.abc import Sequence

import numpy as np

from endoct.fusion.result import CellScores, Drift, Limits, Line
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.scoring.intervals import ratio_interval
from endoct.fusion.scoring.overlap import bland_altman
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.stitching.grid import SurfaceGrid

FEWEST_TO_DRIFT = 6
"""From fewer matched cells no drift is estimated."""


def cell_scores(reference: str, other: str, cells: Sequence[Cell]) -> CellScores | None:
    """Return precision and recall of ``other``'s cells against ``reference``'s, and their panoptic quality.

    Kirillov et al. 2019, Panoptic Segmentation: quality = Σ overlap of matched pairs / (pairs + half the rest). None
    where neither side has a cell that counts.
    """
    of_reference = [c for c in cells if c.side == reference and c.counts]
    of_other = [c for c in cells if c.side == other and c.counts]
    if not of_reference and not of_other:
        return None
    # a pair counts where both its cells do
    counted = {(c.side, c.id) for c in (*of_reference, *of_other)}
    recalled = np.array([c.is_matched and (other, c.partner) in counted for c in of_reference], dtype=np.float64)
    right = np.array([c.is_matched and (reference, c.partner) in counted for c in of_other], dtype=np.float64)
    overlaps = np.array([c.overlap for c in of_reference]) * recalled
    # things to resample: pairs and cells of the reference without one, then cells of the other without one
    extra = int((right == 0).sum())
    share = np.r_[np.where(recalled > 0, 1.0, 0.5), np.full(extra, 0.5)]
    return CellScores(
        reference=reference,
        other=other,
        of_reference=len(of_reference),
        of_other=len(of_other),
        matched=int(recalled.sum()),
        precision=_mean(right),
        precision_interval=ratio_interval(right, np.ones(right.size)),
        recall=_mean(recalled),
        recall_interval=ratio_interval(recalled, np.ones(recalled.size)),
        quality=float(overlaps.sum() / share.sum()),
        quality_interval=ratio_interval(np.r_[overlaps, np.zeros(extra)], share),
        overlap_of_matched=float(overlaps.sum() / recalled.sum()) if recalled.any() else None,
        half_covered_of_reference=_mean(np.array([(c.covered or 0) >= 0.5 for c in of_reference])),
        half_covered_of_other=_mean(np.array([(c.covered or 0) >= 0.5 for c in of_other])),
    )


def whole_pairs(a: str, b: str, cells: Sequence[Cell]) -> list[tuple[Cell, Cell]]:
    """Return the cells that both sides show whole, matched: (A's, B's)."""
    of_b = {c.id: c for c in cells if c.side == b}
    pairs = [(c, of_b[c.partner]) for c in cells if c.side == a and c.is_matched and c.partner is not None]
    return [(one, two) for one, two in pairs if not one.touches_edge and not two.touches_edge]


def areas_mm2(a: str, b: str, cells: Sequence[Cell]) -> Coordinates:
    """Return the areas of matched whole cells, (n, 2): A's, B's."""
    return np.array([(one.area_mm2, two.area_mm2) for one, two in whole_pairs(a, b, cells)]).reshape(-1, 2)


def area_limits(a: str, b: str, cells: Sequence[Cell]) -> Limits | None:
    """Return how the areas of matched whole cells agree, mm²; None where there are fewer than three pairs."""
    return bland_altman(*areas_mm2(a, b, cells).T)


def depth_limits(a: str, b: str, cells: Sequence[Cell]) -> Limits | None:
    """Return how the depths of matched whole cells agree where each side measured its own, mm; None as for areas."""
    depths = [
        (one.depth_median_mm, two.depth_median_mm)
        for one, two in whole_pairs(a, b, cells)
        if one.depth_of == a and two.depth_of == b
    ]
    return bland_altman(*np.array(depths, dtype=np.float64).reshape(-1, 2).T)


def drift(a: str, b: str, cells: Sequence[Cell], grid: SurfaceGrid) -> Drift | None:
    """Return how far matched whole cells lie apart, B's less A's, along z and around the bore, and how that grows.

    By least squares. What a rigid alignment should leave is no slope. None where there are too few pairs, or all of
    them lie at one place along z.
    """
    pairs = whole_pairs(a, b, cells)
    at_mm = np.array([one.z_mm for one, _ in pairs])
    if at_mm.size < FEWEST_TO_DRIFT or np.ptp(at_mm) == 0:
        return None
    along_mm = np.array([two.z_mm - one.z_mm for one, two in pairs])
    turn_rad = wrap_rad([two.theta_rad - one.theta_rad for one, two in pairs])
    return Drift(
        pairs=len(pairs),
        length_mm=float(np.ptp(at_mm)),
        z_mm=_line(at_mm, along_mm),
        arc_mm=_line(at_mm, turn_rad * grid.radius_mm),
    )


def _line(at_mm: Coordinates, apart_mm: Coordinates) -> Line:
    away = at_mm - at_mm.mean()
    slope = float(away @ apart_mm / (away @ away))
    residual = apart_mm - apart_mm.mean() - slope * away
    error = float(np.sqrt(residual @ residual / (at_mm.size - 2) / (away @ away)))
    return Line(mean=float(apart_mm.mean()), per_mm=slope, per_mm_error=error)


def _mean(values: Coordinates) -> float | None:
    return float(np.mean(values)) if values.size else None
