"""Interrupts that are not lost, and that end a command in time.

Python drops exceptions that are raised in a finalizer. Some libraries drop those raised while they are imported. And
Python raises none while a library computes, or while it waits for threads that do.
"""

import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType
from typing import Any

from endoct.base.compute.own_process import undo_all
from endoct.base.errors import EndoctError

SIGNALS = signal.SIGINT, signal.SIGTERM
PATIENCE_S = 1.3
"""A process that has not ended by itself ends so long after the signal. Users wait two seconds at most."""

_interrupted = Event()


def watch() -> None:
    """Have the first SIGINT or SIGTERM from now on raise KeyboardInterrupt, again at :func:`stop_if_interrupted`."""
    _interrupted.clear()
    for number in SIGNALS:
        signal.signal(number, _interrupt)


def stop_if_interrupted() -> None:
    """Raise KeyboardInterrupt if one of the signals has arrived."""
    if _interrupted.is_set():
        raise KeyboardInterrupt


def stop_at_the_end() -> None:
    """Raise :class:`EndoctError` once the main thread has ended, which waits for threads that are no daemons."""
    if not threading.main_thread().is_alive():
        raise EndoctError("the program has ended")


@contextmanager
def ending_in_time(end: Callable[[], None]) -> Iterator[None]:
    """Have this process end soon after SIGINT or SIGTERM comes in the block, whatever it is doing.

    That is told to a thread of its own by Python's handler in C, which runs while libraries compute. After
    ``PATIENCE_S`` what is under way is undone, and ``end`` called, which must end the process. Until then the work may
    end by itself, and what Python cannot raise any more is not printed.
    """
    reading, writing = socket.socketpair()
    writing.setblocking(False)
    before = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
    hooks = sys.unraisablehook, threading.excepthook
    sys.unraisablehook, threading.excepthook = (_unless_interrupted(hook) for hook in hooks)
    threading.Thread(target=_end_after_signal, args=(reading, end), daemon=True).start()
    try:
        yield
    finally:
        if not _interrupted.is_set():
            sys.unraisablehook, threading.excepthook = hooks
            signal.set_wakeup_fd(before)
            writing.close()


def _end_after_signal(reading: socket.socket, end: Callable[[], None]) -> None:
    with reading:
        while (came := reading.recv(1)) and came[0] not in SIGNALS:
            pass
        if came:
            time.sleep(PATIENCE_S)
            undo_all()
            end()


def _unless_interrupted(hook: Callable[[Any], object]) -> Callable[[Any], object]:
    def called(about: Any) -> None:
        if not _interrupted.is_set():
            hook(about)

    return called


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number, frame
    if not _interrupted.is_set():  # a second signal must not cut short what the first one has undone
        _interrupted.set()
        raise KeyboardInterrupt
