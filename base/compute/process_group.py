"""Another program with all that it starts: it ends with the block that began it, and with this process."""

import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO

from endoct.base.compute.own_process import undone_in_the_end

_GUARD = "read _; kill -s INT -- -$0; sleep 5; kill -s KILL -- -$0"
"""Waits on a pipe that only this process holds, so it goes on as soon as this process has ended, in whatever way."""


@contextmanager
def process_group(
    command: Sequence[str],
    *,
    stdout: int | IO[bytes] = subprocess.DEVNULL,
    stderr: int | IO[bytes] = subprocess.DEVNULL,
    cwd: Path | None = None,
    env: dict[str, str] | None = None,
    holds: Sequence[int] = (),
) -> Iterator["subprocess.Popen[bytes]"]:
    """Yield a program that runs ``command`` in a group of its own; the group is killed when the block is left.

    Where this process is killed, the group is interrupted, and killed five seconds later. ``holds``: files of this
    process that stay open in the program. Raises ``OSError`` where it cannot be started. Elsewhere than on POSIX only
    the program itself is ended, by the block.
    """
    posix = os.name == "posix"
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, cwd=cwd, env=env,
        start_new_session=posix, pass_fds=holds if posix else (),
    )  # fmt: skip

    def end() -> None:
        with suppress(OSError):  # all have ended
            os.killpg(process.pid, signal.SIGKILL) if posix else process.kill()

    with process, undone_in_the_end(end):  # the former closes its pipes
        try:
            with _guarded(process.pid) if posix else nullcontext():
                yield process
        finally:
            end()
            process.wait()


@contextmanager
def _guarded(group: int) -> Iterator[None]:
    """Have a process group interrupted and killed where this process ends within the block."""
    guard = subprocess.Popen(
        ["/bin/sh", "-c", _GUARD, str(group)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield
    finally:
        guard.kill()
        guard.communicate()
