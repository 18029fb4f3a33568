"""What is too small to be a cell: by its area, and by the samples that show it."""

import numpy as np

from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.parameters import SegmentParameters


def test_two_samples_are_no_cell_however_large_and_three_are() -> None:
    parameters = SegmentParameters(open_mm=0, close_mm=0, smallest_mm2=0.01)
    mask = np.zeros((6, 40), np.bool_)
    mask[1, 3:5] = mask[3, [38, 39, 0]] = True  # the latter across the seam
    kept = clean(mask, 0.2, 0.2, parameters)
    assert np.flatnonzero(kept.any(axis=1)).tolist() == [3]
    assert kept[3].sum() == 3
    assert clean(mask, 0.05, 0.05, parameters).sum() == 0  # 0.0075 mm²
    assert not clean(~mask, 0.2, 0.2, parameters)[1, 3]  # a hole has an area alone
