"""What two sides on one grid are scored by: their cells as objects, all scores, and where disagreement comes from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import Samples
from endoct.fusion.scoring.budget import agreement_budget
from endoct.fusion.scoring.cells import Cell, Surface, label_in_order, measure
from endoct.fusion.scoring.scorecard import scorecard
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama


@dataclass(frozen=True, eq=False)
class Scored:
    """Cells of both sides; where they are aligned, ``scores`` and ``budget`` as ``result.json`` holds them."""

    cells: tuple[Cell, ...]
    scores: Mapping[str, Any] | None
    budget: Mapping[str, Any] | None


def score(
    sides: tuple[Panorama, Panorama],
    surfaces: tuple[Surface, Surface],
    grid: SurfaceGrid,
    alignment: Alignment | None,
    tolerance_mm: float,
) -> Scored:
    """Return what ``surfaces`` of two ``sides`` on ``grid`` are scored by; ``alignment`` None: each by itself."""
    labels = label_in_order(surfaces[0].mask), label_in_order(surfaces[1].mask)
    cells = measure(surfaces, labels, grid, aligned=alignment is not None)
    if alignment is None:
        return Scored(cells, None, None)
    scores = scorecard(*surfaces, cells, grid, tolerance_mm)
    samples = Samples(sides[0].grid, sides[0].z_mm), Samples(sides[1].grid, sides[1].z_mm)
    budget = agreement_budget(surfaces, labels, cells, grid, samples, alignment)
    return Scored(cells, {"grid": scores.pop("overlap"), **scores}, budget)
