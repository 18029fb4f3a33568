"""Processes that end with this one: any program with all that it starts, and one that calls functions for this one.

The latter is for work on small arrays, for which threads of one process wait for one another. It is a program of its
own. A fork is unsafe while threads run, and a child of ``multiprocessing`` would run the script
of a caller of the Python interface again. It starts before there is work for it, so that it is ready by then. While a
call is running it sends messages, so that progress can be shown. It is killed with its context, whatever it is doing.

Why not loky (3.7, measured on two cores)? It does without a fork and without the caller's script as well, but:

- it passes arrays of 10 and 100 MB in twice the time, and is ready after 0.26 s instead of 0.12 s;
- it looks for its own libraries in the working folder first;
- it breaks the pool where an error cannot be unpickled;
- it has no messages from a running call. Those, the errors and the end of the process would still be handled here.
"""

import contextlib
import itertools
import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import IO, Any, TypeVar

from endoct.base.compute.own_process import settle_in, undone_in_the_end
from endoct.base.errors import EndoctError

_GUARD = "read _; kill -s INT -- -$0; sleep 5; kill -s KILL -- -$0"
"""Waits on a pipe that only this process holds, so it goes on as soon as this process has ended, in whatever way."""
OUT_OF_MEMORY = 12
"""Exit status of a process that had no memory for a request."""

Send = Callable[[object], None]
"""Sends a message from a function that is running in the process to the ``on_message`` of its call."""

Out = TypeVar("Out")


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


@dataclass(frozen=True)
class Stored:
    """Stands for a value that the process holds already; only as an argument of calls of the same process."""

    key: int


class WorkerProcess:
    """Calls functions in another process, in the order of the calls; made by :func:`worker_process`.

    Functions are those of modules; arguments, results and messages are all that can be pickled.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", requests: ThreadPoolExecutor) -> None:
        self._process, self._requests, self._keys = process, requests, itertools.count()

    def call(self, function: Callable[..., Out], *arguments: object, on_message: Send | None = None) -> "Future[Out]":
        """Have the process call ``function(*arguments)``; return at once.

        Where ``on_message`` is given, the function takes a :data:`Send` as its first argument. Then ``on_message`` is
        called with each message, by another thread than this one. The result raises what the function raised:
        ``MemoryError``, ``RecursionError``, ``OSError`` and :class:`EndoctError` as they are, others as
        ``RuntimeError`` with the trace. It raises :class:`EndoctError` where the process has ended.
        """
        return self._requests.submit(self._answer, (function, arguments, on_message is not None), on_message)

    def preload(self, *modules: str) -> None:
        """Have the process import modules while there is no work for it."""
        for module in modules:
            self.call(import_module, module)

    def store(self, value: object) -> Stored:
        """Send ``value`` to the process once, for several calls; return what stands for it among their arguments."""
        stored = Stored(next(self._keys))
        self._requests.submit(self._answer, (None, (stored, value), False), None)
        return stored

    def _answer(self, request: tuple[object, ...], on_message: Send | None) -> Any:
        requests, answers = _open(self._process.stdin), _open(self._process.stdout)
        try:
            pickle.dump(request, requests, protocol=5)
            requests.flush()
            kind, content = pickle.load(answers)
            while kind == "message" and on_message is not None:
                on_message(content)
                kind, content = pickle.load(answers)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            status = self._process.wait()
            if status == OUT_OF_MEMORY:
                raise MemoryError("in a worker process") from error
            raise EndoctError(
                "a worker process has ended",
                found=f"exit status {status}",
                remedy="see whether memory ran out, and run it again",
            ) from error
        if kind == "error":
            raise content
        return content


@contextmanager
def worker_process() -> Iterator[WorkerProcess]:
    """Start a process that waits for calls; it is killed when the context is left, whatever it is doing."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    # -P: what lies in the working folder is not imported in place of a library
    command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
    with undone_in_the_end(process.kill), ThreadPoolExecutor(1) as requests:
        try:
            yield WorkerProcess(process, requests)
        finally:
            process.kill()  # first, so that nobody waits for an answer
            requests.shutdown(wait=True, cancel_futures=True)
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):  # what was still to be sent
                    _open(stream).close()
            process.wait()


def serve() -> None:
    """Answer the calls of the parent process until it closes its end or has ended."""
    settle_in()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller is interrupted as well, and ends this process
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    one_at_a_time = Lock()
    stored: dict[Stored, object] = {}

    def send(packed: bytes) -> None:
        with one_at_a_time:
            answers.write(packed)
            answers.flush()

    def send_message(content: object) -> None:
        send(pickle.dumps(("message", content), protocol=5))

    def result_of(function: Callable[..., object] | None, arguments: tuple[Any, ...], sends: bool) -> object:
        if function is None:
            key, stored[key] = arguments
            return None
        values = [stored[one] if isinstance(one, Stored) else one for one in arguments]
        return function(send_message, *values) if sends else function(*values)

    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            try:
                request = pickle.load(sys.stdin.buffer)
            except MemoryError:
                sys.exit(OUT_OF_MEMORY)  # nobody knows how much of the request is still to come
            try:
                packed = pickle.dumps(("result", result_of(*request)), protocol=5)
            except BrokenPipeError:
                raise
            except Exception as error:  # noqa: BLE001 - the caller raises it
                packed = pickle.dumps(("error", _portable(error)), protocol=5)
            send(packed)
            del packed, request


def _portable(error: Exception) -> Exception:
    """Return an error that can be pickled: not every exception can, and what cannot is sent as its trace."""
    if isinstance(error, EndoctError):
        return error
    for kind in (MemoryError, RecursionError):  # numpy has a kind of its own
        if isinstance(error, kind):
            return kind(str(error))
    if isinstance(error, OSError):
        return OSError(str(error)) if error.errno is None else OSError(error.errno, error.strerror, error.filename)
    return RuntimeError("".join(traceback.format_exception(error)))


def _open(stream: IO[bytes] | None) -> IO[bytes]:
    if stream is None:
        raise ValueError("a worker process needs pipes")
    return stream
