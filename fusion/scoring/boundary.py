"""How far two outlines lie from each other on the cylinder, in mm. θ is a circle, and samples need not be square.

The outline of a mask runs between samples, by marching squares. ``surface-distance`` does the same on a plane (Nikolov
et al. 2018, arXiv:1809.04430). Where either side did not observe the wall there is no outline: the end of what was
observed is no edge of a cell.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from endoct.base.arrays import Coordinates, Mask
from endoct.fusion.result import BoundaryScores
from endoct.fusion.scoring.intervals import Interval, ratio_interval
from endoct.fusion.scoring.overlap import Sites, Surface
from endoct.stitching.grid import SurfaceGrid

PERCENTILE = 0.95


@dataclass(frozen=True, eq=False)
class Outline:
    """Pieces of an outline: where each lies, float64 (n, 2) as (z, arc) in mm, how long it is, and its label, int."""

    place_mm: Coordinates
    length_mm: Coordinates
    label: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BoundaryDistances:
    """Distances from every piece of either outline to the nearest of the other: (n_a,) and (n_b,), mm."""

    a: Outline
    b: Outline
    a_to_b_mm: Coordinates
    b_to_a_mm: Coordinates

    @property
    def mean_mm(self) -> float:
        """Mean over the length of both outlines."""
        total = self.a.length_mm @ self.a_to_b_mm + self.b.length_mm @ self.b_to_a_mm
        return float(total / (self.a.length_mm.sum() + self.b.length_mm.sum()))

    @property
    def p95_mm(self) -> float:
        """The 95th percentile over length, the larger of both ways."""
        return max(_percentile(self.a_to_b_mm, self.a.length_mm), _percentile(self.b_to_a_mm, self.b.length_mm))

    def within(self, tolerance_mm: float) -> float:
        """Return the share of both outlines' length that lies within ``tolerance_mm`` of the other."""
        of_a, of_b = near(self.a_to_b_mm, tolerance_mm), near(self.b_to_a_mm, tolerance_mm)
        # both by sum(): a product's rounding, which differs between processors, would make 1 a little less
        within = (of_a * self.a.length_mm).sum() + (of_b * self.b.length_mm).sum()
        return float(within / (self.a.length_mm.sum() + self.b.length_mm.sum()))


def outline(
    mask: Mask, valid: Mask, dz_mm: float, column_mm: float, labels: NDArray[np.int32] | None = None
) -> Outline:
    """Return the outline of ``mask`` within ``valid``, bool (n_z, n_theta) both.

    A piece lies between four samples, one of ``labels`` (n_z, n_theta) of which, the largest, becomes its label.
    """
    observed = _corners(valid.astype(np.uint8))
    code = _corners((mask & valid).astype(np.uint8))
    row, column = np.nonzero((code > 0) & (code < 15) & (observed == 15))
    length_mm = _lengths(dz_mm, column_mm)[code[row, column]]
    place_mm = np.stack([(row + 0.5) * dz_mm, (column + 0.5) * column_mm], axis=1)
    if labels is None:
        return Outline(place_mm, length_mm, np.zeros(row.size, np.int64))
    right = (column + 1) % mask.shape[1]
    four = [labels[row, column], labels[row, right], labels[row + 1, column], labels[row + 1, right]]
    return Outline(place_mm, length_mm, np.max(four, axis=0).astype(np.int64))


def boundary_distances(a: Outline, b: Outline, around_mm: float) -> BoundaryDistances | None:
    """Return how far the two lie from each other on a wall ``around_mm`` round, None where one has no outline."""
    if not (a.length_mm.size and b.length_mm.size):
        return None
    return BoundaryDistances(a, b, _nearest(a, b, around_mm), _nearest(b, a, around_mm))


def boundary_scores(
    a: Surface, b: Surface, sites: Sites, grid: SurfaceGrid, tolerance_mm: float
) -> BoundaryScores | None:
    """Return how far the outlines of two surfaces on ``grid`` lie from each other; None where one has none."""
    both = a.valid & b.valid
    of_a, of_b = (outline(side.mask, both, grid.dz_mm, grid.dtheta_mm, sites.labels) for side in (a, b))
    apart = boundary_distances(of_a, of_b, grid.n_theta * grid.dtheta_mm)
    if apart is None:
        return None
    near_a, near_b = near(apart.a_to_b_mm, tolerance_mm), near(apart.b_to_a_mm, tolerance_mm)
    return BoundaryScores(
        mean_mm=apart.mean_mm,
        mean_interval_mm=_over_sites(apart, apart.a_to_b_mm, apart.b_to_a_mm, sites),
        p95_mm=apart.p95_mm,
        within_share=apart.within(tolerance_mm),
        within_interval=_over_sites(apart, near_a, near_b, sites),
        tolerance_mm=tolerance_mm,
    )


def near(distance_mm: Coordinates, tolerance_mm: float) -> Coordinates:
    """Return 1.0 where a distance is within the tolerance, else 0.0.

    Distances on a grid often equal it but for rounding, which is allowed for.
    """
    return (distance_mm <= tolerance_mm * (1 + 1e-9)).astype(np.float64)


def _over_sites(apart: BoundaryDistances, of_a: Coordinates, of_b: Coordinates, sites: Sites) -> Interval:
    """Return the interval of a mean over both outlines' length, resampled over sites."""
    n = sites.both.size + 1
    total, length = np.zeros(n), np.zeros(n)
    for side, values in ((apart.a, of_a), (apart.b, of_b)):
        total += np.bincount(side.label, side.length_mm * values, n)
        length += np.bincount(side.label, side.length_mm, n)
    return ratio_interval(total[1:], length[1:])


def _nearest(of: Outline, to: Outline, around_mm: float) -> Coordinates:
    circle = [0, around_mm]  # 0: z does not close
    return np.asarray(cKDTree(_on_circle(to, around_mm), boxsize=circle).query(_on_circle(of, around_mm))[0])


def _on_circle(outline_: Outline, around_mm: float) -> Coordinates:
    """Return the places with arcs in [0, around_mm), as the tree wants them."""
    return np.where([False, True], np.mod(outline_.place_mm, around_mm * (1 - 1e-12)), outline_.place_mm)


def _corners(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return which of four neighbouring samples are set, (n_z − 1, n_theta): bits 1, 2 above, 4, 8 below."""
    right = np.roll(samples, -1, axis=1)
    return np.asarray(samples[:-1] | right[:-1] << 1 | samples[1:] << 2 | right[1:] << 3, dtype=np.uint8)


def _lengths(dz_mm: float, column_mm: float) -> Coordinates:
    """Return the length of outline between four samples for each of the 16 ways in which they may be set."""
    corner = float(np.hypot(dz_mm, column_mm)) / 2
    lengths = np.full(16, corner)  # one set, or all but one
    lengths[[0, 15]] = 0.0
    lengths[[0b0011, 0b1100]] = column_mm
    lengths[[0b0101, 0b1010]] = dz_mm
    lengths[[0b0110, 0b1001]] = 2 * corner
    return lengths


def _percentile(distance_mm: Coordinates, length_mm: Coordinates) -> float:
    order = np.argsort(distance_mm)
    share = np.cumsum(length_mm[order]) / length_mm.sum()
    return float(distance_mm[order][min(int(np.searchsorted(share, PERCENTILE)), order.size - 1)])
