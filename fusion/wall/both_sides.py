"""What two placed sides, one that measures depth and one that sees light, show of every sample of the wall."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.regions import label, looked_up, within
from endoct.fusion.sides import Placed
from endoct.stitching.grid import SurfaceGrid

FARTHEST_MM = 0.3
"""An outline farther off says no more than that it is far."""
AROUND_MM = 0.1
"""What one side shows of a cell counts so far beyond the cell's outline, too."""
LEAST_LOGIT = 0.01
"""A probability this near to 0 or 1 is as sure as any."""
SHALLOWEST_MM, DEEPEST_MM = -0.05, 0.3
"""Relief beyond these says no more about whether a sample is a cell."""
LEAST_OF_ROWS = 0.02
"""With so much of a sample's neighbouring rows in a cell, its depth follows these rows alone."""


@dataclass(frozen=True, eq=False)
class BothSides:
    """What both sides show on ``grid``, arrays (n_z, n_theta).

    Attributes
    ----------
    depth_side, light_side: the places of both among the sides of the comparison, 0 or 1.
    cells, observed: of either side by its place, the cells it shows there and where it observed the wall.
    probability: float32, of a cell by the learned eye of the light's side; NaN where that was not asked.
    relief_mm: float32, how far the surface lies behind the wall by measured depth, interpolated between its rows.
    relief_in_cells_mm: the same from those neighbouring samples alone that the side itself takes for cells.
    parallax_mm, parallax_error_mm: relief by parallax with its standard error.
    from_row_mm: float64 (n_z,), the distance of each row to the nearest one on which depth was measured.

    Reliefs are NaN where they are not known.
    """

    grid: SurfaceGrid
    depth_side: int
    light_side: int
    cells: tuple[Mask, Mask]
    observed: tuple[Mask, Mask]
    probability: Image
    relief_mm: Image
    relief_in_cells_mm: Image
    parallax_mm: Image
    parallax_error_mm: Image
    from_row_mm: NDArray[np.float64]


def both_sides_of(placed: Placed) -> BothSides | None:
    """Return what two aligned sides show, of which one measures depth and one does not; None of any others.

    Nor of masks drawn by hand, and of bores far wider than those in bone, which the networks do not know.
    """
    measures = [side.relief is not None for side in placed.both]
    is_other = any(side.drawing is not None or side.scale != 1 for side in placed.both)
    if placed.outcome.alignment is None or sum(measures) != 1 or is_other:
        return None
    d = measures.index(True)
    depth, light = placed.both[d], placed.both[1 - d]
    grid, of_depth, of_light = placed.grid, placed.samplings[d], placed.samplings[1 - d]
    down, beside = of_depth.onto(grid), of_light.onto(grid)
    assert depth.relief is not None  # noqa: S101  it is the side that measures
    own, cells = depth.relief, placed.cells[d].mask
    probability, parallax = placed.cells[1 - d].probability, light.parallax
    nowhere = np.full(grid.shape, np.nan, np.float32)
    rows_mm = of_depth.where.z_to_a(of_depth.grid.z_mm)
    return BothSides(
        grid=grid,
        depth_side=d,
        light_side=1 - d,
        cells=(placed.sides[0].mask, placed.sides[1].mask),
        observed=(placed.sides[0].valid, placed.sides[1].valid),
        probability=nowhere if probability is None else beside.known(probability, light.panorama.valid),
        relief_mm=down.known(own.values, own.valid),
        relief_in_cells_mm=down.known(own.values, own.valid & cells, at_least=LEAST_OF_ROWS),
        parallax_mm=nowhere if parallax is None else beside.known(parallax.relief_mm, parallax.known),
        parallax_error_mm=nowhere if parallax is None else beside.known(parallax.error_mm, parallax.known),
        from_row_mm=np.abs(grid.z_mm[:, np.newaxis] - rows_mm).min(axis=1),
    )


def cell_features(sides: BothSides) -> NDArray[np.float32]:
    """Return what tells a cell, float32 (6, n_z, n_theta).

    Signed distances to the outlines of both sides, light first; the eye's log odds; measured relief; which share of the
    other side's nearest cell, depth first, each side covers.
    """
    sample_mm = sides.grid.dz_mm, sides.grid.dtheta_mm
    light, depth = sides.cells[sides.light_side], sides.cells[sides.depth_side]
    probable = np.nan_to_num(sides.probability, nan=0.5)
    return np.stack(
        [
            signed_distance(light, sample_mm, FARTHEST_MM),
            signed_distance(depth, sample_mm, FARTHEST_MM),
            np.log((probable + LEAST_LOGIT) / (1 + LEAST_LOGIT - probable)),
            np.nan_to_num(np.clip(sides.relief_mm, SHALLOWEST_MM, DEEPEST_MM)),
            _covered(depth & sides.observed[sides.light_side], light, sample_mm),
            _covered(light & sides.observed[sides.depth_side], depth, sample_mm),
        ]
    ).astype(np.float32, copy=False)


def _covered(cells: Mask, other: Mask, sample_mm: tuple[float, float]) -> Image:
    """Return at samples in or beside a cell which share of it ``other`` covers, float32, 1 far from all cells."""
    beside = within(cells, AROUND_MM / sample_mm[0], AROUND_MM / sample_mm[1])
    labels, n = label(beside)
    inside = labels[cells]
    of_all = np.bincount(inside, minlength=n + 1)
    of_other = np.bincount(inside, weights=other[cells], minlength=n + 1)
    share = (of_other / np.maximum(of_all, 1)).astype(np.float32)
    share[0] = 1
    return looked_up(share, labels)
