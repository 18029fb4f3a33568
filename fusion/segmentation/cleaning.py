"""Masks of cells without what is too small to be one."""

from endoct.base.arrays import Mask
from endoct.base.numeric.regions import morphology, remove_small
from endoct.fusion.segmentation.parameters import SegmentParameters


def clean(
    mask: Mask,
    dz_mm: float,
    column_mm: float,
    parameters: SegmentParameters,
    *,
    largest_hole_mm2: float | None = None,
) -> Mask:
    """Return ``mask`` opened, closed, and without small cells and holes.

    A cell is small below ``smallest_mm2``, and so is a hole unless ``largest_hole_mm2`` is given.
    """
    p = parameters
    mask = morphology(mask, "open", p.open_mm / dz_mm, p.open_mm / column_mm)
    mask = morphology(mask, "close", p.close_mm / dz_mm, p.close_mm / column_mm)
    sample_mm2 = dz_mm * column_mm
    hole_mm2 = p.smallest_mm2 if largest_hole_mm2 is None else largest_hole_mm2
    mask = remove_small(mask, p.smallest_mm2 / sample_mm2)
    return ~remove_small(~mask, hole_mm2 / sample_mm2)
