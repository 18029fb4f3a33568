"""Cells as objects: what each measures, and which cell of the other side it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.fusion.scoring.surface import Surface
from endoct.fusion.segmentation.regions import Labels, quantiles
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.grid import SurfaceGrid

SAME_CELL = 0.5
"""Intersection over union from which two cells are one; above one half no cell can have two partners."""
OBSERVED = 0.5
"""Share of a cell that the other side must have observed for it to count in scores of cells."""


@dataclass(frozen=True)
class Cell:
    """One cell of one side, in side A's frame.

    Attributes
    ----------
    side: name of the side that shows it; ``id`` from 1 in the order of z on that side.
    area_mm2: on the nominal bore. ``z_mm``, ``theta_rad`` in [0, 2π): its centroid, the mean on the circle.
    depth_median_mm, depth_p95_mm: of the relief behind the wall; ``volume_mm3`` between the nominal bore and that
        relief, the fan of a cylinder; ``depth_of`` the side that measured them: its own, else the other, over what
        that one observed. None where no side has depth there.
    contrast: median of ± log of intensity relative to the wall's, where the side's cells are segmented by intensity.
    touches_edge: whether it reaches the end of what its side observed, and so may be larger than it looks.
    observed_by_other: share of its area that the other side observed; ``covered`` share of that in which the other
        side shows cells too, None where it observed nothing.
    seen_by: "both" where any part is cell for the other side too, else ``side``; where the two sides are not aligned
        nobody knows: ``side``.
    partner: id of the other side's cell with the largest ``overlap``, intersection over union where both observed;
        None and 0 where none overlaps.
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

    @property
    def is_matched(self) -> bool:
        """Whether the other side shows the same cell: intersection over union of one half and more."""
        return self.overlap >= SAME_CELL

    @property
    def counts(self) -> bool:
        """Whether the other side observed enough of it to be asked for it."""
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
        """Return for every label of A (the partner in B with the largest overlap, 0 for none; that overlap)."""
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
    """Return every cell of both sides, A's first. Where not ``aligned``, cells have no partners and no depth but
    their own side's.
    """
    both = a.valid & b.valid if aligned else np.zeros(grid.shape, np.bool_)
    matched = match(a.labels, b.labels, both)
    return (
        *_of_side(a, b, matched, grid, aligned=aligned),
        *_of_side(b, a, matched.turned(), grid, aligned=aligned),
    )


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
    depths = [_Depth.measured(s, row, column, label, n, grid) for s in ((own, other) if aligned else (own,))]
    sample_mm2 = grid.dz_mm * grid.dtheta_mm
    cells = []
    for k in range(1, n + 1):
        depth = next((d for d in depths if d is not None and d.median_mm[k] is not None), None)
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
            )
        )
    return cells


@dataclass(frozen=True, eq=False)
class _Depth:
    """Depth and volume per label, (n + 1,), as one side measured them; None where it did not."""

    of: str
    median_mm: list[float | None]
    p95_mm: list[float | None]
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
        return cls(
            side.name,
            _known_quantiles(relief, label, n, 0.5),
            _known_quantiles(relief, label, n, 0.95),
            np.asarray(np.bincount(label, fan, n + 1), dtype=np.float64),
        )


def _known_quantiles(values: Image, found: Labels, n: int, share: float) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in quantiles(values, found, n, share)]


def _at_edge(valid: Mask) -> Mask:
    """Return the samples with a neighbour that was not observed, or none because z ends."""
    rows = np.pad(valid, ((1, 1), (0, 0)))
    inside = rows[:-2] & rows[2:] & np.roll(valid, 1, axis=1) & np.roll(valid, -1, axis=1)
    return ~inside
