"""Progress of a command or a function, stage by stage: on a terminal, in a notebook, a log file, or nowhere.

In a notebook it is one small table under the cell, drawn anew as the work goes on. Where a Python function displays its
progress is up to :func:`stages_for`.
"""

import html
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from threading import Lock, Timer
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from endoct.base.compute.own_process import when_compiling
from endoct.base.errors import refusing, visible
from endoct.workbench.running.interruption import stop_if_interrupted

EVERY_S_NAME = "ENDOCT_PROGRESS_S"
"""The environment variable that says how often a line of progress is printed where there is no terminal."""

Advance = Callable[[float], None]
"""Called with the share done, 0 to 1."""


LINE_EVERY_S = 5.0
"""Where that says nothing."""
COMPILING = "compiling for the first use: up to half a minute, once"
QUIET_S = 2.0
"""Work that takes no longer shows no progress in Python."""


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

    def __init__(self, console: Console, quiet_s: float = 0.0) -> None:
        super().__init__()
        self._line_every_s = _line_every_s()
        self._console = console
        self._quiet_s = quiet_s
        self._begun: float | None = None
        self._bars: Progress | None = None  # a terminal displays one set of bars at a time
        self._open = 0
        self._logged: list[_LoggedStage] = []  # those that are open, where lines are printed
        self._printed = 0.0
        self._lock = Lock()
        when_compiling(lambda: self._print(COMPILING))

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
                if (now := time.monotonic()) - self._printed >= self._line_every_s:
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


class NotebookStages(SilentStages):
    """Displays a bar for each stage under the notebook's cell, once the work has taken ``quiet_s`` seconds.

    Needs nothing but IPython, which every notebook has. Stages may run at once, in several threads.
    """

    EVERY_S = 0.2

    def __init__(self, quiet_s: float) -> None:
        super().__init__()
        ipython: Any = import_module("IPython.display")  # which is there, since this is a notebook
        self._handle = ipython.DisplayHandle()
        self._on_page = False
        self._shares: dict[str, float] = {}
        self._next_s = time.monotonic() + quiet_s
        self._lock = Lock()
        self._note = ""
        when_compiling(self._say_compiling)

    def _say_compiling(self) -> None:
        self._note = COMPILING

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        def advance(share: float) -> None:
            with self._lock:
                self._shares[title] = share
                if time.monotonic() >= self._next_s:
                    self._draw()

        advance(0.0)
        yield advance
        advance(1.0)
        with self._lock:
            if self._on_page:
                self._draw()  # at once, since there may be no further stage

    def _draw(self) -> None:
        data = {
            "text/html": progress_table(self._shares, self._note),
            "text/plain": f"{sum(self._shares.values()):.2f} stages",
        }
        if self._on_page:
            self._handle.update(data, raw=True)
        else:
            self._handle.display(data, raw=True)
        self._on_page = True
        self._next_s = time.monotonic() + self.EVERY_S


def progress_table(shares: dict[str, float], note: str = "") -> str:
    """Return HTML of a bar for each title, filled to its share, 0 to 1, and of a ``note`` below them."""
    rows = "".join(
        f'<tr><td style="text-align:left">{html.escape(title)}</td>'
        f'<td><progress value="{share:.3f}" max="1"></progress></td><td>{share:.0%}</td></tr>'
        for title, share in shares.items()
    )
    return f"<table>{rows}</table>{html.escape(note)}"


def stages_for(progress: bool | Stages) -> Stages:
    """Return what a Python function that was called with ``progress`` reports its stages to.

    ``True`` displays work that takes longer than :data:`QUIET_S`, in a notebook or on a terminal; ``False`` nothing.
    """
    if not isinstance(progress, bool):
        return progress
    if progress and in_notebook():
        return NotebookStages(QUIET_S)
    console = Console(stderr=True)
    return ConsoleStages(console, QUIET_S) if progress and console.is_terminal else SilentStages()


def _line_every_s() -> float:
    """Return how often a line is printed. Raises :class:`EndoctError` where the environment says nonsense."""
    text = os.environ.get(EVERY_S_NAME, "")
    with refusing(f"{EVERY_S_NAME} cannot be used", expected="seconds, above zero", remedy="correct it, or unset it"):
        seconds = float(text) if text else LINE_EVERY_S
        if not 0 < seconds < float("inf"):
            raise ValueError(text)
    return seconds


def in_notebook() -> bool:
    """Say whether this is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"
