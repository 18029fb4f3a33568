"""How far the reliefs of two sides differ, sample by sample and by depth, after Bland and Altman."""

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.geometry.placement import signed_distance
from endoct.fusion.result import Reliefs, ReliefStratum
from endoct.fusion.scoring.surface import Surface
from endoct.stitching.grid import SurfaceGrid

DEPTHS_MM = (0.05, 0.1, 0.3, 0.7)
RIM_MM = 0.1
"""So near an outline of either side's cells nothing is compared: one side sees the floor there, the other the wall."""
FEWEST = 200
"""Of fewer samples no limits are told."""


def compare_reliefs(a: Surface, b: Surface, grid: SurfaceGrid) -> Reliefs | None:
    """Return how far the relief of ``b`` lies behind that of ``a`` on ``grid``; None where a side has none.

    Parted by the mean of both (Bland and Altman 1999, doi:10.1177/096228029900800204). The limits are percentiles,
    since the differences are not normal. Samples are not independent, so that nothing is said of significance.
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
    return np.abs(signed_distance(cells, (grid.dz_mm, grid.dtheta_mm))) > RIM_MM


def _limits(differs: Coordinates, error: Coordinates | None) -> dict[str, float | None]:
    if differs.size < FEWEST:
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
