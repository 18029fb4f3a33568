"""A process beside this one gives what this one would, and is gone when it is no longer wanted."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from queue import Queue

import numpy as np
import pytest
from calls_beside import (
    count_to,
    divide,
    end,
    give_what_cannot_be_sent,
    nest,
    odd,
    refuse,
    run_out_of_memory,
    sleep,
)

from endoct.stitching.errors import EndoctError
from endoct.workbench.pipeline.side_by_side import unroll_both
from endoct.workbench.pipeline.unrolling import open_side
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.running.worker import Beside, process_beside


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)


@pytest.fixture
def beside() -> Iterator[Beside]:
    with process_beside() as beside:
        assert beside is not None
        yield beside


def test_two_recordings_unroll_as_one_by_one(short: Path, beside: Beside) -> None:
    # of one and the same recording, one copy is unrolled here and the other one there
    opened = open_side(short / "oct", modality=None, settings={})
    stages = SilentStages()
    here, there = (made.panorama for made in unroll_both(opened, opened, stages, beside))
    assert {f"{step} {side} oct" for step in ("survey", "unroll", "settle") for side in "AB"} == set(stages.seconds)
    for name in ("intensity", "depth_mm", "valid", "weight", "z_mm"):
        assert getattr(here, name).tobytes() == getattr(there, name).tobytes(), name
    assert here.per_frame.keys() == there.per_frame.keys()
    assert all(here.per_frame[name].tobytes() == there.per_frame[name].tobytes() for name in here.per_frame)
    assert here.provenance == there.provenance


def test_what_cannot_be_used_is_told_in_the_same_line(tmp_path: Path, short: Path, beside: Beside) -> None:
    (tmp_path / "acquisition.toml").write_text((short / "oct" / "acquisition.toml").read_text())
    np.save(tmp_path / "pullback.npy", np.random.default_rng(0).integers(90, 110, (5, 300, 256), dtype=np.uint8))
    unusable = open_side(tmp_path, modality=None, settings={})
    with pytest.raises(EndoctError) as one_by_one:
        unroll_both(unusable, unusable, SilentStages(), None)
    with pytest.raises(EndoctError) as alone:
        beside.call(refuse, "no recording").result()
    assert str(alone.value) == "no recording; found nothing; expected something; look again"
    with pytest.raises(EndoctError) as at_once:
        unroll_both(unusable, unusable, SilentStages(), beside)
    assert str(at_once.value) == str(one_by_one.value)


def test_calls_are_answered_in_order_and_errors_end_nothing(beside: Beside) -> None:
    heard: list[object] = []
    first, second = beside.call(count_to, 3, heard=heard.append), beside.call(divide, 1, 0)
    third = beside.call(divide, 1, 2)
    assert first.result() == 3
    assert heard == [0, 1, 2]
    with pytest.raises(RuntimeError, match=r"in divide[\s\S]*ZeroDivisionError"):
        second.result()
    assert third.result() == 0.5


def test_memory_that_runs_out_there_runs_out_here(beside: Beside) -> None:
    calls = [beside.call(function) for function in (run_out_of_memory, nest, odd, give_what_cannot_be_sent)]
    for call, kind, words in zip(
        calls,
        (MemoryError, RecursionError, OSError, RuntimeError),
        ("Unable to allocate", "recursion", "1 2 3", "pickle"),
        strict=True,
    ):
        with pytest.raises(kind, match=words):
            call.result()
    assert beside.call(divide, 1, 2).result() == 0.5  # it lives on


def test_a_process_that_ends_is_told_in_one_line(beside: Beside) -> None:
    with pytest.raises(EndoctError, match=r"has ended; found exit status 3"):
        beside.call(end).result()


@pytest.mark.skipif(os.name != "posix", reason="asks for a process by a POSIX signal")
def test_a_busy_process_is_gone_at_once_with_the_context() -> None:
    running = Queue[int]()

    def interrupted() -> None:
        with process_beside() as beside:
            assert beside is not None
            beside.call(sleep, heard=running.put)
            running.put(running.get())  # it sleeps
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with pytest.raises(ProcessLookupError):
        os.kill(running.get(), 0)


def test_one_processor_gets_no_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    with process_beside() as beside:
        assert beside is None


def test_a_script_that_compares_is_not_run_again(tmp_path: Path) -> None:
    # and what lies beside it under a library's name is not taken for the library
    (tmp_path / "script.py").write_text(
        "from endoct.workbench.running.worker import load, process_beside\n"
        "print('begins')\n"
        "with process_beside() as beside:\n"
        "    beside is None or beside.call(load, 'endoct.workbench.running.progress').result()\n"
    )
    (tmp_path / "rich.py").write_text("print('begins')\n")
    run = subprocess.run([sys.executable, "-P", "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout + run.stderr == "begins\n"
