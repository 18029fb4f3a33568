"""Linear algebra keeps to one thread while the program computes, and the caller's own setting comes back."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from endoct.workbench.running.scheduler import one_blas_thread


def _threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_one_thread_within_and_the_callers_number_after() -> None:
    np.eye(2) @ np.eye(2)
    with threadpool_limits(2, user_api="blas"):
        before = _threads()
        with one_blas_thread():
            assert _threads() == {1}
        assert _threads() == before


def test_an_error_within_gives_the_callers_number_back() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = _threads()
        with pytest.raises(ZeroDivisionError), one_blas_thread():
            _ = 1 / 0
        assert _threads() == before
