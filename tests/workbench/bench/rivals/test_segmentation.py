"""Cells marked with other people's libraries."""

import numpy as np
import pytest

from endoct.workbench.bench.cases.toy_walls import RANGES
from endoct.workbench.bench.rivals import segmentation as rivals
from endoct.workbench.bench.tasks import segmentation
from endoct.workbench.bench.tasks.segmentation import SegmentationCase


def easy(modality: str) -> SegmentationCase:
    """A wall in good light, of which all can be seen."""
    kind = {"signal_db": 25.0, "cell_mm": 1.0, "fill": 0.2, "missing": 0.0, "unevenness": 0.5}
    assert kind.keys() == RANGES.keys()
    drawn = {name: (value, value) for name, value in kind.items()}
    return segmentation.cases(3, 0, {"recipe": ("made",), "modality": (modality,), **drawn})


@pytest.mark.parametrize("modality", ["depth", "intensity"])
def test_contours_close_around_cells_wherever_the_circle_is_cut(modality: str) -> None:
    case = easy(modality)
    mask = rivals.chan_vese_prepared(case.given)
    assert segmentation.judge(case, mask)["jaccard"] > 0.6
    np.testing.assert_array_equal(mask, rivals.chan_vese_prepared(case.given))
