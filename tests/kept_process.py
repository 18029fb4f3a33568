"""A second process for all commands of a test run: to start one and load its libraries takes as long as many a test."""

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from endoct.base.compute.worker_process import WorkerProcess, worker_process
from endoct.base.errors import EndoctError


class KeptProcess:
    """Lends one process to one command after the other, in the folder where each is.

    One that finds other surroundings than those the process was started in gets a new one, and so does who comes after
    one in whose hands it ended.
    """

    def __init__(self) -> None:
        self._started = ExitStack()
        self._process: WorkerProcess | None = None
        self._surroundings: object = None
        self._is_lent = False

    @contextmanager
    def lent(self) -> Iterator[WorkerProcess]:
        """Take the place of :func:`worker_process`."""
        if self._is_lent:
            with worker_process() as process:
                yield process
            return
        if self._process is None or self._surroundings != surroundings():
            self.end()
            self._process, self._surroundings = self._started.enter_context(worker_process()), surroundings()
        kept, self._process, self._is_lent = self._process, None, True
        try:
            # its own count of what it stores, so that this replaces what others stored
            lent = WorkerProcess(kept._process, kept._requests)
            lent.call(os.chdir, os.getcwd())  # noqa: PTH109
            yield lent
        finally:
            self._is_lent = False
            with suppress(EndoctError):  # it has ended
                kept.call(abs, 0).result()  # all is answered by then
                self._process = kept

    def end(self) -> None:
        """End the process."""
        self._started.close()
        self._process = None


def surroundings() -> object:
    """Return what a process has of the one that starts it, but for its folder."""
    variables = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    return variables, list(sys.path), [os.fstat(stream).st_ino for stream in (1, 2)]
