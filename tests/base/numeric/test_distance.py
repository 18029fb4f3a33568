"""Distances to the outline of a mask on the circle."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from endoct.base.numeric.distance import signed_distance


def test_distances_of_one_sample_by_hand() -> None:
    mask = np.zeros((3, 6), np.bool_)
    mask[1, 0] = True
    found = signed_distance(mask, (3.0, 4.0), 9.0)
    assert found[1].tolist() == [3, -4, -8, -9, -8, -4]  # the row above is nearest; around the seam it is as far
    assert found[0].tolist() == pytest.approx([-3, -5, -np.hypot(3, 8), -9, -np.hypot(3, 8), -5])


def test_where_there_is_no_outline_it_is_as_far_as_asked() -> None:
    assert (signed_distance(np.ones((4, 5), np.bool_), (1.0, 1.0), 2.5) == 2.5).all()
    assert (signed_distance(np.zeros((4, 5), np.bool_), (1.0, 1.0), 2.5) == -2.5).all()


def test_a_column_of_one_kind_after_one_of_many_cells_keeps_within_its_rows() -> None:
    """Where each parabola of the column before began is no bound of one that has none."""
    mask = np.zeros((400, 3), np.bool_)
    mask[::2, 0] = True
    assert (signed_distance(mask, (1.0, 100.0), 1.5)[:, 1:] == -1.5).all()
    assert (signed_distance(~mask, (1.0, 100.0), 1.5)[:, 1:] == 1.5).all()


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
@pytest.mark.parametrize("shape", [(1, 7), (5, 1), (40, 64), (3, 200), (90, 8)])
@pytest.mark.parametrize("sample_mm", [(0.07, 0.031), (0.02, 0.11)])
def test_it_is_the_exact_distance_around_the_circle(
    shape: tuple[int, int], share: float, sample_mm: tuple[float, float]
) -> None:
    mask = np.random.default_rng(0).random(shape) < share
    thrice = np.tile(mask, (1, 3))
    inside, outside = (
        np.full(thrice.shape, np.inf) if of.all() else distance_transform_edt(of, sampling=sample_mm)
        for of in (thrice, ~thrice)
    )
    wanted = np.where(thrice, inside, -outside)[:, shape[1] : 2 * shape[1]]
    found = signed_distance(mask, sample_mm, 1.0)
    assert found.dtype == np.float32
    assert found == pytest.approx(np.clip(wanted, -1, 1), abs=1e-6)
