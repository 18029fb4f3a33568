"""Agreement of two masks, by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as hnp

from endoct.fusion.scoring.overlap import Surface, agreement, difference, find_sites, jaccard, overlap, strata

A = np.array([[1, 1, 0, 0], [1, 0, 0, 1]], np.bool_)
B = np.array([[1, 0, 1, 0], [1, 0, 0, 1]], np.bool_)
SEEN = np.array([[1, 1, 1, 1], [1, 1, 1, 0]], np.bool_)


def test_by_hand() -> None:
    # within SEEN: both 2, only A 1, only B 1, neither 3
    found = agreement(A, B, SEEN, sample_mm2=0.5)
    assert (found.both, found.only_a, found.only_b, found.neither) == (2, 1, 1, 3)
    assert found.jaccard == pytest.approx(2 / 4)
    assert found.dice == pytest.approx(4 / 6)
    stated = overlap(Surface("a", A, SEEN), Surface("b", B, SEEN), find_sites(A, B, SEEN, 0.5))
    assert (stated.jaccard, stated.dice) == pytest.approx((0.5, 2 / 3))
    areas = stated.both_mm2, stated.only_a_mm2, stated.only_b_mm2, stated.neither_mm2
    assert areas == pytest.approx((1.0, 0.5, 0.5, 1.5))


def test_what_one_or_two_cells_decide() -> None:
    """Sites by hand: one large on which both agree, across the seam, and small ones of which one side shows half."""
    a, b = np.zeros((2, 12, 40), np.bool_)
    seen = np.ones(a.shape, np.bool_)
    a[0:4, [38, 39, 0, 1]] = b[0:4, [38, 39, 0, 1]] = True  # 16 of 16
    for k in range(3):
        a[6:10, 6 * k + 5] = b[6:8, 6 * k + 5] = True  # 2 of 4 each
    a[6:10, 30], seen[6:10, 30] = True, False
    sites = find_sites(a, b, seen, 1.0)
    assert sorted(sites.both.tolist()) == [2, 2, 2, 16]
    without_two = sites.jaccard_without_two()
    assert without_two is not None
    assert without_two == pytest.approx((6 / 12, (16 + 2) / (16 + 4)))
    assert find_sites(a[:, :20], b[:, :20], seen[:, :20], 1.0).jaccard_without_two() is not None
    assert find_sites(a[:4], b[:4], seen[:4], 1.0).jaccard_without_two() is None


@pytest.mark.parametrize("last", ["a", "b", "both"])
def test_sites_count_each_side_also_where_the_last_shows_one_only(last: str) -> None:
    a, b = np.zeros((2, 9, 12), np.bool_)
    a[1, [11, 0, 1]] = b[1, [0, 1, 2]] = True  # over the seam
    a[4, 4] = b[5, 5] = True  # at a corner: one
    a[8, 8:10], b[8, 8:10] = last != "b", last != "a"
    sites = find_sites(a, b, np.ones(a.shape, np.bool_), 0.5)
    assert sites.both.tolist() == [2, 0, 2 * (last == "both")]
    assert sites.only_a.tolist() == [1, 1, 2 * (last == "a")]
    assert sites.only_b.tolist() == [1, 1, 2 * (last == "b")]
    assert sites.area_mm2.tolist() == [2, 1, 1]
    assert np.bincount(sites.labels.ravel()).tolist() == [9 * 12 - 8, 4, 2, 2]


def test_the_difference_image() -> None:
    assert difference(A, B, SEEN).tolist() == [[1, 2, 3, 0], [1, 0, 0, -1]]


def test_no_cells_at_all_is_no_score() -> None:
    none = np.zeros_like(A)
    found = agreement(none, none, SEEN, 1.0)
    assert found.jaccard is None
    assert found.dice is None
    assert jaccard(none, none, SEEN) is None
    assert jaccard(A, B, SEEN) == pytest.approx(2 / 4)


@given(
    masks=hnp.arrays(np.bool_, (3, 4, 5)),
)
def test_dice_is_a_function_of_jaccard_and_both_are_symmetric(masks: np.ndarray) -> None:
    one, two = agreement(masks[0], masks[1], masks[2], 1.0), agreement(masks[1], masks[0], masks[2], 1.0)
    assert one.jaccard == two.jaccard
    if one.jaccard is not None:
        assert one.dice == pytest.approx(2 * one.jaccard / (1 + one.jaccard))


def test_sites_are_parted_by_size_depth_and_contrast() -> None:
    """By hand: squares of 1, 4, 16 and 36 samples of 0.0225 mm², as circles 0.17, 0.34, 0.68 and 1.02 mm wide."""
    a = np.zeros((20, 40), np.bool_)
    relief, contrast = np.full(a.shape, np.nan, np.float32), np.zeros(a.shape, np.float32)
    for size, column, depth, light in ((1, 2, 0.05, 0.3), (2, 6, 0.1, 0.4), (4, 12, 0.29, 0.79), (6, 20, 0.3, 0.8)):
        place = slice(3, 3 + size), slice(column, column + size)
        a[place], relief[place], contrast[place] = True, depth, light
    b = a.copy()
    b[3:5, 6:8], b[3, 12] = False, False
    sites = find_sites(a, b, np.ones(a.shape, np.bool_), 0.0225)
    stated = Surface("a", a, a, relief_mm=relief, relief_error_mm=relief), Surface("b", b, b, contrast=contrast)
    found = strata(sites, stated)
    parts = found.diameter_mm, found.depth_mm, found.contrast
    assert [[part.low for part in of] for of in parts] == [[None, 0.3, 0.6], [None, 0.1, 0.3], [None, 0.4, 0.8]]
    assert [[part.to for part in of] for of in parts] == [[0.3, 0.6, None], [0.1, 0.3, None], [0.4, 0.8, None]]
    assert [[part.sites for part in of] for of in parts] == [[1, 1, 2], [1, 2, 1], [1, 2, 1]]
    small, middle, large = found.depth_mm
    assert (small.jaccard, middle.jaccard, large.jaccard) == pytest.approx((1, 15 / 20, 1))
    assert (small.only_first, middle.only_first, middle.only_second) == (0, 0.5, 0)
    assert middle.area_mm2 == pytest.approx(20 * 0.0225)
    # depth that was measured goes before depth by parallax
    measured = Surface("b", b, b, relief_mm=np.where(a, np.float32(0.5), np.nan))
    assert [part.sites for part in strata(sites, (*stated, measured)).depth_mm] == [0, 0, 4]
    assert strata(sites, ()).depth_mm == ()
