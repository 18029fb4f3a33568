"""The largest of many values."""

import numpy as np
import pytest

from endoct.modalities.oct.surface.wall import AT_ONCE, largest


@pytest.mark.parametrize("n", [1, 2, AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE, 5 * AT_ONCE + 7])
def test_the_largest_is_found_at_every_place(n: int) -> None:
    for place in range(n):
        values = -np.arange(1, n + 1, dtype=np.float32)
        values[place] = 0.5
        assert largest(values) == 0.5
    assert largest(np.full(n, -np.inf, np.float32)) == -np.inf
