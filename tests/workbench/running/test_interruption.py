"""An interrupt stops the work even where somebody swallowed it."""

import contextlib
import signal

import pytest
from rich.console import Console

from endoct.workbench.running import interruption
from endoct.workbench.running.progress import ConsoleStages


def test_a_swallowed_interrupt_stops_the_next_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interruption, "_interrupted", interruption.Event())
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interruption.watch()
    try:
        with ConsoleStages(Console(quiet=True)).stage("survey") as advance:
            advance(0.1)
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            with pytest.raises(KeyboardInterrupt):
                advance(0.2)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
