"""Work that several threads, or the processes they speak for, take from one list."""

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Generic, TypeVar

Out = TypeVar("Out")


class Shared(Generic[Out]):
    """``n`` jobs, each done once by whoever asks next; the results come in order, no matter who did them."""

    def __init__(self, n: int) -> None:
        self._waiting = itertools.count()
        self._done: list[Future[Out]] = [Future() for _ in range(n)]

    def serve(self, do: Callable[[int], Out]) -> None:
        """Do jobs with ``do(index)`` until none is waiting, or one fails, which its taker is told."""
        while (index := next(self._waiting)) < len(self._done):
            done = self._done[index]
            if not done.set_running_or_notify_cancel():
                return
            try:
                done.set_result(do(index))
            except BaseException as error:  # noqa: BLE001 - whatever it is, it belongs to who takes the result
                done.set_exception(error)
                return

    def results(self) -> Iterator[Out]:
        """Yield the results in order as they come; raise what a job raised, and CancelledError after :meth:`stop`."""
        for index in range(len(self._done)):
            yield self._done[index].result()
            self._done[index] = Future()  # lets go of what was taken

    def stop(self) -> None:
        """Have nobody begin another job."""
        for done in self._done:
            done.cancel()
