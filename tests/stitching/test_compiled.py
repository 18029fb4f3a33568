"""Compiled loops: where their machine code cannot be kept they still run, and small systems of equations are solved."""

import numpy as np
import pytest
from numba.core.caching import CompileResultCacheImpl

from endoct.stitching.compiled import compiled
from endoct.stitching.equations import solve


def twice(value: float) -> float:
    return 2 * value


def test_code_that_cannot_be_kept_is_compiled_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    assert compiled(twice)(21.0) == 42


@pytest.mark.parametrize("n", [1, 3, 23])
def test_equations_are_solved(n: int) -> None:
    rng = np.random.default_rng(n)
    matrix, solution = rng.normal(size=(n, n)), rng.normal(size=n)
    matrix[0, 0] = 0 if n > 1 else 2  # needs another pivot
    vector = matrix @ solution
    solve(matrix.copy(), vector)
    np.testing.assert_allclose(vector, solution, rtol=1e-9)
