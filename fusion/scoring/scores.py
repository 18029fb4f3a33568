"""All scores of two masks of one wall: of the two sides, and of a side against a mask given as truth.

The reliefs of two sides are compared sample by sample and by depth, after Bland and Altman.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.geometry.placement import Sampling
from endoct.fusion.result import Bootstrap, Budget, MaskScores, PairScores, Reliefs, ReliefStratum, Scores
from endoct.fusion.scoring.boundary import boundary_scores
from endoct.fusion.scoring.budget import agreement_budget
from endoct.fusion.scoring.cells import Cell, area_limits, cell_scores, depth_limits, drift, measure
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED
from endoct.fusion.scoring.overlap import Sites, Surface, find_sites, overlap, strata
from endoct.stitching.grid import SurfaceGrid

BOOTSTRAP = Bootstrap(resamples=RESAMPLES, seed=SEED, level=LEVEL, over="sites: places where either shows a cell")
DEPTHS_MM = (0.05, 0.1, 0.3, 0.7)
RIM_MM = 0.1
"""Nothing is compared so near an outline of either side's cells: one side sees the floor there, the other the wall."""
FEWEST_SAMPLES = 200
"""Fewer samples have no limits of agreement."""


@dataclass(frozen=True, eq=False)
class Scored:
    """The cells of both sides; where these are aligned, also their scores and what their disagreement comes from."""

    cells: tuple[Cell, ...]
    scores: PairScores | None
    budget: Budget | None


def score_sides(
    surfaces: tuple[Surface, Surface],
    grid: SurfaceGrid,
    samplings: tuple[Sampling, Sampling] | None,
    tolerance_mm: float,
) -> Scored:
    """Return the cells and scores of ``surfaces``, what two sides show on ``grid``.

    ``samplings`` say how each came there. They are None where the sides are not aligned. Then each side's cells are
    measured by themselves, and nothing is scored. The scores lack the overlap on B's own rows.
    """
    cells = measure(*surfaces, grid, aligned=samplings is not None)
    if samplings is None:
        return Scored(cells, None, None)
    budget = agreement_budget(surfaces, samplings, cells, grid)
    return Scored(cells, pair_scores(*surfaces, cells, grid, tolerance_mm), budget)


def pair_scores(a: Surface, b: Surface, cells: Sequence[Cell], grid: SurfaceGrid, tolerance_mm: float) -> PairScores:
    """Return the scores of two sides on ``grid``; ``cells`` are those of both."""
    sites = _sites(a, b, grid)
    of_masks = _scores(a, b, sites, cells, grid, tolerance_mm)
    return PairScores(grid=overlap(a, b, sites), reliefs=compare_reliefs(a, b, grid), **dict(of_masks))


def mask_scores(
    mask: Surface, side: Surface, cells: Sequence[Cell], grid: SurfaceGrid, tolerance_mm: float
) -> MaskScores:
    """Return the scores of ``side`` against ``mask`` on ``grid``; ``cells`` are those of both."""
    sites = _sites(mask, side, grid)
    return MaskScores(**dict(overlap(mask, side, sites)), **dict(_scores(mask, side, sites, cells, grid, tolerance_mm)))


def _sites(a: Surface, b: Surface, grid: SurfaceGrid) -> Sites:
    return find_sites(a.mask, b.mask, a.valid & b.valid, grid.dz_mm * grid.dtheta_mm)


def _scores(
    a: Surface, b: Surface, sites: Sites, cells: Sequence[Cell], grid: SurfaceGrid, tolerance_mm: float
) -> Scores:
    return Scores(
        boundary=boundary_scores(a, b, sites, grid, tolerance_mm),
        cells=cell_scores(a.name, b.name, cells),
        area_mm2=area_limits(a.name, b.name, cells),
        depth_mm=depth_limits(a.name, b.name, cells),
        drift=drift(a.name, b.name, cells, grid),
        strata=strata(sites, (a, b)),
    )


def compare_reliefs(a: Surface, b: Surface, grid: SurfaceGrid) -> Reliefs | None:
    """Return how far the relief of ``b`` lies behind that of ``a`` on ``grid``; None where a side has none.

    Samples are parted by the mean of both (Bland and Altman 1999, doi:10.1177/096228029900800204). The limits are
    percentiles, since the differences are not normal. Samples are not independent, so nothing is said of significance.
    """
    if a.relief_mm is None or b.relief_mm is None:
        return None
    both = a.valid & b.valid
    known = both & np.isfinite(a.relief_mm) & np.isfinite(b.relief_mm)
    compared = known & _off_rims(a.mask, grid) & _off_rims(b.mask, grid)
    of_a, of_b = (side[compared].astype(np.float64) for side in (a.relief_mm, b.relief_mm))
    differs, mean = of_b - of_a, (of_a + of_b) / 2
    stated = [side.relief_error_mm for side in (a, b) if side.relief_error_mm is not None]
    error = np.sqrt(sum(np.square(one[compared], dtype=np.float64) for one in stated)) if stated else None
    strata = []
    for low, high in zip((None, *DEPTHS_MM), (*DEPTHS_MM, None), strict=True):
        inside = (mean >= (-np.inf if low is None else low)) & (mean < (np.inf if high is None else high))
        of = differs[inside]
        limits = _limits(of, None if error is None else error[inside])
        strata.append(ReliefStratum(low=low, to=high, area_mm2=of.size * grid.dz_mm * grid.dtheta_mm, **limits))
    share = np.count_nonzero(known) / max(int(np.count_nonzero(both)), 1)
    return Reliefs(first=a.name, second=b.name, known=share, rim_mm=RIM_MM, strata=tuple(strata))


def _off_rims(cells: Mask, grid: SurfaceGrid) -> Mask:
    """Return what lies farther than ``RIM_MM`` from the outlines of ``cells``."""
    if not cells.any() or cells.all():
        return np.ones(cells.shape, np.bool_)
    return np.abs(signed_distance(cells, (grid.dz_mm, grid.dtheta_mm), 2 * RIM_MM)) > RIM_MM


def _limits(differs: Coordinates, error: Coordinates | None) -> dict[str, float | None]:
    if differs.size < FEWEST_SAMPLES:
        return {}
    low, median, high = np.quantile(differs, [0.025, 0.5, 0.975])
    return {
        "mean": float(differs.mean()),
        "median": float(median),
        "spread": float(robust_sigma(differs - median)),
        "low_limit": float(low),
        "high_limit": float(high),
        "within_two_errors": None if error is None else float((np.abs(differs) <= 2 * error).mean()),
    }
