"""Everything by which two masks of one wall are told to agree, as ``result.json`` holds it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from endoct.fusion.scoring.boundary import BoundaryDistances, boundary_distances, near, outline
from endoct.fusion.scoring.cells import Cell, Surface
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED, Interval, ratio_interval
from endoct.fusion.scoring.overlap import agreement, bland_altman
from endoct.fusion.scoring.sites import Sites, find_sites, strata
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.stitching.grid import SurfaceGrid

FEWEST_TO_DRIFT = 6
"""Of fewer matched cells no drift is told."""

BOOTSTRAP = {"resamples": RESAMPLES, "seed": SEED, "level": LEVEL, "over": "sites: places where either shows a cell"}


def scorecard(a: Surface, b: Surface, cells: Sequence[Cell], grid: SurfaceGrid, tolerance_mm: float) -> dict[str, Any]:
    """Return the scores of ``b`` against ``a`` on ``grid``, JSON-serialisable; ``cells`` are those of both.

    ``overlap`` as :meth:`~endoct.fusion.scoring.overlap.Agreement.as_json` with intervals; ``boundary``, ``cells``,
    ``area_mm2``, ``depth_mm``, ``drift`` and ``strata``, each None where there is nothing to score.
    """
    both = a.valid & b.valid
    sites = find_sites(a.mask, b.mask, both, grid.dz_mm * grid.dtheta_mm)
    return {
        "overlap": overlap_scores(a, b, sites, grid),
        "boundary": _boundary(a, b, sites, grid, tolerance_mm),
        "cells": _cells(a.name, b.name, cells),
        **_quantities(a, b, cells),
        "drift": _drift(a.name, b.name, cells, grid),
        "strata": strata(sites, (a, b)),
    }


def overlap_scores(a: Surface, b: Surface, sites: Sites, grid: SurfaceGrid) -> dict[str, Any]:
    """Return Jaccard index, Dice, areas in mm², the intervals of the first two and the number of sites."""
    counted = agreement(a.mask, b.mask, a.valid & b.valid, grid.dz_mm * grid.dtheta_mm)
    return {
        **counted.as_json(),
        "sites": int(sites.both.size),
        "jaccard_interval": sites.jaccard_interval(),
        "dice_interval": sites.dice_interval(),
    }


def _boundary(a: Surface, b: Surface, sites: Sites, grid: SurfaceGrid, tolerance_mm: float) -> dict[str, Any] | None:
    both = a.valid & b.valid
    of_a, of_b = (outline(side.mask, both, grid.dz_mm, grid.dtheta_mm, sites.labels) for side in (a, b))
    found = boundary_distances(of_a, of_b, grid.n_theta * grid.dtheta_mm)
    if found is None:
        return None
    near_a, near_b = near(found.a_to_b_mm, tolerance_mm), near(found.b_to_a_mm, tolerance_mm)
    return {
        "mean_mm": found.mean_mm,
        "mean_interval_mm": _over_sites(found, found.a_to_b_mm, found.b_to_a_mm, sites),
        "p95_mm": found.p95_mm,
        "within_share": found.within(tolerance_mm),
        "within_interval": _over_sites(found, near_a, near_b, sites),
        "tolerance_mm": tolerance_mm,
    }


def _over_sites(found: BoundaryDistances, of_a: Coordinates, of_b: Coordinates, sites: Sites) -> Interval:
    """Return the interval of a mean over both outlines' length, resampled over sites."""
    n = sites.both.size + 1
    total, length = np.zeros(n), np.zeros(n)
    for side, values in ((found.a, of_a), (found.b, of_b)):
        total += np.bincount(side.label, side.length_mm * values, n)
        length += np.bincount(side.label, side.length_mm, n)
    return ratio_interval(total[1:], length[1:])


def _cells(reference: str, other: str, cells: Sequence[Cell]) -> dict[str, Any] | None:
    """Return precision and recall of ``other``'s cells against ``reference``'s, and their panoptic quality.

    Kirillov et al. 2019, Panoptic Segmentation: quality = Σ overlap of matched pairs / (pairs + half the rest).
    """
    of_reference = [c for c in cells if c.side == reference and c.counts]
    of_other = [c for c in cells if c.side == other and c.counts]
    if not of_reference and not of_other:
        return None
    # a pair counts where both its cells do
    counted = {(c.side, c.id) for c in (*of_reference, *of_other)}
    found = np.array([c.is_matched and (other, c.partner) in counted for c in of_reference], dtype=np.float64)
    right = np.array([c.is_matched and (reference, c.partner) in counted for c in of_other], dtype=np.float64)
    overlaps = np.array([c.overlap for c in of_reference]) * found
    # things to resample: pairs and cells of the reference without one, then cells of the other without one
    extra = int((right == 0).sum())
    share = np.r_[np.where(found > 0, 1.0, 0.5), np.full(extra, 0.5)]
    return {
        "reference": reference,
        "other": other,
        "of_reference": len(of_reference),
        "of_other": len(of_other),
        "matched": int(found.sum()),
        "precision": _mean(right),
        "precision_interval": ratio_interval(right, np.ones(right.size)),
        "recall": _mean(found),
        "recall_interval": ratio_interval(found, np.ones(found.size)),
        "quality": float(overlaps.sum() / share.sum()),
        "quality_interval": ratio_interval(np.r_[overlaps, np.zeros(extra)], share),
        "overlap_of_matched": float(overlaps.sum() / found.sum()) if found.any() else None,
        "half_covered_of_reference": _mean(np.array([(c.covered or 0) >= 0.5 for c in of_reference])),
        "half_covered_of_other": _mean(np.array([(c.covered or 0) >= 0.5 for c in of_other])),
    }


def whole_pairs(a: str, b: str, cells: Sequence[Cell]) -> list[tuple[Cell, Cell]]:
    """Return the cells that both sides show whole, matched: (A's, B's)."""
    of_b = {c.id: c for c in cells if c.side == b}
    pairs = [(c, of_b[c.partner]) for c in cells if c.side == a and c.is_matched and c.partner is not None]
    return [(one, two) for one, two in pairs if not one.touches_edge and not two.touches_edge]


def _drift(a: str, b: str, cells: Sequence[Cell], grid: SurfaceGrid) -> dict[str, Any] | None:
    """Return how far matched whole cells lie apart, B's less A's, along z and around the bore, and how that grows.

    For each of ``z_mm`` and ``arc_mm``: the ``mean`` of the distance of their centroids, its slope along z
    (``per_mm``) by least squares and that slope's standard error. What a rigid alignment should leave is no slope.
    """
    pairs = whole_pairs(a, b, cells)
    at_mm = np.array([one.z_mm for one, _ in pairs])
    if at_mm.size < FEWEST_TO_DRIFT or np.ptp(at_mm) == 0:
        return None
    along_mm = np.array([two.z_mm - one.z_mm for one, two in pairs])
    turn_rad = wrap_rad([two.theta_rad - one.theta_rad for one, two in pairs])
    return {
        "pairs": len(pairs),
        "length_mm": float(np.ptp(at_mm)),
        "z_mm": _line(at_mm, along_mm),
        "arc_mm": _line(at_mm, turn_rad * grid.radius_mm),
    }


def _line(at_mm: Coordinates, apart_mm: Coordinates) -> dict[str, float]:
    away = at_mm - at_mm.mean()
    slope = float(away @ apart_mm / (away @ away))
    residual = apart_mm - apart_mm.mean() - slope * away
    error = float(np.sqrt(residual @ residual / (at_mm.size - 2) / (away @ away)))
    return {"mean": float(apart_mm.mean()), "per_mm": slope, "per_mm_error": error}


def _quantities(a: Surface, b: Surface, cells: Sequence[Cell]) -> dict[str, Any]:
    """Return how areas and depths of whole, matched cells agree; None where fewer than three pairs tell."""
    pairs = whole_pairs(a.name, b.name, cells)
    area = bland_altman(*np.array([(one.area_mm2, two.area_mm2) for one, two in pairs]).reshape(-1, 2).T)
    depths = [
        (one.depth_median_mm, two.depth_median_mm)
        for one, two in pairs
        if one.depth_of == a.name and two.depth_of == b.name
    ]
    depth = bland_altman(*np.array(depths, dtype=np.float64).reshape(-1, 2).T)
    return {"area_mm2": area, "depth_mm": depth}


def _mean(values: Coordinates) -> float | None:
    return float(np.mean(values)) if values.size else None
