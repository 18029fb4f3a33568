"""What depth by parallax says of cells that were found by their darkness: some were missed, some are none.

A shallow floor may be as bright as the wall, but lies behind it. A stain is as dark as a cell, but lies in the wall.
Where depth is not known, darkness alone decides.
"""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Mask
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.parallax import ParallaxRelief
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.regions import clean, label, looked_up, quantiles

LEAST_DEPTH_MM = 0.05
LEAST_SIGMAS = 1.5
"""Behind the wall by more than either is a cell."""
FLAT_MM = 0.025
SURE_MM = 0.05
SURE_SHARE = 0.5
MOST_DARKNESS = 0.3
"""A stain lies no farther behind the wall than ``FLAT_MM`` in the median, known to ``SURE_MM`` on at least
``SURE_SHARE`` of it, and is no darker than ``MOST_DARKNESS``, −log of the intensity: deep cells are darker."""


@dataclass(frozen=True)
class ByDepth:
    """How much depth decided, as shares of what was observed: where it is ``known``, ``added`` and ``dropped``."""

    known: float
    added: float
    dropped: float


def judged_by_depth(
    cells: Mask, darkness: Evidence, relief: ParallaxRelief, parameters: SegmentParameters
) -> tuple[Mask, ByDepth]:
    """Return ``cells``, bool (n_z, n_theta), with those that lie behind the wall and without stains, and what changed.

    ``darkness`` is the evidence by which they were found, ``relief`` on the same samples.
    """
    stains = _stains(cells, darkness, relief)
    behind = _behind(darkness, relief, parameters)
    both = clean((cells & ~stains) | behind, darkness.dz_mm, darkness.column_mm, parameters) | (cells & ~stains)
    both &= darkness.valid
    observed = max(int(np.count_nonzero(darkness.valid)), 1)
    shares = (relief.known & darkness.valid, both & ~cells, stains & darkness.valid)
    return both, ByDepth(*(int(np.count_nonzero(some)) / observed for some in shares))


def _behind(darkness: Evidence, relief: ParallaxRelief, parameters: SegmentParameters) -> Mask:
    """Return what surely lies behind the wall."""
    least_mm = np.fmax(np.float32(LEAST_DEPTH_MM), np.float32(LEAST_SIGMAS) * relief.error_mm)
    deep = darkness.valid & relief.known & (relief.relief_mm > least_mm)
    return clean(deep, darkness.dz_mm, darkness.column_mm, parameters)


def _stains(cells: Mask, darkness: Evidence, relief: ParallaxRelief) -> Mask:
    """Return those regions of ``cells`` that lie in the wall."""
    labels, n = label(cells)
    sure = relief.known & (relief.error_mm < SURE_MM)
    size = np.bincount(labels.ravel(), minlength=n + 1)
    share = np.bincount(labels[sure], minlength=n + 1) / np.maximum(size, 1)
    depth_mm = quantiles(np.where(sure, relief.relief_mm, np.float32(np.nan)), labels, n, 0.5)
    dark = quantiles(darkness.values, labels, n, 0.5)
    stain = (share >= SURE_SHARE) & (depth_mm < FLAT_MM) & (dark < MOST_DARKNESS)
    stain[0] = False
    return looked_up(stain, labels)
