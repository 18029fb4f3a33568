"""How far two masks of one wall agree, where both sides observed it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.fusion.result import Limits, Overlap
from endoct.fusion.scoring.intervals import Interval, interval_of, ratio
from endoct.fusion.scoring.sites import Sites
from endoct.fusion.scoring.surface import Surface
from endoct.stitching.arrays import Coordinates, Mask

FEWEST_PAIRS = 3
NEITHER, BOTH, ONLY_A, ONLY_B = range(4)
"""What a sample of two masks is."""


@dataclass(frozen=True)
class Agreement:
    """Samples of two masks, counted where both are valid, and what a sample measures on the wall in mm²."""

    both: int
    only_a: int
    only_b: int
    neither: int
    sample_mm2: float

    @property
    def jaccard(self) -> float | None:
        """|A ∩ B| / |A ∪ B| (Laves 2019, Results), or None where neither shows a cell."""
        return ratio(self.both, self.both + self.only_a + self.only_b)

    @property
    def dice(self) -> float | None:
        """2 |A ∩ B| / (|A| + |B|), or None where neither shows a cell."""
        return ratio(2 * self.both, 2 * self.both + self.only_a + self.only_b)

    def overlap(
        self, *, sites: int, jaccard_interval: Interval, dice_interval: Interval, jaccard_without_two: Interval
    ) -> Overlap:
        """Return scores and areas, with the number of sites, the intervals over them, and what few of them decide."""
        return Overlap(
            jaccard=self.jaccard,
            dice=self.dice,
            both_mm2=self.both * self.sample_mm2,
            only_a_mm2=self.only_a * self.sample_mm2,
            only_b_mm2=self.only_b * self.sample_mm2,
            neither_mm2=self.neither * self.sample_mm2,
            sites=sites,
            jaccard_interval=jaccard_interval,
            dice_interval=dice_interval,
            jaccard_without_two=jaccard_without_two,
        )


def jaccard(a: Mask, b: Mask, valid: Mask) -> float | None:
    """Return |A ∩ B| / |A ∪ B| over ``valid``, all bool and of one shape; None where both are empty there."""
    return agreement(a, b, valid, 1.0).jaccard


def agreement(a: Mask, b: Mask, valid: Mask, sample_mm2: float) -> Agreement:
    """Count how the masks ``a`` and ``b`` agree over ``valid``; all bool and of one shape."""
    both = int(np.count_nonzero(a & b & valid))
    only_a = int(np.count_nonzero(a & ~b & valid))
    only_b = int(np.count_nonzero(~a & b & valid))
    return Agreement(both, only_a, only_b, int(np.count_nonzero(valid)) - both - only_a - only_b, sample_mm2)


def overlap(a: Surface, b: Surface, sites: Sites) -> Overlap:
    """Return how far the cells of two surfaces on one grid overlap, with intervals over their ``sites``."""
    return agreement(a.mask, b.mask, a.valid & b.valid, sites.sample_mm2).overlap(
        sites=int(sites.both.size),
        jaccard_interval=sites.jaccard_interval(),
        dice_interval=sites.dice_interval(),
        jaccard_without_two=sites.jaccard_without_two(),
    )


def difference(a: Mask, b: Mask, valid: Mask) -> NDArray[np.int8]:
    """Return per sample NEITHER, BOTH, ONLY_A or ONLY_B, and −1 where it is not ``valid``, int8."""
    codes = np.select([a & b, a & ~b, ~a & b], [BOTH, ONLY_A, ONLY_B], default=NEITHER)
    return np.where(valid, codes, -1).astype(np.int8)


def bland_altman(a: Coordinates, b: Coordinates) -> Limits | None:
    """Return how far ``b`` differs from ``a``, pairs of measurements (n,) each; None for fewer than three.

    Bland and Altman 1986 (doi:10.1016/S0140-6736(86)90837-8): ``bias`` the mean of b − a, ``low`` and ``high`` the
    limits bias ± 1.96 SD within which 95 % of differences lie if they are normal; ``bias_interval`` bootstrapped over
    pairs.
    """
    if a.size < FEWEST_PAIRS:
        return None
    differs = b - a
    bias, spread = float(differs.mean()), 1.96 * float(differs.std(ddof=1))
    return Limits(
        pairs=int(a.size),
        bias=bias,
        low=bias - spread,
        high=bias + spread,
        bias_interval=interval_of(differs, np.mean),
    )
