"""An interrupt that does not get lost: Python drops what is raised in a finalizer, and some libraries what is raised
while they are imported."""

import signal
from threading import Event
from types import FrameType

_asked = Event()


def watch() -> None:
    """Have SIGINT and SIGTERM raise KeyboardInterrupt, at once and again at the next :func:`stop_if_asked`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if one of the signals has come."""
    if _asked.is_set():
        raise KeyboardInterrupt


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number, frame
    _asked.set()
    raise KeyboardInterrupt
