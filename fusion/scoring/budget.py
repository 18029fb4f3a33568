"""Where the disagreement of two sides comes from: 1 − J parted into alignment, sampling, visibility, segmentation.

Ideal masks are sent through what is known to lie between them, one cause after the other, and lose overlap:

1. The ideal is the wall as both would see it if nothing went wrong. It has the cells of the side with the finer rows,
   and the cells of the other of which that side shows nothing. J₀ = 1.
2. **Alignment**: B really lies where a draw from the alignment's covariance says. It is placed where the alignment
   says. That gives J₁; the part is 1 − J₁.
3. **Sampling**: each side samples the wall only at its own rows and columns; the phase of the rows is drawn as well.
   From there it is brought to the common grid as real masks are. That gives J₂; the part is J₁ − J₂.
4. **Visibility**: each side loses the cells of the other of which it has no sign. Its mask hardly covers them, and
   its evidence over them is no stronger than over 95 % of its bare wall, on patches of that size. That gives J₃; the
   part is J₂ − J₃. A hand-drawn mask has no evidence: nothing is called invisible to it.
5. **Segmentation**: the rest, J₃ − J, is all that no cause above predicts. Cells were missed or drawn differently
   though there was a sign of them, or departures from a rigid alignment. It is negative where more loss is predicted
   than there is.

Every J is over the samples that both sides observed, and is the mean over draws. So the parts sum to 1 − J exactly.
What one side did not cover at all is in no J; it is given separately, as an area. Intervals are bootstrapped over
patches of wall and draws together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import largest_divisor
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.regions import Labels
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import FARTHEST_OUTLINE_MM, IN_PLACE, Placement, Sampling
from endoct.fusion.result import Budget, BudgetPart, BudgetParts, NotVisible
from endoct.fusion.scoring.cells import Cell, invisible_cells
from endoct.fusion.scoring.intervals import RESAMPLES, SEED, percentiles, weights
from endoct.fusion.scoring.overlap import Surface, agreement, index_of
from endoct.stitching.grid import SurfaceGrid

PARTS = tuple(BudgetParts.model_fields)
"""The causes, in the order in which they are taken off."""
DRAWS = 12
FINEST_DZ_MM = 0.04
MOST_COLUMNS = 512
"""Samples may be this wide, since outlines are moved by fractions of a sample, as distances."""
PATCH_MM = 1.0
COVERED_SHARE = 0.1
"""A side does not show a cell of the other where its mask covers less than this share of it."""

T = TypeVar("T", bound=np.generic)

Count = tuple[Coordinates, Coordinates]
"""Samples in both masks, and in either, by patch of wall."""


def agreement_budget(
    surfaces: tuple[Surface, Surface], samplings: tuple[Sampling, Sampling], cells: Sequence[Cell], grid: SurfaceGrid
) -> Budget | None:
    """Return the budget that the module describes; None where neither side shows a cell.

    ``surfaces`` and ``cells`` are what both sides show on ``grid``; ``samplings`` say how they came there.
    """
    placing = samplings[1].where
    coarse = _thin(grid)
    a, b = (_thinned(side, coarse) for side in surfaces)
    both = a.valid & b.valid
    if not ((a.mask | b.mask) & both).any():
        return None
    thin_labels = [side.labels[coarse.rows, coarse.columns] for side in surfaces]
    alone = [_listed(cells, side.name) for side in surfaces]
    fine = 0 if samplings[0].spacing_mm <= samplings[1].spacing_mm else 1
    wall = (a.mask, b.mask)[fine] | np.isin(thin_labels[1 - fine], alone[1 - fine])
    invisible = [
        invisible_cells(side, of, ids, coarse.grid)
        for side, of, ids in ((a, thin_labels[1], alone[1]), (b, thin_labels[0], alone[0]))
    ]
    ideal = _Ideal(_outline_mm(wall, coarse.grid), coarse.grid)
    hidden = [_zone(wall, np.isin(of, ids), coarse.grid) for of, ids in zip(thin_labels[::-1], invisible, strict=True)]
    patches = _patches(coarse.grid)
    stages: list[list[Count]] = [[], [], []]
    for drawn, phase_mm in _draws(placing, max(each.grid.dz_mm for each in samplings)):
        truly = IN_PLACE, drawn
        placed = [ideal.placed(*each, phase_mm) for each in zip(samplings, truly, strict=True)]
        stages[0].append(_count(placed, both, patches))
        sampled = [ideal.sampled(*each, phase_mm) for each in zip(samplings, truly, strict=True)]
        stages[1].append(_count(sampled, both, patches))
        visible = [mask & ~zone for mask, zone in zip(sampled, hidden, strict=True)]
        stages[2].append(_count(visible, both, patches))
    observed = _count((a.mask, b.mask), both, patches)
    both_valid = surfaces[0].valid & surfaces[1].valid
    counted = agreement(surfaces[0].mask, surfaces[1].mask, both_valid, grid.dz_mm * grid.dtheta_mm)
    return _budget(surfaces, cells, stages, observed, counted.jaccard or 0.0, placing, invisible)


@dataclass(frozen=True, eq=False)
class _Thin:
    """A coarser grid, and which rows and columns of the finer one it has."""

    grid: SurfaceGrid
    rows: slice
    columns: slice


class _Ideal:
    """What each side would show of a wall with clean edges, on a common grid."""

    def __init__(self, distance_mm: Image, grid: SurfaceGrid) -> None:
        self._distance_mm, self._grid = distance_mm, grid
        self._everywhere = np.ones(grid.shape, np.bool_)

    def placed(self, side: Sampling, truly: Alignment, phase_mm: float) -> Mask:
        """Return the wall, shifted by ``phase_mm``, as ``side`` places it; ``truly`` is where that side lies."""
        distance = self._distance(_between(side.where, truly), self._grid, phase_mm)
        return distance > 0

    def sampled(self, side: Sampling, truly: Alignment, phase_mm: float) -> Mask:
        """Return the same as seen only on the samples of ``side``."""
        grid, own = self._grid, side.grid
        if side.spacing_mm < 1.5 * grid.dz_mm and own.n_theta >= grid.n_theta:
            return self.placed(side, truly, phase_mm)
        distance = self._distance(truly.inverse(), own, phase_mm)
        return side.onto(grid).mask(distance > 0, np.ones(distance.shape, np.bool_))[0]

    def _distance(self, where: Alignment, grid: SurfaceGrid, phase_mm: float) -> Image:
        wall = self._grid.with_rows(self._grid.z_mm + phase_mm)
        return Placement(wall, where, grid, 0.0).image(self._distance_mm, self._everywhere)[0]


def _between(measured: Alignment, truly: Alignment) -> Alignment:
    """Return the alignment that takes a true place in A's frame to where ``measured`` puts it."""
    scale = measured.z_scale / truly.z_scale
    sense = measured.theta_shift_rad - truly.theta_shift_rad
    return Alignment(float(np.mod(sense, 2 * np.pi)), measured.z_shift_mm - scale * truly.z_shift_mm, scale)


def _draws(placing: Alignment, pitch_mm: float) -> list[tuple[Alignment, float]]:
    """Return where B may truly lie, each with a phase of the rows: a Latin hypercube, always the same."""
    rng = np.random.default_rng(SEED)
    strata = (np.stack([rng.permutation(DRAWS) for _ in range(4)], axis=1) + 0.5) / DRAWS
    covariance = np.zeros((3, 3)) if placing.covariance is None else np.array(placing.covariance)
    size, axes = np.linalg.eigh(covariance)
    errors = ndtri(strata[:, :3]) * np.sqrt(np.maximum(size, 0)) @ axes.T
    return [
        (
            replace(
                placing,
                theta_shift_rad=placing.theta_shift_rad + float(turn),
                z_shift_mm=placing.z_shift_mm + float(shift),
                z_scale=placing.z_scale + float(scale),
            ),
            float(phase - 0.5) * pitch_mm,
        )
        for (turn, shift, scale), phase in zip(errors, strata[:, 3], strict=True)
    ]


def _listed(cells: Sequence[Cell], side: str) -> list[int]:
    """Return the ids of the side's cells of which the other shows nothing, though it observed them."""
    return [c.id for c in cells if c.side == side and c.covered is not None and c.covered < COVERED_SHARE]


def _zone(wall: Mask, cells: Mask, grid: SurfaceGrid) -> Mask:
    """Return the surroundings of ``cells``, nearer to them than to the rest of the cells of ``wall``."""
    if not cells.any():
        return cells
    return np.asarray(_outline_mm(cells, grid) > _outline_mm(wall & ~cells, grid))


def _outline_mm(mask: Mask, grid: SurfaceGrid) -> Image:
    return signed_distance(mask, (grid.dz_mm, grid.dtheta_mm), FARTHEST_OUTLINE_MM)


def _thin(grid: SurfaceGrid) -> _Thin:
    down = max(1, int(FINEST_DZ_MM / grid.dz_mm + 1e-6))
    across = largest_divisor(grid.n_theta, grid.n_theta // MOST_COLUMNS)
    rows, columns = slice(None, None, down), slice(None, None, across)
    thin = SurfaceGrid.full_circle(
        len(range(grid.n_z)[rows]),
        grid.n_theta // across,
        z0_mm=grid.z0_mm,
        dz_mm=down * grid.dz_mm,
        theta0_rad=grid.theta0_rad,
        radius_mm=grid.radius_mm,
    )
    return _Thin(thin, rows, columns)


def _thinned(side: Surface, thin: _Thin) -> Surface:
    def less(image: NDArray[T]) -> NDArray[T]:
        return np.ascontiguousarray(image[thin.rows, thin.columns])

    relief_mm, contrast = (None if image is None else less(image) for image in (side.relief_mm, side.contrast))
    return Surface(side.name, less(side.mask), less(side.valid), relief_mm, contrast)


def _patches(grid: SurfaceGrid) -> Labels:
    """Return the number of the patch of wall that every sample lies in, from 0."""
    around = max(1, round(grid.n_theta * grid.dtheta_mm / PATCH_MM))
    row = (np.arange(grid.n_z) * grid.dz_mm / PATCH_MM).astype(np.int32)
    column = (np.arange(grid.n_theta) * around // grid.n_theta).astype(np.int32)
    return row[:, np.newaxis] * np.int32(around) + column


def _count(masks: Sequence[Mask], both: Mask, patches: Labels) -> Count:
    a, b = masks
    n = int(patches[-1, -1]) + 1
    shared, either = (np.bincount(patches[mask & both], minlength=n) for mask in (a & b, a | b))
    return shared.astype(np.float64), either.astype(np.float64)


def _budget(
    surfaces: tuple[Surface, Surface],
    cells: Sequence[Cell],
    stages: list[list[Count]],
    observed: Count,
    jaccard: float,
    placing: Alignment,
    invisible: list[list[int]],
) -> Budget:
    levels = [1.0, *(float(np.mean([_jaccard(*c) for c in stage])) for stage in stages), jaccard]
    shares = -np.diff(levels)
    intervals = _intervals(stages, observed, jaccard)
    names = [side.name for side in surfaces]
    missed = [[c for c in cells if c.side == names[1 - k] and c.id in set(invisible[k])] for k in (0, 1)]
    parts = {
        part: BudgetPart(share=float(share), interval=interval)
        for part, share, interval in zip(PARTS, shares, intervals, strict=True)
    }
    return Budget(
        one_minus_jaccard=1 - levels[-1],
        parts=BudgetParts(**parts),
        alignment_known=placing.covariance is not None,
        not_visible={
            name: NotVisible(cells=len(those), area_mm2=sum(c.area_mm2 for c in those))
            for name, those in zip(names, missed, strict=True)
        },
        not_covered={
            name: sum(c.area_mm2 * (1 - c.observed_by_other) for c in cells if c.side != name) for name in names
        },
        draws=DRAWS,
    )


def _intervals(stages: list[list[Count]], observed: Count, jaccard: float) -> list[tuple[float, float] | None]:
    """Return the interval of every part, over patches and draws together."""
    holding = observed[1] + stages[0][0][1] > 0
    if holding.sum() < 2:
        return [None] * len(PARTS)
    drawn = weights(int(holding.sum()))
    which = np.random.default_rng(SEED).integers(DRAWS, size=RESAMPLES)
    rows = np.arange(RESAMPLES)

    def resampled(counts: Sequence[Count]) -> Coordinates:
        shared, either = (np.stack([c[k][holding] for c in counts], axis=1) for k in (0, 1))
        pick = which % len(counts)
        below = (drawn @ either)[rows, pick]
        return np.divide((drawn @ shared)[rows, pick], below, out=np.zeros(RESAMPLES), where=below > 0)

    # the last is that of the grid itself, which the coarser samples here miss by a little
    last = resampled([observed]) + (jaccard - _jaccard(*observed))
    levels = [np.ones(RESAMPLES), *(resampled(stage) for stage in stages), last]
    return [percentiles(before - after) for before, after in pairwise(levels)]


def _jaccard(shared: Coordinates, either: Coordinates) -> float:
    return index_of(float(shared.sum()), float(either.sum())) or 0.0  # a draw without any cell agrees on none
