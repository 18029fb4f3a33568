"""Work for several processors: threads that map a function over items, and jobs that threads take from one list.

Threads do where arrays are large, since NumPy and OpenCV let go of the interpreter meanwhile; for work on small ones
there is :mod:`endoct.base.compute.worker_process`. Long work reports its progress to a function of its caller.
"""

import itertools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from threading import Thread
from typing import Generic, Protocol, TypeVar

In_co = TypeVar("In_co", covariant=True)
Out = TypeVar("Out")
Here = TypeVar("Here")
There = TypeVar("There")

Advance = Callable[[float], None]
"""Called with the share of a stage that is done, 0 to 1."""

Progress = Callable[[str, float], None]
"""Called with the title of a stage and the share of it that is done."""


class Indexable(Protocol[In_co]):
    """Anything sized and indexable from 0, as a sequence or a stream of frames."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> In_co: ...


def thread_map(function: Callable[[In_co], Out], items: Indexable[In_co], workers: int | None = None) -> Iterator[Out]:
    """Yield ``function(item)`` in order, computed by threads, with at most ``workers`` + 1 items in memory.

    The result does not depend on ``workers`` (default: one for each processor).
    """
    workers = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        indices = iter(range(len(items)))
        pending: list[Future[Out]] = [
            pool.submit(lambda i: function(items[i]), i) for i in islice(indices, workers + 1)
        ]
        try:
            while pending:
                result = pending.pop(0).result()
                pending.extend(pool.submit(lambda i: function(items[i]), i) for i in islice(indices, 1))
                yield result
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def at_once(here: Callable[[], Here], there: Callable[[], There]) -> tuple[Here, There]:
    """Return what two functions return, the second called by a thread of its own meanwhile.

    Raises what they raise, of the first where both fail.
    """
    other: Future[There] = Future()

    def work() -> None:
        try:
            other.set_result(there())
        except BaseException as error:  # noqa: BLE001 - whatever it is, it belongs to the caller
            other.set_exception(error)

    thread = Thread(target=work)  # a pool of one takes twice as long to start
    thread.start()
    try:
        first = here()
    finally:
        thread.join()
    return first, other.result()


class Jobs(Generic[Out]):
    """``n`` jobs, each done once, by the first thread to take it; results come in order."""

    def __init__(self, n: int) -> None:
        self._next = itertools.count()
        self._results: list[Future[Out]] = [Future() for _ in range(n)]
        self._taken = 0

    def share_taken(self) -> float:
        """Return the share of the jobs whose results were taken and are done with, 0 to 1."""
        return self._taken / len(self._results)

    def work(self, do: Callable[[int], Out]) -> None:
        """Take jobs and do them with ``do(index)`` until none is left, or one fails."""
        while (index := next(self._next)) < len(self._results):
            result = self._results[index]
            if not result.set_running_or_notify_cancel():
                return
            try:
                result.set_result(do(index))
            except BaseException as error:  # noqa: BLE001 - whatever it is, it belongs to who takes the result
                result.set_exception(error)
                return

    def results(self) -> Iterator[Out]:
        """Yield the results in order as they come.

        Raises what a job raised, and :class:`concurrent.futures.CancelledError` after :meth:`cancel`.
        """
        for index in range(len(self._results)):
            yield self._results[index].result()
            self._results[index] = Future()  # lets go of what was taken
            self._taken += 1

    def cancel(self) -> None:
        """Have no thread begin another job."""
        for result in self._results:
            result.cancel()
