"""What is done at the same time: a second process works while this one goes on.

It unrolls the other recording, stores the sides, draws figures, and finds the second side's pose; this process aligns,
scores and writes. Without a second process everything is done here, one step after the other, with the same results.

For linear algebra one thread will do: the matrices here are small, and threads that wait for each other only burn time.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from threading import Event
from typing import Any, Generic, TypeVar

from threadpoolctl import threadpool_limits

from endoct.base.compute.own_process import announce_compiling, when_compiling
from endoct.base.compute.worker_process import Send, Stored, WorkerProcess, worker_process
from endoct.workbench.running.progress import Advance, SilentStages, Stages
from endoct.workbench.running.refusals import tame_libraries

Out = TypeVar("Out")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Named:
    """A function as "module:function": only the process that calls it loads its module."""

    name: str

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        module, _, function = self.name.partition(":")
        return getattr(import_module(module), function)(*arguments)


@dataclass(frozen=True, eq=False)
class PendingCall(Generic[Out]):
    """A call that the second process makes while this one goes on; ``there`` is None where there is none."""

    here: Callable[[], Out]
    there: Future[Out] | None

    def result(self, meanwhile: Sequence[str] = ()) -> Out:
        """Return what the call gives once it is done; modules named in ``meanwhile`` are loaded while it is not."""
        if self.there is None:
            return self.here()
        for module in meanwhile:
            import_module(module)
        return self.there.result()

    def result_of_either(self) -> Out:
        """Return the same; where the second process has not come to it, the call is made here."""
        return self.here() if self.there is None or self.there.cancel() else self.there.result()


@dataclass(frozen=True, eq=False)
class Sent(Generic[Value]):
    """A value for several tasks, which the second process gets once."""

    value: Value
    there: Stored | None


@dataclass(frozen=True, eq=False)
class Spread(Generic[Value]):
    """Values of which this process works on the first, and the second process on the others."""

    scheduler: "Scheduler"
    first: Value
    others: tuple[Sent[Value], ...]

    def map(self, function: Callable[..., Out], *more: object) -> list[Out]:
        """Return ``function(value, *more)`` of every value, the same with and without a second process."""
        tasks = [self.scheduler.begin(function, other, *more) for other in self.others]
        return [function(self.first, *more), *(task.result() for task in tasks)]


@dataclass(frozen=True, eq=False)
class Scheduler:
    """Has the second process work, one call after the other in their order; ``process`` is None where there is none."""

    process: WorkerProcess | None = None

    def load(self, *modules: str) -> None:
        """Have the second process load modules while there is no work for it."""
        if self.process is not None:
            self.process.preload(*modules)

    def begin(self, function: Callable[..., Out], *arguments: object) -> PendingCall[Out]:
        """Have ``function``, of a module, called with ``arguments``, of which some may be :class:`Sent` already."""
        here = partial(function, *(given.value if isinstance(given, Sent) else given for given in arguments))
        if self.process is None:
            return PendingCall(here, None)
        sent = (given.there if isinstance(given, Sent) else given for given in arguments)
        return PendingCall(here, self.process.call(function, *sent))

    def send(self, value: Value) -> Sent[Value]:
        """Send a value to the second process, for several tasks."""
        return Sent(value, None if self.process is None else self.process.store(value))

    def spread(self, values: Sequence[Value]) -> Spread[Value]:
        """Return ``values``, at least one, of which the second process has all but the first."""
        return Spread(self, values[0], tuple(self.send(value) for value in values[1:]))

    @contextmanager
    def begun_in_stages(
        self, stages: Stages, function: Callable[..., Out], *arguments: object
    ) -> Iterator[PendingCall[Out]]:
        """Have ``function(*arguments, stages)`` called; its stages are displayed among ``stages``.

        One that is open when the context is left ends with it.
        """
        here = partial(function, *arguments, stages)
        if self.process is None:
            yield PendingCall(here, None)
            return
        with ExitStack() as open_stages:
            received = _ReceivedStages(stages, open_stages)
            yield PendingCall(here, self.process.call(_call_in_stages, function, *arguments, on_message=received))


ALONE = Scheduler()
"""This scheduler has no second process."""


@contextmanager
def scheduler(*, needed: bool = True) -> Iterator[Scheduler]:
    """Start a second process where it is ``needed``; on a computer with one processor it would be no help."""
    if not needed or (os.cpu_count() or 1) < 2:
        yield ALONE
        return
    with worker_process() as process:
        process.call(tame_libraries)
        yield Scheduler(process)


@contextmanager
def in_background(function: Callable[[Callable[[], None]], Out]) -> Iterator[Future[Out]]:
    """Have a thread call ``function`` with what it has to call now and then: that ends it when the context is left."""
    left = Event()

    def stop_if_left() -> None:
        if left.is_set():
            raise CancelledError

    with ThreadPoolExecutor(1) as pool:
        try:
            yield pool.submit(function, stop_if_left)
        finally:
            left.set()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, as a context or a decorator: less processor time, and sums in one order.

    Solving for a catheter's uneven turns took some seven times the processor time with two threads.
    """
    with threadpool_limits(1, user_api="blas"):
        yield


def _call_in_stages(send: Send, function: Callable[..., Out], *arguments: object) -> Out:
    when_compiling(lambda: send(Compiling()))
    return function(*arguments, _SentStages(send))


class Compiling:
    """Sent by a second process that compiles much."""


class _SentStages(SilentStages):
    """Sends which stage begins (its title), how much of it is done (a share), and that it ends (None)."""

    def __init__(self, send: Send) -> None:
        super().__init__()
        self._send = send

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        self._send(title)
        yield self._send
        self._send(None)


class _ReceivedStages:
    """Opens the stages of :class:`_SentStages` among ``stages``; one that is open ends with ``open_stages``."""

    def __init__(self, stages: Stages, open_stages: ExitStack) -> None:
        self._stages, self._open_stages = stages, open_stages

    def __call__(self, message: object) -> None:
        if isinstance(message, str):
            self._advance = self._open_stages.enter_context(self._stages.stage(message))
        elif isinstance(message, float):
            self._advance(message)
        elif isinstance(message, Compiling):
            announce_compiling()
        else:
            self._open_stages.close()
