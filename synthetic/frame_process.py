"""Traces parts of the wall and renders frames of the endoscope in a process beside the one that renders the OCT.

Threads of one process wait for one another wherever arrays are small. The process is started before there is a sample
to work on, so that it is ready by then. It is a program of its own, not a fork, which is unsafe
beside threads, and no child of `multiprocessing`, which would run the script of whoever calls the simulator again.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from functools import partial
from typing import IO, Any

from endoct.stitching.errors import EndoctError
from endoct.synthetic.bone.maps import WallMaps
from endoct.synthetic.sample.parameters import Sample

FrameProcess = subprocess.Popen[bytes]


@contextmanager
def frame_processes(count: int) -> Iterator[list[FrameProcess]]:
    """Start ``count`` processes that wait for a sample; they are gone when the context is left."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", __name__]
    with ExitStack() as stack:
        processes = []
        for _ in range(count):
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
            stack.callback(_end, process)
            processes.append(process)
        yield processes


def _end(process: FrameProcess) -> None:
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):  # what it can no longer be told
                stream.close()
    process.wait()


def begin_wall(processes: Sequence[FrameProcess], sample: Sample) -> None:
    """Have processes trace their parts of the wall of ``sample``; :func:`part_from` is to be asked of each."""
    for part, process in enumerate(processes):
        _send(process, (sample, part, len(processes)))


def part_from(process: FrameProcess) -> Any:
    """Return :func:`endoct.synthetic.bone.wall.part_of_wall`, made by the process."""
    return _answer(process)


def show_wall(process: FrameProcess, wall: WallMaps) -> None:
    """Tell a process what :func:`frame_from` is to show."""
    _send(process, WallMaps(**{field.name: getattr(wall, field.name) for field in fields(WallMaps)}))


def frame_from(process: FrameProcess, index: int) -> Any:
    """Return :func:`endoct.synthetic.endoscope.camera.stored_frame` of a frame, made by the process."""
    _send(process, index)
    return _answer(process)


def _answer(process: FrameProcess) -> Any:
    try:
        answer = pickle.load(_stream(process.stdout))
    except (EOFError, OSError, pickle.UnpicklingError) as error:
        raise _ended(process) from error
    if isinstance(answer, Exception):
        raise answer
    return answer


def _send(process: FrameProcess, what: object) -> None:
    stream = _stream(process.stdin)
    try:
        pickle.dump(what, stream, protocol=5)
        stream.flush()
    except OSError as error:
        raise _ended(process) from error


def _stream(stream: IO[bytes] | None) -> IO[bytes]:
    if stream is None:
        raise ValueError("a process without pipes renders nothing")
    return stream


def _ended(process: FrameProcess) -> EndoctError:
    return EndoctError(
        "a process that renders frames has ended",
        found=f"exit status {process.poll()}",
        remedy="see whether memory ran out, and simulate again",
    )


def main() -> None:
    """Serve one caller until it closes its end or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller is interrupted as well, and ends this process
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    import cv2

    from endoct.synthetic.bone.wall import part_of_wall
    from endoct.synthetic.endoscope.camera import stored_frame  # the caller need not load these before it starts this

    def tell(make: Callable[[], object]) -> None:
        try:
            answer = make()
        except Exception as error:  # noqa: BLE001 - told to the caller, who raises it
            answer = error
        pickle.dump(answer, answers, protocol=5)
        answers.flush()

    cv2.setNumThreads(1)
    with contextlib.suppress(EOFError, BrokenPipeError):
        sample, part, parts = pickle.load(sys.stdin.buffer)
        tell(partial(part_of_wall, sample, part, parts))
        wall = pickle.load(sys.stdin.buffer)
        while True:
            tell(partial(stored_frame, sample, wall, pickle.load(sys.stdin.buffer)))


if __name__ == "__main__":
    main()
