"""Seconds and memory of what runs in a process of its own."""

import sys

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.running.measured import endoct_command, measure_calls, measure_program

MB = 1_000_000


def _filled(n_mb: int) -> int:
    return int(np.ones(n_mb * MB, np.uint8)[::4096].size)


def test_memory_is_that_of_the_function_alone() -> None:
    held_here = np.ones(400 * MB, np.uint8)
    small, large = (measure_calls(_filled, n_mb, repeats=3) for n_mb in (1, 300))
    assert small.peak_mb < 300 < large.peak_mb < small.peak_mb + 400
    assert large.answer == -(-300 * MB // 4096)
    assert len(large.seconds) == len(large.cpu_seconds) == 3
    program = measure_program([sys.executable, "-c", "pass"], "there", repeats=2)
    assert program.peak_mb < held_here.nbytes / MB / 2
    assert (program.answer, len(program.seconds)) == ("there", 2)


def test_what_a_function_or_a_program_raises_is_raised_here() -> None:
    with pytest.raises(RuntimeError, match="invalid literal"):
        measure_calls(int, "three")
    with pytest.raises(EndoctError, match=r"a program that was to be measured failed; found .*does not exist"):
        measure_program(endoct_command("info", "nowhere"), None)
