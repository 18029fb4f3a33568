"""Progress in a notebook: one small table under the cell, drawn anew as the work goes on."""

import html
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
from typing import Any

from endoct.workbench.running.progress import Advance, SilentStages


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
        data = {"text/html": progress_table(self._shares), "text/plain": f"{sum(self._shares.values()):.2f} stages"}
        if self._on_page:
            self._handle.update(data, raw=True)
        else:
            self._handle.display(data, raw=True)
        self._on_page = True
        self._next_s = time.monotonic() + self.EVERY_S


def progress_table(shares: dict[str, float]) -> str:
    """Return HTML of a bar for each title, filled to its share, 0 to 1."""
    rows = "".join(
        f'<tr><td style="text-align:left">{html.escape(title)}</td>'
        f'<td><progress value="{share:.3f}" max="1"></progress></td><td>{share:.0%}</td></tr>'
        for title, share in shares.items()
    )
    return f"<table>{rows}</table>"
