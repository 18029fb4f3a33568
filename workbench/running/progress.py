"""What the user sees while something takes longer than two seconds."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import Lock
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from endoct.stitching.errors import visible
from endoct.workbench.running.interruption import stop_if_asked

Advance = Callable[[float], None]
"""Called with the share done, 0 to 1."""


class Stages(Protocol):
    """Told which stage begins; times it and shows how far it is."""

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time of every finished stage by title, in the order they finished."""

    def stage(self, title: str) -> AbstractContextManager[Advance]:
        """Open a stage; the value it yields is called with the share done."""


class SilentStages:
    """Times the stages and shows nothing; the default of the Python interface."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, title: str) -> Iterator[Advance]:
        """Open a stage."""
        start = time.perf_counter()
        with self._shown(title) as advance:
            yield advance
        self.seconds[title] = self.seconds.get(title, 0.0) + time.perf_counter() - start

    @contextmanager
    def _shown(self, title: str) -> Iterator[Advance]:
        del title
        yield lambda _: None


class ConsoleStages(SilentStages):
    """Shows a bar for each stage on a terminal; elsewhere a line now and then, for a log file.

    Stages may run side by side, in threads.
    """

    LINE_EVERY_S = 5.0

    def __init__(self, console: Console) -> None:
        super().__init__()
        self._console = console
        self._bars: Progress | None = None  # there can be only one at a time
        self._open = 0
        self._opening = Lock()

    @contextmanager
    def _shown(self, title: str) -> Iterator[Advance]:
        stop_if_asked()
        if not self._console.is_terminal:
            yield self._lines(title)
            return
        with self._shared_bars() as bars:
            task = bars.add_task(visible(title), total=1.0)

            def advance(share: float) -> None:
                stop_if_asked()
                bars.update(task, completed=share)

            yield advance
            bars.update(task, completed=1.0)

    @contextmanager
    def _shared_bars(self) -> Iterator[Progress]:
        """Yield the bars of all stages that are open; they stay on the terminal when the last one ends."""
        with self._opening:
            if self._bars is None:
                self._bars = Progress(
                    TextColumn("{task.description:<28}", markup=False),
                    BarColumn(),
                    TaskProgressColumn(),
                    TimeElapsedColumn(),
                    TimeRemainingColumn(),
                    console=self._console,
                )
                self._bars.start()
            self._open += 1
            bars = self._bars
        try:
            yield bars
        finally:
            with self._opening:
                self._open -= 1
                if not self._open:
                    bars.stop()
                    self._bars = None

    def _lines(self, title: str) -> Advance:
        start = time.monotonic()
        said = start
        title = visible(title)
        self._console.print(title, highlight=False, markup=False, emoji=False)

        def advance(share: float) -> None:
            nonlocal said
            stop_if_asked()
            if (now := time.monotonic()) - said >= self.LINE_EVERY_S:
                said = now
                line = f"{title}: {share:.0%} after {now - start:.0f} s"
                self._console.print(line, highlight=False, markup=False, emoji=False)

        return advance
