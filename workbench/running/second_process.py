"""A second process for what can be done at the same time, and one thread for linear algebra.

The second process unrolls the other recording, or draws figures. For linear algebra one thread will do: the
matrices here are small, and threads that wait for each other only burn time.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TypeVar

from threadpoolctl import threadpool_limits

from endoct.base.compute.worker_process import WorkerProcess, worker_process
from endoct.workbench.running.refusals import tame_libraries

Out = TypeVar("Out")


@contextmanager
def second_process() -> Iterator[WorkerProcess | None]:
    """Start a worker process; yield None on a computer with one processor, where it would be no help."""
    if (os.cpu_count() or 1) < 2:
        yield None
        return
    with worker_process() as process:
        process.call(tame_libraries)
        yield process


def beside(process: WorkerProcess | None, function: Callable[..., Out], *arguments: object) -> "Future[Out]":
    """Have ``process`` call a function of a module while this process goes on; without one, call it here and now."""
    if process is not None:
        return process.call(function, *arguments)
    done: Future[Out] = Future()
    done.set_result(function(*arguments))
    return done


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, as a context or a decorator: less processor time, and sums in one order.

    Solving for a catheter's uneven turns took some seven times the processor time with two threads.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
