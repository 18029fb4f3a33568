"""A program and what it starts end with the block that began it, and with the process that did."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import has_ended

from endoct.base.compute.worker_process import process_group

FAMILY = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(child.pid, flush=True)
time.sleep(600)
"""
BEGINNER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background commands ignore it
from endoct.base.compute.worker_process import process_group
with process_group([sys.executable, "-c", sys.argv[1]], stdout=sys.stdout.fileno()) as process:
    process.wait()
"""


def test_the_block_ends_the_program_and_its_children(tmp_path: Path) -> None:
    with (tmp_path / "said").open("w+b") as said:
        with process_group([sys.executable, "-c", FAMILY], stdout=said) as process:
            while not (text := (tmp_path / "said").read_text()):
                time.sleep(0.01)
        assert process.returncode == -signal.SIGKILL
    assert has_ended(int(text))


def test_what_has_ended_by_itself_has_its_own_status() -> None:
    with process_group([sys.executable, "-c", "raise SystemExit(5)"], stderr=subprocess.PIPE) as process:
        assert process.wait() == 5
    assert process.returncode == 5
    assert process.stderr is not None
    assert process.stderr.closed
    with pytest.raises(OSError, match="no-such"), process_group(["no-such-program"]):
        pass


def test_files_are_held_and_no_others() -> None:
    reading, writing = os.pipe()
    with process_group([sys.executable, "-c", "import time; time.sleep(600)"], holds=[writing]):
        os.close(writing)
        os.set_blocking(reading, False)
        with pytest.raises(BlockingIOError):  # the program holds the other end
            os.read(reading, 1)
    os.set_blocking(reading, True)
    assert os.read(reading, 1) == b""
    os.close(reading)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_process_that_is_ended_takes_its_programs_along(number: signal.Signals) -> None:
    command = [sys.executable, "-c", BEGINNER, FAMILY]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as beginner:
        assert beginner.stdout is not None
        child = int(beginner.stdout.readline())
        beginner.send_signal(number)
        beginner.wait()
    assert has_ended(child)
