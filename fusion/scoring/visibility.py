"""Which cells of one side the other has no sign of, rather than missed."""

from collections.abc import Sequence

import numpy as np

from endoct.fusion.evidence.evidence import CLIP
from endoct.fusion.scoring.surface import Surface
from endoct.fusion.segmentation.regions import Labels
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.circle import masked_gaussian
from endoct.stitching.grid import SurfaceGrid

QUANTILE = 0.95
"""Share of bare wall over which the evidence must rise to count as a sign of a cell."""
LEAST_WALL = 100
"""Of fewer samples of bare wall nothing is said."""


def invisible_cells(side: Surface, labels: Labels, ids: Sequence[int], grid: SurfaceGrid) -> list[int]:
    """Return those of the cells ``ids`` in ``labels`` of which ``side`` has no sign where it observed them.

    There is a sign where the mean evidence over a cell exceeds what 95 % of bare wall has, averaged over patches of
    the cell's size (a Gaussian of as many independent samples as a disc of its area, in steps of an octave). Cells
    that ``side`` did not observe, that have no sample, or of which nothing can be said, are not among the answer.
    """
    evidence = _evidence(side)
    if evidence is None or not ids:
        return []
    known = side.valid & np.isfinite(evidence)
    wall = known & ~side.mask & (labels == 0)
    if np.count_nonzero(wall) < LEAST_WALL:
        return []
    found = labels[known]
    n = max(int(labels.max()), *ids)  # specks may have no sample here
    count = np.bincount(found, minlength=n + 1)
    mean = np.bincount(found, evidence[known], n + 1) / np.maximum(count, 1)
    diameter_mm = 2 * np.sqrt(count * grid.dz_mm * grid.dtheta_mm / np.pi)
    counted = [k for k in ids if count[k] > 0]
    octave = {k: int(np.round(np.log2(diameter_mm[k]))) for k in counted}
    limit = {o: _limit(evidence, wall, 2.0**o, grid) for o in set(octave.values())}
    return [k for k in counted if mean[k] <= limit[octave[k]]]


def _evidence(side: Surface) -> Image | None:
    """Return the evidence by which the side's cells were segmented, within the range that says something."""
    if side.contrast is not None:
        return np.clip(side.contrast, *CLIP["darkness"])
    return None if side.relief_mm is None else np.clip(side.relief_mm, *CLIP["relief"])


def _limit(evidence: Image, wall: Mask, diameter_mm: float, grid: SurfaceGrid) -> float:
    """Return what the mean over a disc of ``diameter_mm`` exceeds on one bare place in twenty."""
    sigma_mm = diameter_mm / 4
    mean = masked_gaussian(np.where(wall, evidence, 0), wall, sigma_mm / grid.dz_mm, sigma_mm / grid.dtheta_mm)
    return float(np.quantile(mean[wall], QUANTILE))
