"""How long something takes and how much memory, in a process of its own: what ran before takes no part in it.

Not by a child of this process: on Linux the largest resident set of a program begins with that of the process which
started it.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from endoct.base.compute.worker_process import process_group, worker_process
from endoct.base.errors import EndoctError
from endoct.workbench.running.scheduler import one_blas_thread

Out = TypeVar("Out")


@dataclass(frozen=True)
class Measured(Generic[Out]):
    """What a function returned, and what it took.

    Attributes: ``answer``; ``seconds`` of the clock and ``cpu_seconds`` of all processors, one a run; ``peak_mb``, the
    largest resident set of the process, with its libraries and what the function was given, 10⁶ bytes; NaN where the
    system does not say.
    """

    answer: Out
    seconds: tuple[float, ...]
    cpu_seconds: tuple[float, ...]
    peak_mb: float


def measure_calls(function: Callable[..., Out], *arguments: object, repeats: int = 1) -> Measured[Out]:
    """Call a module's function once, untimed, and then ``repeats`` times in one process; return the last answer.

    What a library loads or compiles when it is first used is in no run. Raises whatever the function raises as
    :meth:`~endoct.base.compute.worker_process.WorkerProcess.call` does.
    """
    with worker_process() as process:
        return process.call(_calls, function, arguments, repeats).result()


def measure_program(command: Sequence[str], answer: Out, *, repeats: int = 1) -> Measured[Out]:
    """Run a program ``repeats`` times, each from its start to its end; ``answer`` is where it leaves its own.

    Raises :class:`EndoctError` where it fails.
    """
    with worker_process() as process:
        runs = [process.call(_program, tuple(command)).result() for _ in range(repeats)]
    seconds, cpu_seconds, peak_mb = zip(*runs, strict=True)
    return Measured(answer, seconds, cpu_seconds, max(peak_mb))


def endoct_command(*arguments: str) -> tuple[str, ...]:
    """Return the command that runs `endoct` with ``arguments``, with this interpreter."""
    return sys.executable, "-P", "-c", "from endoct.workbench.cli import main; main()", *arguments


@one_blas_thread()
def _calls(function: Callable[..., Out], arguments: tuple[object, ...], repeats: int) -> Measured[Out]:
    answer = function(*arguments)
    seconds, cpu_seconds = [], []
    for _ in range(repeats):
        start, cpu_start = time.perf_counter(), time.process_time()
        answer = function(*arguments)
        seconds.append(time.perf_counter() - start)
        cpu_seconds.append(time.process_time() - cpu_start)
    return Measured(answer, tuple(seconds), tuple(cpu_seconds), _own_peak_mb())


def _program(command: tuple[str, ...]) -> tuple[float, float, float]:
    """Run a program; return seconds of the clock and of all processors, and its largest resident set, MB."""
    start = time.perf_counter()
    with ExitStack() as stack:
        ignoring = signal.signal(signal.SIGINT, signal.SIG_DFL)  # so that the program can be interrupted
        try:
            process = stack.enter_context(process_group(command, stderr=subprocess.PIPE))
        finally:
            signal.signal(signal.SIGINT, ignoring)
        if process.stderr is None:
            raise ValueError("a pipe was asked for")
        said = process.stderr.read().decode(errors="replace")
        if not hasattr(os, "wait4"):
            process.wait()
            cpu_seconds = peak_mb = float("nan")
        else:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            cpu_seconds, peak_mb = usage.ru_utime + usage.ru_stime, _in_mb(usage.ru_maxrss)
        seconds = time.perf_counter() - start
    if process.returncode:
        raise EndoctError("a program that was to be measured failed", found=said.strip()[-300:] or " ".join(command))
    return seconds, cpu_seconds, peak_mb


def _own_peak_mb() -> float:
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        lines = []
    for line in lines:
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return float("nan")
    return _in_mb(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def _in_mb(resident: int) -> float:
    return resident * (1 if sys.platform == "darwin" else 1024) / 1e6
