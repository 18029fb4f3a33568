"""Morphology, labels and quantiles on the circle."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.ndimage import binary_erosion, grey_dilation

from endoct.base.numeric.regions import (
    eroded,
    highest_within,
    label,
    label_in_order,
    morphology,
    quantiles,
    remove_small,
    within,
)

masks = hnp.arrays(np.bool_, st.tuples(st.integers(2, 9), st.integers(8, 24)))


def test_a_cell_on_the_seam_is_one_cell() -> None:
    mask = np.zeros((5, 12), np.bool_)
    mask[1:3, [0, 1, 10, 11]] = True
    mask[4, 5] = True
    labels, n = label(mask)
    assert n == 2
    assert len(set(labels[1:3, [0, 1, 10, 11]].ravel())) == 1
    assert labels[4, 5] not in (0, labels[1, 0])
    assert np.array_equal(labels > 0, mask)


def test_cells_that_touch_over_the_seam_at_a_corner_only_are_one() -> None:
    mask = np.zeros((4, 8), np.bool_)
    mask[0, 7] = mask[1, 0] = True
    assert label(mask)[1] == 1


@given(mask=masks, shift=st.integers(0, 23))
def test_labels_do_not_know_the_seam(mask: np.ndarray, shift: int) -> None:
    labels, n = label(mask)
    rolled, n_rolled = label(np.roll(mask, shift, axis=1))
    assert n == n_rolled
    sizes = np.sort(np.bincount(labels.ravel(), minlength=n + 1)[1:])
    assert np.array_equal(sizes, np.sort(np.bincount(rolled.ravel(), minlength=n + 1)[1:]))


@pytest.mark.parametrize("operation", ["open", "close"])
@given(mask=masks, shift=st.integers(0, 23), rows=st.floats(0, 2), columns=st.floats(0, 4))
def test_morphology_does_not_know_the_seam(
    operation: Literal["open", "close"], mask: np.ndarray, shift: int, rows: float, columns: float
) -> None:
    once = morphology(mask, operation, rows, columns)
    rolled = morphology(np.roll(mask, shift, axis=1), operation, rows, columns)
    assert np.array_equal(np.roll(once, shift, axis=1), rolled)
    assert np.array_equal(morphology(once, operation, rows, columns), once)
    assert np.all(once <= mask) if operation == "open" else np.all(once >= mask)


def test_opening_removes_what_is_narrower_than_twice_the_radius() -> None:
    mask = np.zeros((9, 40), np.bool_)
    mask[2:7, 3:5] = True
    mask[2:7, 20:27] = True
    opened = morphology(mask, "open", 0, 2)
    assert not opened[:, :10].any()
    assert np.array_equal(opened[:, 20:27], mask[:, 20:27])


@pytest.mark.parametrize(("rows", "columns"), [(0.3, 4.0), (3.4, 1.0), (2.0, 5.0)])
def test_what_lies_within_an_ellipse_as_scipy_has_it_on_a_tiled_wall(rows: float, columns: float) -> None:
    rng = np.random.default_rng(5)
    image, mask = rng.normal(size=(20, 30)).astype(np.float32), rng.random((20, 30)) < 0.05
    up, across = max(1, round(rows)), max(1, round(columns))
    y, x = np.mgrid[-up : up + 1, -across : across + 1]
    ellipse = np.hypot(y / up, x / across) <= 1 + 1e-12

    def dilated(values: np.ndarray) -> np.ndarray:
        ended = np.pad(np.tile(values, 3), ((up, up), (0, 0)), constant_values=-9)  # z ends, θ does not
        return np.asarray(grey_dilation(ended, footprint=ellipse)[up:-up, 30:60])

    np.testing.assert_array_equal(highest_within(image, rows, columns), dilated(image))
    np.testing.assert_array_equal(within(mask, rows, columns), dilated(mask.astype(np.float32)) > 0)
    big = within(mask, 3, 4)
    tiled = np.pad(np.tile(big, 3), ((1, 1), (0, 0)), mode="edge")
    np.testing.assert_array_equal(eroded(big), binary_erosion(tiled, np.ones((3, 3)))[1:-1, 30:60])


def test_labels_are_in_the_order_of_where_cells_lie_along_the_bore() -> None:
    mask = np.zeros((30, 40), np.bool_)
    for number, row in enumerate((3, 8, 13, 18, 23)):
        mask[row : row + 2, np.arange(16 * number - 2, 16 * number + 3) % 40] = True
    mask[4:28, 20] = True  # its middle is row 15.5
    labels = label_in_order(mask)
    middles = [np.argwhere(labels == number)[:, 0].mean() for number in range(1, labels.max() + 1)]
    assert labels.max() == label(mask)[1]
    assert middles == sorted(middles)
    np.testing.assert_array_equal(labels > 0, mask)


def test_small_cells_go_and_a_cell_split_by_the_seam_counts_whole() -> None:
    mask = np.zeros((6, 20), np.bool_)
    mask[1:3, [19, 0]] = True
    mask[4, 9:12] = True
    kept = remove_small(mask, 4)
    assert np.array_equal(kept[1:3], mask[1:3])
    assert not kept[4].any()


def test_a_quantile_of_every_label_is_one_of_its_values():
    rng = np.random.default_rng(0)
    values, labels = rng.normal(size=500).astype(np.float32), rng.integers(0, 6, 500)
    values[rng.random(500) < 0.1] = np.nan
    values[labels == 2] = np.nan
    for share in (0.0, 0.5, 0.95, 1.0):
        found = quantiles(values, labels, 7, share)
        for k in range(8):
            own = np.sort(values[(labels == k) & np.isfinite(values)])
            assert np.isnan(found[k]) if not own.size else found[k] == own[int(share * (own.size - 1))]
