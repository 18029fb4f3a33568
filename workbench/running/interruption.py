"""Interrupts that are not lost: Python drops exceptions raised in a finalizer, and some libraries those raised while
they are imported."""

import signal
from threading import Event
from types import FrameType

_interrupted = Event()


def watch() -> None:
    """Have SIGINT and SIGTERM raise KeyboardInterrupt, at once and again at the next :func:`stop_if_interrupted`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def stop_if_interrupted() -> None:
    """Raise KeyboardInterrupt if one of the signals has arrived."""
    if _interrupted.is_set():
        raise KeyboardInterrupt


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number, frame
    _interrupted.set()
    raise KeyboardInterrupt
