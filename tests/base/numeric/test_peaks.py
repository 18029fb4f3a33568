"""The vertex of a parabola is found to the bit, and none where samples do not bend down."""

import numpy as np
import pytest

from endoct.base.numeric.least_squares import vertex, vertex_in_loops


@pytest.mark.parametrize("top", [-0.5, -0.25, 0.0, 0.375])
def test_a_parabola_has_its_top_where_it_was_put(top: float) -> None:
    three = [3.0 - 2.0 * (x - top) ** 2 for x in (-1, 0, 1)]
    assert float(vertex(*three)) == vertex_in_loops(*three) == top


def test_a_line_a_valley_and_even_samples_have_none() -> None:
    for three in ((1.0, 2.0, 3.0), (2.0, 1.0, 3.0), (1.0, 1.0, 1.0)):
        assert float(vertex(*three)) == vertex_in_loops(*three) == 0.0


def test_arrays_keep_their_type_and_each_place_has_its_own() -> None:
    before, here, after = np.array([[1, 5, 0], [3, 0, 2], [2, 5, 0]], np.float32)
    tops = vertex(before, here, after)
    assert tops.dtype == np.float32
    assert tops.tolist() == pytest.approx([1 / 6, 0.0, 0.0])
