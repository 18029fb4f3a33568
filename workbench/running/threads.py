"""One thread for linear algebra: the matrices here are small, and threads that wait for each other only burn time."""

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, as a context or a decorator: less processor time, and sums in one order.

    Solving for a catheter's uneven turns took some seven times the processor time with two threads.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
