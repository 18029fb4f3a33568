"""Masks of cells without what is too small to be one."""

from endoct.base.arrays import Mask
from endoct.base.numeric.regions import morphology, remove_small
from endoct.fusion.segmentation.parameters import SegmentParameters

LEAST_SAMPLES = 3
"""Fewer samples are no cell, however large they are. Of walls sampled 144 times around and as coarsely along, this
leaves 0.83 of the cells in place of 0.86, and 6 other regions a bore in place of 11 (benchmarks.picks)."""


def clean(
    mask: Mask, dz_mm: float, column_mm: float, parameters: SegmentParameters, *, largest_hole_mm2: float | None = None
) -> Mask:
    """Return ``mask`` opened, closed, and without small cells and holes.

    A cell is small below ``smallest_mm2`` and below ``LEAST_SAMPLES``. A hole is so below that area, unless
    ``largest_hole_mm2`` is given.
    """
    p = parameters
    mask = morphology(mask, "open", p.open_mm / dz_mm, p.open_mm / column_mm)
    mask = morphology(mask, "close", p.close_mm / dz_mm, p.close_mm / column_mm)
    sample_mm2 = dz_mm * column_mm
    hole_mm2 = p.smallest_mm2 if largest_hole_mm2 is None else largest_hole_mm2
    mask = remove_small(mask, max(p.smallest_mm2 / sample_mm2, LEAST_SAMPLES))
    return ~remove_small(~mask, hole_mm2 / sample_mm2)
