"""What two placed sides, one that measures depth and one that sees light, show of every sample of the wall."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.ranks import robust_sigma
from endoct.base.numeric.regions import label, looked_up, within
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.light_alone import FARTHEST_MM
from endoct.fusion.geometry.placement import Placement, Sampling
from endoct.fusion.sides import Placed
from endoct.stitching.grid import SurfaceGrid

AROUND_MM = 0.1
"""What one side shows of a cell counts so far beyond the cell's outline, too."""
SURE = np.float32(0.98)
"""The probability of a cell where somebody drew one."""
LEAST_LOGIT = 0.01
"""A probability this near to 0 or 1 is as sure as any."""
SHALLOWEST_MM, DEEPEST_MM = -0.05, 0.3
"""Relief beyond these says no more about whether a sample is a cell."""
FAINTEST, BRIGHTEST = -8, 4
"""Brightness beyond these says no more about whether there was a surface in range."""


@dataclass(frozen=True, eq=False)
class MeasuredRows:
    """What the side that measures depth shows on its own rows, on the common columns, float32 arrays (n, n_theta).

    Attributes
    ----------
    z_mm: float64 (n,), in the frame of the common grid, ascending.
    relief_mm: how far the surface lies behind the wall, NaN where it is not known.
    cells: which share of a sample is a cell.
    brightness: of what the beam met, in robust standard deviations above the wall; where it met nothing, far below.
    """

    z_mm: NDArray[np.float64]
    relief_mm: Image
    cells: Image
    brightness: Image

    def neighbours(self, z_mm: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the rows that lie next to each of ``z_mm`` (n,) on either side of it, the nearer one first."""
        after = np.clip(np.searchsorted(self.z_mm, z_mm), 1, self.z_mm.size - 1)
        is_nearer = 2 * z_mm >= self.z_mm[after] + self.z_mm[after - 1]
        return np.where(is_nearer, after, after - 1), np.where(is_nearer, after - 1, after)


@dataclass(frozen=True, eq=False)
class BothSides:
    """What both sides show on ``grid``, arrays (n_z, n_theta).

    Attributes
    ----------
    depth_side, light_side: the places of both among the sides of the comparison, 0 or 1.
    cells, observed: of either side by its place, the cells it shows there and where it observed the wall.
    probability: float32, of a cell by the learned eye of the light's side; NaN where that was not asked.
    relief_mm: float32, how far the surface lies behind the wall by measured depth, interpolated between its rows.
    parallax_mm, parallax_error_mm: relief by parallax with its standard error.
    light_mm, light_error_mm: the relief that the side with light has of its own, by all that light shows, likewise.
    darkness: float32, by which the side with light told its cells; NaN where it did not.
    rows: what was measured on the rows themselves.

    Reliefs are NaN where they are not known.
    """

    grid: SurfaceGrid
    depth_side: int
    light_side: int
    cells: tuple[Mask, Mask]
    observed: tuple[Mask, Mask]
    probability: Image
    relief_mm: Image
    parallax_mm: Image
    parallax_error_mm: Image
    light_mm: Image
    light_error_mm: Image
    darkness: Image
    rows: MeasuredRows

    @property
    def from_row_mm(self) -> NDArray[np.float64]:
        """The distance of each row to the nearest one on which depth was measured, float64 (n_z,)."""
        return np.abs(self.rows.z_mm[self.rows.neighbours(self.grid.z_mm)[0]] - self.grid.z_mm)


def both_sides_of(placed: Placed) -> BothSides | None:
    """Return what two aligned sides show, of which one measures depth and one does not; None of any others.

    Nor of bores far wider than those in bone, which the networks do not know. A mask drawn by hand takes the place of a
    side that sees light, and its cells are as sure as any.
    """
    measures = [side.relief is not None for side in placed.both]
    if placed.outcome.alignment is None or sum(measures) != 1 or any(side.scale != 1 for side in placed.both):
        return None
    d = measures.index(True)
    depth, light = placed.both[d], placed.both[1 - d]
    by_depth, by_light = placed.sides[d], placed.sides[1 - d]
    onto_grid = placed.samplings[1 - d].onto(placed.grid)
    grid, nowhere = placed.grid, np.full(placed.grid.shape, np.nan, np.float32)
    assert depth.relief is not None  # noqa: S101  it is the side that measures
    assert by_depth.relief_mm is not None  # noqa: S101
    probability, parallax = placed.cells[1 - d].probability, light.parallax
    if light.drawing is not None:
        probability = np.where(placed.cells[1 - d].mask, SURE, 1 - SURE)
    return BothSides(
        grid=grid,
        depth_side=d,
        light_side=1 - d,
        cells=(placed.sides[0].mask, placed.sides[1].mask),
        observed=(placed.sides[0].valid, placed.sides[1].valid),
        probability=nowhere if probability is None else onto_grid.known(probability, light.panorama.valid),
        relief_mm=by_depth.relief_mm,
        parallax_mm=nowhere if parallax is None else onto_grid.known(parallax.relief_mm, parallax.known),
        parallax_error_mm=nowhere if parallax is None else onto_grid.known(parallax.error_mm, parallax.known),
        light_mm=nowhere if by_light.relief_mm is None else by_light.relief_mm,
        light_error_mm=nowhere if by_light.relief_error_mm is None else by_light.relief_error_mm,
        darkness=nowhere if by_light.contrast is None else by_light.contrast,
        rows=_measured_rows(depth.relief, depth.panorama.intensity, placed.cells[d].mask, placed.samplings[d], grid),
    )


def _measured_rows(own: Evidence, intensity: Image, cells: Mask, lie: Sampling, grid: SurfaceGrid) -> MeasuredRows:
    """Return what the ``own`` relief of a side shows on its rows, which ``lie`` in the frame of ``grid``."""
    z_mm = np.sort(lie.where.z_to_a(lie.grid.z_mm))
    columns = replace(grid, n_z=z_mm.size, dz_mm=lie.spacing_mm).with_rows(z_mm)
    across = Placement(lie.grid, lie.where, columns, 0.0)
    of_wall = intensity[own.valid & ~cells]
    middle, spread = (np.median(of_wall), robust_sigma(of_wall)) if of_wall.size else (0.0, 0.0)
    brightness = np.clip((intensity - middle) / (spread or 1.0), FAINTEST, BRIGHTEST).astype(np.float32)
    return MeasuredRows(
        z_mm=z_mm,
        relief_mm=across.known(own.values, own.valid),
        cells=np.nan_to_num(across.known(cells.astype(np.float32), own.valid)),
        brightness=np.nan_to_num(across.known(brightness, own.valid)),
    )


def cell_features(sides: BothSides) -> tuple[Mask, NDArray[np.float32]]:
    """Return where both sides observed the wall in or near a cell of either, and what tells a cell there.

    The second is float32 (8, n): signed distances to the outlines of both sides, light first; the eye's log odds;
    measured relief; which share of the other side's nearest cell, depth first, each side covers; and the same of all
    cells in the bore. In bores where it misses a share of them, a side is trusted less in each.
    """
    sample_mm = sides.grid.dz_mm, sides.grid.dtheta_mm
    light, depth = sides.cells[sides.light_side], sides.cells[sides.depth_side]
    from_light, from_depth = (signed_distance(cells, sample_mm, FARTHEST_MM) for cells in (light, depth))
    near = sides.observed[0] & sides.observed[1] & ((from_light > -FARTHEST_MM) | (from_depth > -FARTHEST_MM))
    features = np.empty((8, np.count_nonzero(near)), np.float32)
    features[0], features[1] = from_light[near], from_depth[near]
    probable = np.nan_to_num(sides.probability[near], nan=0.5)
    features[2] = np.log((probable + LEAST_LOGIT) / (1 + LEAST_LOGIT - probable))
    features[3] = np.nan_to_num(np.clip(sides.relief_mm[near], SHALLOWEST_MM, DEEPEST_MM))
    features[4] = _covered(depth & sides.observed[sides.light_side], light, sample_mm)[near]
    features[5] = _covered(light & sides.observed[sides.depth_side], depth, sample_mm)[near]
    light_px, depth_px, both_px = (
        np.count_nonzero(cells & sides.observed[0] & sides.observed[1]) for cells in (light, depth, light & depth)
    )
    features[6], features[7] = (both_px / of_px if of_px else 1.0 for of_px in (depth_px, light_px))
    return near, features


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
