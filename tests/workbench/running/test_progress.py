"""Progress appears where somebody looks, and only for work that takes a while."""

import io
import re
import sys
import time
from contextlib import ExitStack
from types import ModuleType
from typing import Any

import pytest
from rich.console import Console

from endoct.base.compute.own_process import announce_compiling
from endoct.base.errors import EndoctError
from endoct.workbench.running.progress import (
    COMPILING,
    ConsoleStages,
    NotebookStages,
    SilentStages,
    Stages,
    progress_table,
    stages_for,
)
from endoct.workbench.running.scheduler import Compiling, _ReceivedStages


class ZMQInteractiveShell:
    """Named like the shell of a notebook's kernel."""


class DisplayHandle:
    """Notes what a notebook would display."""

    displayed: list[str] = []  # noqa: RUF012 - of all handles

    def display(self, data: dict[str, str], *, raw: bool) -> None:
        self.displayed.append(data["text/html"])

    def update(self, data: dict[str, str], *, raw: bool) -> None:
        self.displayed[-1] = data["text/html"]


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A process that believes to be a notebook's kernel; returns what is displayed in it."""
    ipython: Any = ModuleType("IPython")
    ipython.get_ipython = ZMQInteractiveShell
    ipython.display = ModuleType("IPython.display")
    ipython.display.DisplayHandle = DisplayHandle
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", ipython.display)
    monkeypatch.setattr(DisplayHandle, "displayed", [])
    return DisplayHandle.displayed


def work(stages: Stages) -> None:
    with stages.stage("survey") as advance:
        advance(0.5)
    with stages.stage("unroll"):
        pass


def terminal() -> tuple[io.StringIO, Console]:
    shown = io.StringIO()
    return shown, Console(file=shown, force_terminal=True, width=100)


def test_where_nobody_looks_nothing_is_displayed() -> None:
    assert type(stages_for(True)) is SilentStages
    assert type(stages_for(False)) is SilentStages
    own = SilentStages()
    assert stages_for(own) is own
    work(own)
    assert list(own.seconds) == ["survey", "unroll"]


def test_a_notebook_is_known(notebook: list[str]) -> None:
    assert type(stages_for(True)) is NotebookStages
    assert type(stages_for(False)) is SilentStages


def test_a_notebook_displays_one_table(notebook: list[str]) -> None:
    work(NotebookStages(0.0))
    (table,) = notebook
    assert table.count("<progress") == 2
    assert table.count("100%") == 2
    assert "<b>" not in progress_table({"<b>": 0.5})


def test_short_work_displays_nothing(notebook: list[str]) -> None:
    shown, console = terminal()
    work(ConsoleStages(console, 1000.0))
    work(NotebookStages(1000.0))
    assert shown.getvalue() == ""
    assert notebook == []


def test_a_terminal_displays_bars_once_the_work_has_taken_a_while() -> None:
    shown, console = terminal()
    with ConsoleStages(console, 0.01).stage("align"):  # which never says how far it is
        for _ in range(1000):
            if "align" in shown.getvalue():
                break
            time.sleep(0.01)
    assert "align" in shown.getvalue()


def test_a_log_never_goes_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(0, 10_000, 3))
    monkeypatch.setattr("endoct.workbench.running.progress.time.monotonic", lambda: float(next(clock)))
    log = io.StringIO()
    stages = ConsoleStages(Console(file=log, width=60))
    with stages.stage("survey A") as a:
        a(0.2)
        with stages.stage("survey B") as b:
            for share in (0.1, 0.5, 0.3, 0.9):  # threads may report out of order
                a(min(1.0, 0.3 + share))
                b(share)
        with stages.stage("unroll B") as b:
            b(0.1)
            b(0.2)
    lines = log.getvalue().splitlines()
    assert [line for line in lines if not line.startswith("after")] == ["survey A", "survey B", "unroll B"]
    progress = [re.fullmatch(r"after (\d+) s: (.*)", line) for line in lines if line.startswith("after")]
    assert len(progress) > 4
    seconds = [int(line[1]) for line in progress if line]
    assert seconds == sorted(seconds)
    last: dict[str, int] = {}
    for line in progress:
        stated = dict(re.findall(r"(\w+ [AB]) (\d+)%", line[2] if line else ""))
        assert "survey A" in stated  # every line says how far all are
        for title, share in stated.items():
            assert int(share) >= last.get(title, 0)
            last[title] = int(share)
    assert set(last) == {"survey A", "survey B", "unroll B"}


def test_whoever_waits_for_compiling_is_told_so_once(notebook: list[str]) -> None:
    shown = io.StringIO()
    with ConsoleStages(Console(file=shown)).stage("survey"):
        announce_compiling()
        announce_compiling()
    assert shown.getvalue().splitlines() == ["survey", COMPILING]
    stages = NotebookStages(quiet_s=0)
    announce_compiling()
    work(stages)
    assert COMPILING in notebook[-1]


def test_a_second_process_that_compiles_has_it_said_here() -> None:
    shown = io.StringIO()
    stages = ConsoleStages(Console(file=shown))
    with ExitStack() as open_stages:
        received = _ReceivedStages(stages, open_stages)
        received("survey B")
        received(Compiling())
    assert shown.getvalue().splitlines() == ["survey B", COMPILING]


@pytest.mark.parametrize("text", ["x", "0", "-1", "nan", "inf"])
def test_nonsense_in_the_environment_is_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("ENDOCT_PROGRESS_S", text)
    with pytest.raises(EndoctError, match="ENDOCT_PROGRESS_S cannot be used"):
        ConsoleStages(Console())
