"""All scores of two masks of one wall: of the two sides, and of a side against a mask given as truth."""

from collections.abc import Sequence
from dataclasses import dataclass

from endoct.fusion.geometry.placement import Sampling
from endoct.fusion.result import Bootstrap, Budget, MaskScores, PairScores, Scores
from endoct.fusion.scoring.boundary import boundary_scores
from endoct.fusion.scoring.budget import agreement_budget
from endoct.fusion.scoring.cells import Cell, area_limits, cell_scores, depth_limits, drift, measure
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED
from endoct.fusion.scoring.overlap import Sites, find_sites, overlap, strata
from endoct.fusion.scoring.reliefs import compare_reliefs
from endoct.fusion.scoring.surface import Surface
from endoct.stitching.grid import SurfaceGrid

BOOTSTRAP = Bootstrap(resamples=RESAMPLES, seed=SEED, level=LEVEL, over="sites: places where either shows a cell")


@dataclass(frozen=True, eq=False)
class Scored:
    """Cells of both sides; where they are aligned, their scores, and where their disagreement comes from."""

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

    ``samplings`` say how each came there. None where the sides are not aligned: then each side's cells are measured by
    themselves, and nothing is scored. The scores lack the overlap on B's own rows.
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
