"""What Jaccard index a learned eye expects, by hand."""

import numpy as np
import pytest

from endoct.fusion.segmentation.by_eye import expected_jaccard


def test_what_is_surely_cell_over_what_may_be() -> None:
    probability = np.array([[0.9, 0.7, 0.2, 0.0, 1.0]], np.float32)
    mask, valid = np.array([[1, 1, 0, 0, 0]], bool), np.array([[1, 1, 1, 1, 0]], bool)
    assert expected_jaccard(probability, mask, valid) == pytest.approx(1.6 / 2.2)


def test_without_cells_all_is_well() -> None:
    none = np.zeros((2, 3), bool)
    assert expected_jaccard(np.zeros((2, 3), np.float32), none, ~none) == 1
