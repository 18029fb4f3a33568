"""Cells as objects: what each measures, which cell of the other side it is, and how far the two sides agree.

Matched cells give precision, recall and limits of agreement, and how they drift apart along the bore. A cell of
which the other side has no sign is held apart from one that was missed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import masked_gaussian, wrap_rad
from endoct.base.numeric.regions import Labels, quantiles
from endoct.fusion.evidence.evidence import CLIP
from endoct.fusion.result import CellScores, Drift, Limits, Line
from endoct.fusion.scoring.intervals import bland_altman, ratio_interval
from endoct.fusion.scoring.overlap import Surface
from endoct.stitching.grid import SurfaceGrid

SAME_CELL = 0.5
"""Intersection over union from which two cells are one; above one half no cell can have two partners."""
OBSERVED = 0.5
"""Share of a cell that the other side must have observed for it to count in scores of cells."""
DEPTH_KNOWN = 0.5
"""Share of a cell of which the depth by light must be known for it to count."""
FEWEST_TO_DRIFT = 6
"""No drift is estimated from fewer matched cells than this."""
QUANTILE = 0.95
"""Share of bare wall over which the evidence must rise to count as a sign of a cell."""
LEAST_WALL = 100
"""Nothing is said of cells where there are fewer samples of bare wall."""


@dataclass(frozen=True)
class Cell:
    """One cell of one side, in side A's frame.

    Attributes
    ----------
    side: name of the side that shows it.
    id: number from 1, in the order of z on that side.
    area_mm2: area on the nominal bore.
    z_mm, theta_rad: its centroid, θ in [0, 2π); the mean is taken on the circle.
    depth_median_mm, depth_p95_mm: of the relief behind the wall.
    volume_mm3: between the nominal bore and that relief, the fan of a cylinder.
    depth_of: the side that measured depth and volume: its own, else the other, over what that one observed. A side
        with depth by light comes last. It must know the depth on half of the cell; the rest is taken to be as deep.
        Depth and volume are None where no side has depth there.
    contrast: median of ± log of intensity relative to the wall's, where the side's cells are segmented by intensity.
    touches_edge: whether it reaches the end of what its side observed, and so may be larger than it looks.
    observed_by_other: share of its area that the other side observed.
    covered: share of the area observed by the other side in which that shows cells too; None where it observed nothing.
    seen_by: "both" where any part is cell for the other side too, else ``side``. It is ``side`` as well where the two
        sides are not aligned, since nobody knows.
    partner: id of the other side's cell with the largest ``overlap``; None where none overlaps.
    overlap: intersection over union where both sides observed; 0 where none overlaps.
    depth_error_mm: standard error of the median depth where that is by light; None where it was measured.
    own_depth_mm, own_depth_error_mm: the same by its own side alone.
    """

    side: str
    id: int
    area_mm2: float
    z_mm: float
    theta_rad: float
    depth_median_mm: float | None
    depth_p95_mm: float | None
    volume_mm3: float | None
    depth_of: str | None
    contrast: float | None
    touches_edge: bool
    observed_by_other: float
    covered: float | None
    seen_by: str
    partner: int | None
    overlap: float
    depth_error_mm: float | None = None
    own_depth_mm: float | None = None
    own_depth_error_mm: float | None = None

    @property
    def is_matched(self) -> bool:
        """Whether the other side shows the same cell: intersection over union of one half and more."""
        return self.overlap >= SAME_CELL

    @property
    def counts(self) -> bool:
        """Whether the other side observed enough of it to be expected to show it."""
        return self.observed_by_other >= OBSERVED

    @property
    def diameter_mm(self) -> float:
        """Diameter of the circle of its area."""
        return float(2 * np.sqrt(self.area_mm2 / np.pi))


@dataclass(frozen=True, eq=False)
class Matched:
    """How the labelled cells of two sides overlap where both observed.

    ``area_a`` (n_a + 1,) and ``area_b`` (n_b + 1,) in samples, 0 for label 0; ``common`` sparse (n_a + 1, n_b + 1).
    """

    area_a: Coordinates
    area_b: Coordinates
    common: sparse.csr_array

    def best(self) -> tuple[NDArray[np.int64], Coordinates]:
        """Return, for every label of A, (the partner in B with the largest overlap, 0 for none; that overlap)."""
        pairs = self.common.tocoo()
        overlap = pairs.data / (self.area_a[pairs.row] + self.area_b[pairs.col] - pairs.data)
        partner, best = np.zeros(self.area_a.size, np.int64), np.zeros(self.area_a.size)
        order = np.lexsort((-pairs.col, overlap))  # the largest last; of equal ones the first
        partner[pairs.row[order]], best[pairs.row[order]] = pairs.col[order], overlap[order]
        return partner, best

    def turned(self) -> "Matched":
        """Return the same with B first."""
        return Matched(self.area_b, self.area_a, self.common.T.tocsr())


def match(a: Labels, b: Labels, both: Mask) -> Matched:
    """Count how the cells labelled in ``a`` and ``b`` overlap within ``both``, bool (n_z, n_theta)."""
    n_a, n_b = int(a.max(initial=0)), int(b.max(initial=0))
    in_a, in_b = a[both], b[both]
    area_a, area_b = np.bincount(in_a, minlength=n_a + 1), np.bincount(in_b, minlength=n_b + 1)
    area_a[0] = area_b[0] = 0
    touch = (in_a > 0) & (in_b > 0)
    ones = np.ones(int(touch.sum()))
    common = sparse.coo_array((ones, (in_a[touch], in_b[touch])), shape=(n_a + 1, n_b + 1)).tocsr()
    return Matched(area_a.astype(np.float64), area_b.astype(np.float64), common)


def measure(a: Surface, b: Surface, grid: SurfaceGrid, *, aligned: bool) -> tuple[Cell, ...]:
    """Return every cell of both sides, A's first.

    Where the sides are not ``aligned``, cells have no partners, and no depth but their own side's.
    """
    both = a.valid & b.valid if aligned else np.zeros(grid.shape, np.bool_)
    matched = match(a.labels, b.labels, both)
    return (*_of_side(a, b, matched, grid, aligned=aligned), *_of_side(b, a, matched.turned(), grid, aligned=aligned))


def _of_side(own: Surface, other: Surface, matched: Matched, grid: SurfaceGrid, *, aligned: bool) -> list[Cell]:
    n = matched.area_a.size - 1
    row, column = np.nonzero(own.labels)
    label = own.labels[row, column]
    area_px = np.bincount(label, minlength=n + 1)
    turn = np.bincount(label, np.cos(grid.theta_rad)[column], n + 1) + 1j * np.bincount(
        label, np.sin(grid.theta_rad)[column], n + 1
    )
    z_mm = np.bincount(label, grid.z_mm[row], n + 1) / np.maximum(area_px, 1)
    at_edge = np.bincount(label, _at_edge(own.valid)[row, column], n + 1) > 0
    cover = np.asarray(matched.common.sum(axis=1)).ravel()
    partner, overlap = matched.best()
    contrast = [None] * (n + 1) if own.contrast is None else _known_quantiles(own.contrast[row, column], label, n, 0.5)
    exact_first = sorted((own, other) if aligned else (own,), key=lambda side: side.relief_error_mm is not None)
    depths = [_Depth.measured(side, row, column, label, n, grid) for side in exact_first]
    sample_mm2 = grid.dz_mm * grid.dtheta_mm
    cells = []
    for k in range(1, n + 1):
        depth = next((d for d in depths if d is not None and d.median_mm[k] is not None), None)
        of_own = next((d for d in depths if d is not None and d.of == own.name), None)
        observed = float(matched.area_a[k])
        cells.append(
            Cell(
                side=own.name,
                id=k,
                area_mm2=float(area_px[k]) * sample_mm2,
                z_mm=float(z_mm[k]),
                theta_rad=float(np.mod(np.angle(turn[k]), 2 * np.pi)),
                depth_median_mm=depth.median_mm[k] if depth else None,
                depth_p95_mm=depth.p95_mm[k] if depth else None,
                volume_mm3=float(depth.volume_mm3[k]) if depth else None,
                depth_of=depth.of if depth else None,
                contrast=contrast[k],
                touches_edge=bool(at_edge[k]),
                observed_by_other=observed / float(area_px[k]),
                covered=float(cover[k]) / observed if observed else None,
                seen_by="both" if cover[k] > 0 else own.name,
                partner=int(partner[k]) or None,
                overlap=float(overlap[k]),
                depth_error_mm=depth.error_mm[k] if depth else None,
                own_depth_mm=of_own.median_mm[k] if of_own else None,
                own_depth_error_mm=of_own.error_mm[k] if of_own else None,
            )
        )
    return cells


@dataclass(frozen=True, eq=False)
class _Depth:
    """Depth and volume per label, (n + 1,), as one side measured them; None where it did not."""

    of: str
    median_mm: list[float | None]
    p95_mm: list[float | None]
    error_mm: list[float | None]
    volume_mm3: Coordinates

    @classmethod
    def measured(
        cls, side: Surface, row: NDArray[np.intp], column: NDArray[np.intp], label: Labels, n: int, grid: SurfaceGrid
    ) -> "_Depth | None":
        if side.relief_mm is None:
            return None
        relief = side.relief_mm[row, column]
        known = np.isfinite(relief)
        behind = np.where(known, np.maximum(relief, 0), 0).astype(np.float64)
        fan = grid.dz_mm * grid.dtheta_rad * ((grid.radius_mm + behind) ** 2 - grid.radius_mm**2) / 2
        volume_mm3 = np.asarray(np.bincount(label, fan, n + 1), dtype=np.float64)
        error_mm: list[float | None] = [None] * (n + 1)
        if side.relief_error_mm is not None:
            share = np.bincount(label, known, n + 1) / np.maximum(np.bincount(label, minlength=n + 1), 1)
            relief, error = (
                np.where(share[label] >= DEPTH_KNOWN, of, np.float32(np.nan))
                for of in (relief, side.relief_error_mm[row, column])
            )
            error_mm = _known_quantiles(error, label, n, 0.5)  # all of a cell errs alike
            volume_mm3 /= np.maximum(share, DEPTH_KNOWN)
        median_mm, p95_mm = (_known_quantiles(relief, label, n, share) for share in (0.5, 0.95))
        return cls(side.name, median_mm, p95_mm, error_mm, volume_mm3)


def _known_quantiles(values: Image, labels: Labels, n: int, share: float) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in quantiles(values, labels, n, share)]


def _at_edge(valid: Mask) -> Mask:
    """Return the samples with a neighbour that was not observed, or with none because z ends there."""
    rows = np.pad(valid, ((1, 1), (0, 0)))
    inside = rows[:-2] & rows[2:] & np.roll(valid, 1, axis=1) & np.roll(valid, -1, axis=1)
    return ~inside


def cell_scores(reference: str, other: str, cells: Sequence[Cell]) -> CellScores | None:
    """Return precision and recall of ``other``'s cells against ``reference``'s, and their panoptic quality.

    Quality = Σ overlap of matched pairs / (pairs + half the rest) (Kirillov et al. 2019, Panoptic Segmentation). None
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
    """Return how the depths of matched whole cells agree where each side knows its own, mm; None as for areas."""
    depths = [
        (one.own_depth_mm, two.own_depth_mm)
        for one, two in whole_pairs(a, b, cells)
        if one.own_depth_mm is not None and two.own_depth_mm is not None
    ]
    return bland_altman(*np.array(depths, dtype=np.float64).reshape(-1, 2).T)


def drift(a: str, b: str, cells: Sequence[Cell], grid: SurfaceGrid) -> Drift | None:
    """Return how far matched whole cells lie apart, B's less A's, along z and around the bore, and how that grows.

    Lines are fitted by least squares; a rigid alignment should leave no slope. None where there are too few pairs, or
    all of them lie at one place along z.
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


def invisible_cells(side: Surface, labels: Labels, ids: Sequence[int], grid: SurfaceGrid) -> list[int]:
    """Return the cells among ``ids`` in ``labels`` of which ``side`` has no sign where it observed them.

    There is a sign where the mean evidence over a cell exceeds that of 95 % of bare wall, on patches of its size. Such
    a patch is a Gaussian of as many independent samples as a disc of the cell's area, in steps of an octave. The answer
    leaves out cells that ``side`` did not observe, that have no sample, or of which nothing can be said.
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
    """Return the evidence by which the side's cells were segmented, clipped to the range that says something."""
    if side.contrast is not None:
        return np.clip(side.contrast, *CLIP["darkness"])
    return None if side.relief_mm is None else np.clip(side.relief_mm, *CLIP["relief"])


def _limit(evidence: Image, wall: Mask, diameter_mm: float, grid: SurfaceGrid) -> float:
    """Return the limit that the mean over a disc of ``diameter_mm`` exceeds on one bare place in twenty."""
    sigma_mm = diameter_mm / 4
    mean = masked_gaussian(np.where(wall, evidence, 0), wall, sigma_mm / grid.dz_mm, sigma_mm / grid.dtheta_mm)
    return float(np.quantile(mean[wall], QUANTILE))
