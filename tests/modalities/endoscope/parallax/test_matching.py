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


@pytest.mark.parametrize(
    ("costs", "place"),
    [
        ([200, 100, 20, 40, 200, 200], 2 + 60 / 200),
        ([200, 40, 20, 100, 200, 200], 2 - 60 / 200),
        ([200, 100, 60, 20, 20, 200], 3 + 0.5 * 40 / 40),  # two alike: between them
        ([200, 50, 0, 50, 0, 50], 2),  # the first
        ([0, 50, 200, 200, 200, 200], 0.5),  # the first and the last are neighbours only
        ([200, 200, 200, 200, 50, 0], 4.5),
        ([70, 70, 70, 70, 70, 70], 1),
    ],
)
def test_a_depth_lies_between_those_that_were_tried(costs: list[int], place: float) -> None:
    """Without a price on differing, the total is four times what each depth costs; a parabola has its least there."""
    found = best_depths(np.array([[costs]], np.uint8), 0, 0, DEPTHS_MM)
    assert found[0, 0] == pytest.approx(0.1 * place, abs=1e-6)


@pytest.mark.parametrize("known", [0, 3, 5])
def test_what_one_column_knows_reaches_all_around_it(known: int) -> None:
    costs = np.full((1, 6, 6), 100, np.uint8)
    costs[0, known] = [200, 200, 200, 0, 200, 200]
    np.testing.assert_allclose(best_depths(costs, 10, 50, DEPTHS_MM), np.full((1, 6), 0.3), atol=1e-6)


def test_a_blunder_is_overruled_where_differing_costs_more_than_it_saves() -> None:
    """All columns cost nothing at 0.2 mm; one costs 40 there, and nothing at 0.4 mm.

    Of the four paths all bring 40 there, 160 together; two come from neighbours, and pay to end at 0.4 mm.
    """
    costs = np.full((1, 9, 6), 200, np.uint8)
    costs[0, :, 2] = 0
    costs[0, 4, 2], costs[0, 4, 4] = 40, 0
    assert best_depths(costs, 85, 85, DEPTHS_MM)[0, 4] == pytest.approx(0.2, abs=0.05)
    assert best_depths(costs, 75, 75, DEPTHS_MM)[0, 4] == pytest.approx(0.4, abs=0.05)


def test_a_depth_that_costs_more_is_less_probable_and_stands_for_its_share_of_depths() -> None:
    """Depths 0, 1 and 3 stand for 1, 1.5 and 2; costs 10 and 20 more are e⁻¹ and e⁻² as probable."""
    costs, depths_mm = np.array([[[5, 15, 25]]], np.uint8), np.array([0.0, 1.0, 3.0])
    weight = np.array([1, 1.5 * np.exp(-1), 2 * np.exp(-2)])
    expected = np.sqrt((weight * (depths_mm - 0.5) ** 2).sum() / weight.sum())
    apart_mm = spread(costs, np.array([[0.5]], np.float32), depths_mm, 10.0)
    assert apart_mm[0, 0] == pytest.approx(expected, rel=1e-5)
