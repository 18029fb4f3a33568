"""Agreement of two masks, by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as hnp

from endoct.fusion.scoring.overlap import agreement, difference

A = np.array([[1, 1, 0, 0], [1, 0, 0, 1]], np.bool_)
B = np.array([[1, 0, 1, 0], [1, 0, 0, 1]], np.bool_)
SEEN = np.array([[1, 1, 1, 1], [1, 1, 1, 0]], np.bool_)


def test_by_hand() -> None:
    # within SEEN: both 2, only A 1, only B 1, neither 3
    found = agreement(A, B, SEEN, sample_mm2=0.5)
    assert (found.both, found.only_a, found.only_b, found.neither) == (2, 1, 1, 3)
    assert found.jaccard == pytest.approx(2 / 4)
    assert found.dice == pytest.approx(4 / 6)
    stated = found.overlap(sites=2, jaccard_interval=None, dice_interval=None)
    assert (stated.jaccard, stated.dice) == pytest.approx((0.5, 2 / 3))
    areas = stated.both_mm2, stated.only_a_mm2, stated.only_b_mm2, stated.neither_mm2
    assert areas == pytest.approx((1.0, 0.5, 0.5, 1.5))


def test_the_difference_image() -> None:
    assert difference(A, B, SEEN).tolist() == [[1, 2, 3, 0], [1, 0, 0, -1]]


def test_no_cells_at_all_is_no_score() -> None:
    none = np.zeros_like(A)
    found = agreement(none, none, SEEN, 1.0)
    assert found.jaccard is None
    assert found.dice is None


@given(
    masks=hnp.arrays(np.bool_, (3, 4, 5)),
)
def test_dice_is_a_function_of_jaccard_and_both_are_symmetric(masks: np.ndarray) -> None:
    one, two = agreement(masks[0], masks[1], masks[2], 1.0), agreement(masks[1], masks[0], masks[2], 1.0)
    assert one.jaccard == two.jaccard
    if one.jaccard is not None:
        assert one.dice == pytest.approx(2 * one.jaccard / (1 + one.jaccard))
