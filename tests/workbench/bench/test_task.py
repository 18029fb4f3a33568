"""Drawing the conditions of cases."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.workbench.bench.task import Range, draw


@given(seed=st.integers(0, 10**6), index=st.integers(0, 1000), low=st.floats(-5, 5), width=st.floats(0, 5))
def test_narrowing_one_condition_leaves_the_others(seed: int, index: int, low: float, width: float) -> None:
    ranges: dict[str, Range] = {"a": (0.0, 1.0), "b": (low, low + width), "c": ("x", "y", "z")}
    drawn = draw(seed, index, ranges)
    assert low <= float(drawn["b"]) <= low + width
    narrow = draw(seed, index, {"c": ("x", "y", "z"), "a": (0.0, 1.0), "b": (low, low)})
    assert (narrow["a"], narrow["c"]) == (drawn["a"], drawn["c"])
    assert narrow["b"] == pytest.approx(low)
