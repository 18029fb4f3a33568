"""A worker process gives what this one would, and is gone when it is no longer wanted."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from queue import Queue

import numpy as np
import pytest

from endoct.base.compute.worker_process import WorkerProcess, worker_process
from endoct.base.errors import EndoctError
from tests.base.compute.worker_calls import (
    count_to,
    divide,
    end,
    give_what_cannot_be_sent,
    identity_of,
    nest,
    odd,
    refuse,
    run_out_of_memory,
    sleep,
)


@pytest.fixture
def process() -> Iterator[WorkerProcess]:
    with worker_process() as process:
        yield process


def test_calls_are_answered_in_order_and_errors_end_nothing(process: WorkerProcess) -> None:
    messages: list[object] = []
    first, second = process.call(count_to, 3, on_message=messages.append), process.call(divide, 1, 0)
    third = process.call(divide, 1, 2)
    assert first.result() == 3
    assert messages == [0, 1, 2]
    with pytest.raises(RuntimeError, match=r"in divide[\s\S]*ZeroDivisionError"):
        second.result()
    assert third.result() == 0.5


def test_what_is_refused_there_is_told_in_the_same_line(process: WorkerProcess) -> None:
    with pytest.raises(EndoctError) as refused:
        process.call(refuse, "no recording").result()
    assert str(refused.value) == "no recording; found nothing; expected something; look again"


def test_memory_that_runs_out_there_runs_out_here(process: WorkerProcess) -> None:
    calls = [process.call(function) for function in (run_out_of_memory, nest, odd, give_what_cannot_be_sent)]
    for call, kind, words in zip(
        calls,
        (MemoryError, RecursionError, OSError, RuntimeError),
        ("Unable to allocate", "recursion", "1 2 3", "pickle"),
        strict=True,
    ):
        with pytest.raises(kind, match=words):
            call.result()
    assert process.call(divide, 1, 2).result() == 0.5  # it lives on


def test_what_is_stored_is_sent_once(process: WorkerProcess) -> None:
    array, other = (process.store(np.full(1000, value)) for value in (1.0, 2.0))
    calls = [process.call(identity_of, array) for _ in range(3)]
    assert len({call.result() for call in calls}) == 1
    np.testing.assert_array_equal(process.call(divide, array, other).result(), np.full(1000, 0.5))


def test_a_module_that_cannot_be_loaded_ends_nothing(process: WorkerProcess) -> None:
    process.preload("json", "endoct.no_such_module")
    assert process.call(divide, 1, 2).result() == 0.5


def test_a_process_that_ends_is_told_in_one_line(process: WorkerProcess) -> None:
    ended, after = process.call(end), process.call(divide, 1, 2)
    for call in (ended, after):
        with pytest.raises(EndoctError, match=r"has ended; found exit status 3"):
            call.result()


@pytest.mark.skipif(os.name != "posix", reason="asks for a process by a POSIX signal")
def test_a_busy_process_is_gone_at_once_with_the_context() -> None:
    running = Queue[object]()

    def interrupted() -> None:
        with worker_process() as process:
            process.call(sleep, on_message=running.put)
            running.put(running.get())  # it sleeps
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    number = running.get()
    assert isinstance(number, int)
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_the_script_of_the_caller_is_not_run_again(tmp_path: Path) -> None:
    # and what lies beside it under a library's name is not taken for the library
    (tmp_path / "script.py").write_text(
        "from endoct.base.compute.worker_process import worker_process\n"
        "from endoct.workbench.running.refusals import tame_libraries\n"
        "print('begins')\n"
        "with worker_process() as process:\n"
        "    process.preload('rich')\n"
        "    process.call(tame_libraries).result()\n"
    )
    (tmp_path / "rich.py").write_text("print('begins')\n")
    (tmp_path / "pickle.py").write_text("print('begins')\n")
    run = subprocess.run([sys.executable, "-P", "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout + run.stderr == "begins\n"
