"""Progress of a command or a function, stage by stage: on a terminal, in a log file, or not at all."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from threading import Lock, Timer
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from endoct.stitching.errors import visible
from endoct.workbench.running.interruption import stop_if_interrupted

Advance = Callable[[float], None]
"""Called with the share done, 0 to 1."""


class Stages(Protocol):
    """Times the stages of some work, and may display how far each is."""

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time of every finished stage by title, in the order they finished."""

    def stage(self, title: str) -> AbstractContextManager[Advance]:
        """Open a stage; the value it yields is called with the share done."""


class SilentStages:
    """Times the stages and displays nothing."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, title: str) -> Iterator[Advance]:
        """Open a stage."""
        start = time.perf_counter()
        with self._displayed(title) as advance:
            yield advance
        self.seconds[title] = self.seconds.get(title, 0.0) + time.perf_counter() - start

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        del title
        yield lambda _: None


@dataclass(eq=False)
class _LoggedStage:
    """A stage that is under way, and how much of it is done."""

    title: str
    share: float = 0.0


class ConsoleStages(SilentStages):
    """Displays a bar for each stage on a terminal; elsewhere prints a line now and then, for a log file.

    Bars appear ``quiet_s`` seconds after the first stage began. Stages may run at once, in several threads.
    """

    LINE_EVERY_S = 5.0

    def __init__(self, console: Console, quiet_s: float = 0.0) -> None:
        super().__init__()
        self._console = console
        self._quiet_s = quiet_s
        self._begun: float | None = None
        self._bars: Progress | None = None  # a terminal displays one set of bars at a time
        self._open = 0
        self._logged: list[_LoggedStage] = []  # those that are open, where lines are printed
        self._printed = 0.0
        self._lock = Lock()

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        stop_if_interrupted()
        if not self._console.is_terminal:
            with self._lines(visible(title)) as advance:
                yield advance
            return
        with self._shared_bars() as bars:
            task = bars.add_task(visible(title), total=1.0)

            def advance(share: float) -> None:
                stop_if_interrupted()
                bars.update(task, completed=share)

            yield advance
            bars.update(task, completed=1.0)

    @contextmanager
    def _shared_bars(self) -> Iterator[Progress]:
        """Yield the bars of all stages that are open; they stay on the terminal when the last one ends."""
        with self._lock:
            if self._bars is None:
                self._bars = Progress(
                    TextColumn("{task.description:<28}", markup=False),
                    BarColumn(),
                    TaskProgressColumn(),
                    TimeElapsedColumn(),
                    TimeRemainingColumn(),
                    console=self._console,
                )
                self._start_in_time(self._bars)
            self._open += 1
            bars = self._bars
        try:
            yield bars
        finally:
            with self._lock:
                self._open -= 1
                if not self._open:
                    if bars.live.is_started:
                        bars.stop()
                    self._bars = None

    def _start_in_time(self, bars: Progress) -> None:
        """Display ``bars`` now, or as soon as the work has taken long enough and they are still wanted."""
        now = time.monotonic()
        self._begun = now if self._begun is None else self._begun
        wait_s = self._begun + self._quiet_s - now
        if wait_s <= 0:
            bars.start()
            return

        def start() -> None:
            with self._lock:
                if self._bars is bars:
                    bars.start()

        timer = Timer(wait_s, start)
        timer.daemon = True
        timer.start()

    @contextmanager
    def _lines(self, title: str) -> Iterator[Advance]:
        """Print the title, then now and then one line that says how far all open stages are; none goes backwards."""
        stage = _LoggedStage(title)
        with self._lock:
            now = time.monotonic()
            self._begun = begun = now if self._begun is None else self._begun
            self._printed = self._printed if self._logged else now
            self._logged.append(stage)
            self._print(title)

        def advance(share: float) -> None:
            stop_if_interrupted()
            with self._lock:
                stage.share = max(stage.share, share)
                if (now := time.monotonic()) - self._printed >= self.LINE_EVERY_S:
                    self._printed = now
                    every = ", ".join(f"{one.title} {one.share:.0%}" for one in self._logged)
                    self._print(f"after {now - begun:.0f} s: {every}")

        try:
            yield advance
        finally:
            with self._lock:
                self._logged.remove(stage)

    def _print(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
