"""An interrupt stops the work even where somebody swallowed it."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import has_ended
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
            for number in (signal.SIGINT, signal.SIGTERM):  # what the first one has undone is not cut short
                signal.raise_signal(number)
            with pytest.raises(KeyboardInterrupt):
                advance(0.2)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


BUSY = {
    "a library that computes": "hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)",
    "threads that are waited for": "list(thread_map(time.sleep, [600, 600], 2))",
    "a finalizer": "Noted()",
    "a pipe that nobody reads": "print('x' * 10_000_000)",
}
"""What a command is at, by Python that does it and does not end by itself."""

COMMAND = """
import hashlib, os, sys, time
from pathlib import Path
from endoct.base.compute.parallel import thread_map
from endoct.base.files.scratch import TemporaryFolder, scratch_next_to
from endoct.base.compute.worker_process import worker_process
from endoct.workbench import cli

class Noted:
    def __del__(self):
        begun()
        time.sleep(600)

def begun():
    Path("begun").touch()

def run():
    with TemporaryFolder("busy"), scratch_next_to(Path("out/place")) as scratch, worker_process() as process:
        (scratch / "half").write_text("written")
        process.call(time.sleep, 600)
        Path("worker").write_text(str(process._process.pid))
        if not {finalizer}:
            begun()
        {busy}
        time.sleep(600)

cli._run = run
cli.main()
"""


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("busy", BUSY)
def test_a_command_ends_whatever_it_is_at_and_leaves_nothing(busy: str, number: signal.Signals, tmp_path: Path) -> None:
    run = COMMAND.format(busy=BUSY[busy], finalizer=busy == "a finalizer")
    (tmp_path / "temporary").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", run],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        env=os.environ | {"TMPDIR": str(tmp_path / "temporary")},
    )
    while not (tmp_path / "begun").exists():
        time.sleep(0.02)
        assert process.poll() is None
    process.send_signal(number)
    status = process.wait(timeout=60)  # of which two seconds are to be enough
    _, said = process.communicate()
    assert status == 130
    assert said.decode() == "endoct: interrupted; nothing was left half-written\n"
    assert not list((tmp_path / "out").iterdir())
    assert not list((tmp_path / "temporary").iterdir())
    worker = int((tmp_path / "worker").read_text())
    assert has_ended(worker)


def test_a_signal_after_a_command_is_nobodys_business() -> None:
    ended: list[bool] = []
    with interruption.ending_in_time(lambda: ended.append(True)):
        pass
    assert signal.set_wakeup_fd(-1) == -1
    assert not ended


@pytest.mark.parametrize(("came", "ends"), [((signal.SIGCHLD, signal.SIGINT), True), ((signal.SIGCHLD,), False)])
def test_an_interrupt_behind_another_signal_ends_the_process(
    came: tuple[int, ...], ends: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interruption, "PATIENCE_S", 0)
    monkeypatch.setattr(interruption, "undo_all", lambda: done.append("undone"))
    done: list[str] = []
    reading, writing = socket.socketpair()
    with writing:
        writing.send(bytes(came))
    interruption._end_after_signal(reading, lambda: done.append("ended"))
    assert done == ["undone", "ended"] * ends
