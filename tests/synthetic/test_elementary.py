"""Elementary functions against NumPy's in double precision."""

from collections.abc import Callable

import numpy as np
import pytest

from endoct.synthetic.elementary import Numbers, azimuth, exp, log
from tests.tolerances import ELEMENTARY


@pytest.mark.parametrize("shape", [(0,), (5, 3), (40, 70)])
@pytest.mark.parametrize(("ours", "theirs"), [(exp, np.exp), (log, np.log)])
def test_they_are_those_of_numpy(ours: Callable[[Numbers], Numbers], theirs: np.ufunc, shape: tuple[int, ...]) -> None:
    x = np.random.default_rng(1).uniform(0.001, 20, shape).astype(np.float32)
    found = ours(x)
    assert found.shape == shape
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, theirs(x.astype(np.float64)), rtol=ELEMENTARY, atol=ELEMENTARY)


def test_an_azimuth_is_the_direction_of_its_unit_vector() -> None:
    angle = np.linspace(0, 2 * np.pi, 5000)
    found = azimuth(np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)).astype(np.float64)
    off = np.angle(np.exp(1j * (found - angle)))
    assert np.abs(off).max() < ELEMENTARY
    assert found.min() > -ELEMENTARY
    assert found.max() < 2 * np.pi + ELEMENTARY
