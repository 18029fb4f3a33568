"""Depths that fit best together: what a path brings along, from both ends, and how sure a depth is."""

import numpy as np
import pytest

from endoct.modalities.endoscope.parallax.matching import _step, best_depths, spread

DEPTHS_MM = 0.1 * np.arange(6)


def test_a_neighbour_in_depth_costs_a_step_from_either_side() -> None:
    path = np.array([10, 0, 30], np.int32)
    assert _step(np.array([0, 0, 7], np.uint8), path, 0, 3, 20) == 0
    assert path.tolist() == [3, 0, 10]


@pytest.mark.parametrize("known", [0, 2])
def test_what_one_end_knows_reaches_the_other(known: int) -> None:
    costs = np.full((3, 1, 6), 100, np.uint8)
    costs[known] = [200, 200, 200, 200, 0, 200]
    np.testing.assert_allclose(best_depths(costs, 10, 50, DEPTHS_MM), np.full((3, 1), 0.4), atol=1e-6)


def test_two_depths_that_cost_the_same_are_as_probable() -> None:
    costs = np.array([[[0, 0, 255]]], np.uint8)
    apart_mm = spread(costs, np.array([[-1.0]], np.float32), np.array([0.0, 1.0, 2.0]), 1.0)
    assert apart_mm[0, 0] == pytest.approx(np.sqrt((1 + 4) / 2), rel=1e-5)
