"""Where a function is 0."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from endoct.synthetic.endoscope.root import root


@given(st.floats(-5, 5), st.floats(0.1, 8), st.sampled_from([1e-3, 1e-9, 1e-12]))
def test_it_is_that_of_scipy_to_the_last_bit(shift: float, scale: float, within: float) -> None:
    def function(x: float) -> float:
        return math.tanh(scale * (x - shift)) + 0.1 * (x - shift) ** 3

    theirs = brentq(function, -20, 30, xtol=within, rtol=1e-14)
    assert root(function, -20, 30, within=within, share=1e-14) == theirs


@pytest.mark.parametrize("function", [lambda x: x**2 + 1, lambda x: -1.0 - x**2])
def test_without_a_change_of_sign_there_is_none(function: Callable[[float], float]) -> None:
    with pytest.raises(ValueError, match="sign"):
        root(function, -1, 2, within=1e-9, share=1e-14)


def test_an_end_may_be_the_root() -> None:
    assert root(lambda x: x, 0, 1, within=1e-9, share=1e-14) == 0
    assert root(lambda x: x - 1, 0, 1, within=1e-9, share=1e-14) == 1
