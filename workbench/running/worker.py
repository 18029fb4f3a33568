"""A second process that works beside this one: threads of one process wait for one another wherever arrays are small.

It is a program of its own, not a fork, which is unsafe beside threads, and no child of `multiprocessing`, which would
run the script of whoever calls the Python interface again.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
from typing import IO, Any

from endoct.stitching.errors import EndoctError
from endoct.workbench.running.refusals import tame_libraries

OUT_OF_MEMORY = 12
"""Exit status of a process that could not even take what it was asked."""

Tell = Callable[[object], None]
"""Called by a function in the other process with what this one is to hear before there is an answer."""


class Beside:
    """A process that calls functions, one after another, in the order in which it is asked to."""

    def __init__(self, process: "subprocess.Popen[bytes]", asking: ThreadPoolExecutor) -> None:
        self._process, self._asking = process, asking

    def call(self, function: Callable[..., Any], *arguments: Any, heard: Tell = lambda _: None) -> "Future[Any]":
        """Have the process call ``function``, of a module, with a :data:`Tell` and ``arguments``, all picklable.

        ``heard`` is called with what the function tells. The answer raises what the function raised, and
        :class:`EndoctError` where the process is no more; ``MemoryError`` where memory ran out in either.
        """
        return self._asking.submit(self._answer, function, arguments, heard)

    def _answer(self, function: Callable[..., Any], arguments: tuple[Any, ...], heard: Tell) -> Any:
        requests, answers = _stream(self._process.stdin), _stream(self._process.stdout)
        try:
            pickle.dump((function, arguments), requests, protocol=5)
            requests.flush()
            kind, what = pickle.load(answers)
            while kind == "told":
                heard(what)
                kind, what = pickle.load(answers)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            status = self._process.wait()
            if status == OUT_OF_MEMORY:
                raise MemoryError("in a process that shares the work") from error
            raise EndoctError(
                "a process that shares the work has ended",
                found=f"exit status {status}",
                remedy="see whether memory ran out, and run it again",
            ) from error
        if kind == "raised":
            raise what
        return what


@contextmanager
def process_beside() -> Iterator[Beside | None]:
    """Start a process that waits to be asked; it is gone when the context is left, whatever it was doing.

    None on a computer with one processor, where a second process would be no help.
    """
    if (os.cpu_count() or 1) < 2:
        yield None
        return
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    # -P: what lies in the working folder is not imported instead of a library
    command = [sys.executable, "-P", "-m", __name__]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
    with ThreadPoolExecutor(1) as asking:
        try:
            yield Beside(process, asking)
        finally:
            process.kill()  # first, so that nobody waits for an answer
            asking.shutdown(wait=True, cancel_futures=True)
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):  # what it can no longer be told
                    _stream(stream).close()
            process.wait()


def load(tell: Tell, module: str) -> None:
    """Import ``module`` there, while there is nothing else to do."""
    del tell
    import_module(module)


def _portable(error: Exception) -> Exception:
    """Return an error that can be sent; not every exception can be pickled, and what cannot comes with its trace."""
    if isinstance(error, EndoctError):
        return error
    for kind in (MemoryError, RecursionError):  # numpy has a kind of its own
        if isinstance(error, kind):
            return kind(str(error))
    if isinstance(error, OSError):
        told = error.errno, error.strerror, error.filename
        return OSError(str(error)) if error.errno is None else OSError(*told)
    return RuntimeError("".join(traceback.format_exception(error)))


def _stream(stream: IO[bytes] | None) -> IO[bytes]:
    if stream is None:
        raise ValueError("a process without pipes can be asked nothing")
    return stream


def main() -> None:
    """Serve one caller until it closes its end or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller is interrupted as well, and ends this process
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    one_at_a_time = Lock()

    def say(kind: str, what: object) -> None:
        send(pickle.dumps((kind, what), protocol=5))

    def send(message: bytes) -> None:
        with one_at_a_time:
            answers.write(message)
            answers.flush()

    tame_libraries()
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            try:
                function, arguments = pickle.load(sys.stdin.buffer)
            except MemoryError:
                sys.exit(OUT_OF_MEMORY)  # how much of the request is still to come, nobody can tell
            try:
                answer = function(lambda what: say("told", what), *arguments)
                message = pickle.dumps(("answer", answer), protocol=5)
                del answer  # its memory is the caller's now
            except BrokenPipeError:
                raise
            except Exception as error:  # noqa: BLE001 - told to the caller, who raises it
                message = pickle.dumps(("raised", _portable(error)), protocol=5)
            send(message)
            del message


if __name__ == "__main__":
    main()
