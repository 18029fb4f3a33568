"""What two sides show of one wall, and how far their masks agree where both observed it.

Sites are the connected places where either side shows a cell. An overlap is counted over them, resampled over them,
and sorted by them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.regions import Labels, label_in_order, quantiles
from endoct.fusion.result import Overlap, Strata, Stratum
from endoct.fusion.scoring.intervals import Interval, ratio, ratio_interval

SIZE_EDGES_MM = (0.3, 0.6)
"""Sizes are parted at these diameters of the circle of a site's area."""
DEPTH_EDGES_MM = (0.1, 0.3)
CONTRAST_EDGES = (0.4, 0.8)
DECIDING = 100
NEITHER, BOTH, ONLY_A, ONLY_B = range(4)
"""What a sample of two masks may be."""
BOTH_EMPTY: float | None = None
"""The Jaccard index and Dice of two empty masks: there is nothing to score.

Whether that is so is asked of :attr:`endoct.fusion.result.Overlap.is_empty`, never of the index.
"""


@dataclass(frozen=True, eq=False)
class Surface:
    """What one side knows of the wall on a common grid, all (n_z, n_theta).

    Attributes
    ----------
    mask, valid: bool, its cells and what it observed.
    relief_mm: float32 behind the wall, NaN where unknown; None where the side has no depth.
    contrast: float32, the evidence by which its cells were separated from the wall; None where that is no intensity.
    relief_error_mm: float32, the standard error of relief that was not measured, but told by light; else None.
    """

    name: str
    mask: Mask
    valid: Mask
    relief_mm: Image | None = None
    contrast: Image | None = None
    relief_error_mm: Image | None = None

    @cached_property
    def labels(self) -> Labels:
        """Its cells by number, int32 (n_z, n_theta), as :func:`endoct.base.numeric.regions.label_in_order`."""
        return label_in_order(self.mask)


@dataclass(frozen=True, eq=False)
class Sites:
    """Connected places where either of two masks shows a cell, over the seam of θ, where both sides observed.

    ``labels`` (n_z, n_theta) run from 1 to n; ``both``, ``only_a`` and ``only_b`` count samples of each site, float64
    (n,); ``sample_mm2`` is the area of a sample. Sites are resampled as a whole: samples of one cell are not
    independent, cells nearly are.
    """

    labels: Labels
    both: Coordinates
    only_a: Coordinates
    only_b: Coordinates
    sample_mm2: float

    @property
    def area_mm2(self) -> Coordinates:
        """Area of every site, (n,)."""
        return (self.both + self.only_a + self.only_b) * self.sample_mm2

    def jaccard_interval(self, which: Mask | slice = slice(None)) -> Interval:
        """Return the interval of the Jaccard index over the sites ``which``."""
        return ratio_interval(self.both[which], (self.both + self.only_a + self.only_b)[which])

    def jaccard_without_two(self) -> Interval:
        """Return the least and the largest Jaccard index without any one or two sites; None where there are no more.

        Only the :data:`DECIDING` largest sites are left out: none of the others moves the index by as much.
        """
        if self.both.size <= 2:
            return None
        either = self.both + self.only_a + self.only_b
        largest = np.argsort(either, kind="stable")[-DECIDING:]
        one, two = np.triu_indices(largest.size)  # a site with itself: it alone
        alone = one == two
        without = [
            total.sum() - total[largest][one] - np.where(alone, 0, total[largest][two]) for total in (self.both, either)
        ]
        left = without[1] > 0
        index = without[0][left] / without[1][left]
        return float(index.min()), float(index.max())

    def dice_interval(self) -> Interval:
        """Return the interval of Dice."""
        return ratio_interval(2 * self.both, 2 * self.both + self.only_a + self.only_b)

    def median_of(self, values: Image | None) -> Coordinates:
        """Return the median of the finite ``values`` (n_z, n_theta) over every site, NaN where there are none."""
        if values is None:
            return np.full(self.both.size, np.nan)
        inside = self.labels > 0
        return quantiles(values[inside], self.labels[inside], self.both.size, 0.5)[1:]


def find_sites(a: Mask, b: Mask, both_valid: Mask, sample_mm2: float) -> Sites:
    """Return the sites of the masks ``a`` and ``b`` within ``both_valid``, all bool (n_z, n_theta)."""
    labels = label_in_order((a | b) & both_valid)
    inside = labels > 0
    kind = a[inside] + 2 * b[inside].astype(np.int64)
    n = int(labels.max(initial=0))
    counts = np.bincount(4 * labels[inside].astype(np.int64) + kind, minlength=4 * (n + 1)).reshape(-1, 4)[1:]
    both, only_a, only_b = (counts[:, k].astype(np.float64) for k in (3, 1, 2))
    return Sites(labels, both, only_a, only_b, sample_mm2)


def strata(sites: Sites, surfaces: Sequence[Surface]) -> Strata:
    """Return the Jaccard index over sites parted by size, depth and contrast, where sides know these.

    Contrast is the median over a site, of the first of ``surfaces`` that has it. So is depth: of the first that
    measures it or, where none does, of the first that has it by light.
    """
    with_relief = sorted((s for s in surfaces if s.relief_mm is not None), key=lambda s: s.relief_error_mm is not None)
    relief = next((s.relief_mm for s in with_relief), None)
    contrast = next((s.contrast for s in surfaces if s.contrast is not None), None)
    diameter_mm = 2 * np.sqrt(sites.area_mm2 / np.pi)
    parted = {"diameter_mm": _parted(sites, diameter_mm, SIZE_EDGES_MM)}
    if relief is not None:
        parted["depth_mm"] = _parted(sites, sites.median_of(relief), DEPTH_EDGES_MM)
    if contrast is not None:
        parted["contrast"] = _parted(sites, sites.median_of(contrast), CONTRAST_EDGES)
    return Strata(**parted)


def _parted(sites: Sites, by: Coordinates, edges: Sequence[float]) -> tuple[Stratum, ...]:
    rows = []
    for low, high in zip((None, *edges), (*edges, None), strict=True):
        which = (by >= (-np.inf if low is None else low)) & (by < (np.inf if high is None else high))
        n = int(which.sum())
        union = float((sites.both + sites.only_a + sites.only_b)[which].sum())
        rows.append(
            Stratum(
                low=low,
                to=high,
                sites=n,
                area_mm2=float(sites.area_mm2[which].sum()),
                jaccard=ratio(float(sites.both[which].sum()), float(union)),
                jaccard_interval=sites.jaccard_interval(which),
                only_first=float(((sites.both + sites.only_b)[which] == 0).mean()) if n else None,
                only_second=float(((sites.both + sites.only_a)[which] == 0).mean()) if n else None,
            )
        )
    return tuple(rows)


def index_of(shared: float, whole: float) -> float | None:
    """Return the index of two masks, of which ``shared`` of ``whole`` agrees; :data:`BOTH_EMPTY` where there is none.

    For Jaccard these are |A ∩ B| and |A ∪ B|; for Dice, 2 |A ∩ B| and |A| + |B|.
    """
    return float(shared / whole) if whole else BOTH_EMPTY


@dataclass(frozen=True)
class Agreement:
    """Samples of two masks, counted where both are valid, and the area of a sample on the wall in mm²."""

    both: int
    only_a: int
    only_b: int
    neither: int
    sample_mm2: float

    @property
    def jaccard(self) -> float | None:
        """|A ∩ B| / |A ∪ B| (Laves 2019, Results); :data:`BOTH_EMPTY` where neither shows a cell."""
        return index_of(self.both, self.both + self.only_a + self.only_b)

    @property
    def dice(self) -> float | None:
        """2 |A ∩ B| / (|A| + |B|); :data:`BOTH_EMPTY` where neither shows a cell."""
        return index_of(2 * self.both, 2 * self.both + self.only_a + self.only_b)


def jaccard(a: Mask, b: Mask, valid: Mask) -> float | None:
    """Return |A ∩ B| / |A ∪ B| over ``valid``, all bool and of one shape; :data:`BOTH_EMPTY` where they are."""
    return agreement(a, b, valid, 1.0).jaccard


def agreement(a: Mask, b: Mask, valid: Mask, sample_mm2: float) -> Agreement:
    """Count how the masks ``a`` and ``b`` agree over ``valid``; all bool and of one shape."""
    both = int(np.count_nonzero(a & b & valid))
    only_a = int(np.count_nonzero(a & ~b & valid))
    only_b = int(np.count_nonzero(~a & b & valid))
    return Agreement(both, only_a, only_b, int(np.count_nonzero(valid)) - both - only_a - only_b, sample_mm2)


def overlap(a: Surface, b: Surface, sites: Sites) -> Overlap:
    """Return how far the cells of two surfaces on one grid overlap, with intervals over their ``sites``."""
    found = agreement(a.mask, b.mask, a.valid & b.valid, sites.sample_mm2)
    return Overlap(
        jaccard=found.jaccard,
        dice=found.dice,
        both_mm2=found.both * found.sample_mm2,
        only_a_mm2=found.only_a * found.sample_mm2,
        only_b_mm2=found.only_b * found.sample_mm2,
        neither_mm2=found.neither * found.sample_mm2,
        sites=int(sites.both.size),
        jaccard_interval=sites.jaccard_interval(),
        dice_interval=sites.dice_interval(),
        jaccard_without_two=sites.jaccard_without_two(),
    )


def difference(a: Mask, b: Mask, valid: Mask) -> NDArray[np.int8]:
    """Return per sample NEITHER, BOTH, ONLY_A or ONLY_B, and −1 where it is not ``valid``, int8."""
    codes = np.select([a & b, a & ~b, ~a & b], [BOTH, ONLY_A, ONLY_B], default=NEITHER)
    return np.where(valid, codes, -1).astype(np.int8)
