"""Files and folders put in their place at one stroke, so that no moment has neither the old nor the new."""

import ctypes
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from endoct.stitching.ending import exchanging

_NOREPLACE, _EXCHANGE = 1, 2
_HERE = -100  # AT_FDCWD
_UNSUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)


def put_new(made: Path, place: Path) -> None:
    """Rename ``made`` to ``place``; raise ``FileExistsError`` where something is there, which is left as it is."""
    if _renameat2(made, place, _NOREPLACE):
        return
    if made.is_dir():
        place.mkdir()  # claims the place: an empty folder of our own may be replaced by a rename, others not
        try:
            made.rename(place)
        except OSError:
            place.rmdir()
            raise
        return
    try:
        os.link(made, place)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if os.path.lexists(place):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(place)) from None
        made.rename(place)
    else:
        made.unlink()


def exchange(made: Path, place: Path, aside: Path) -> Path:
    """Put ``made`` at ``place`` and return where what was there lies now: where ``made`` was, or at ``aside``.

    At one stroke where the system can; else the old one is moved ``aside`` first, and back where the new one cannot
    be put in its place.
    """
    if _renameat2(made, place, _EXCHANGE):
        return made
    place.rename(aside)
    try:
        put_new(made, place)
    except BaseException:
        if not os.path.lexists(place):
            aside.rename(place)
        raise
    return aside


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Have signals that would end the work wait until the block is left.

    Blocking them for this thread alone would not do: Python runs handlers in the main thread, whichever thread the
    system says.
    """
    with exchanging:
        if threading.current_thread() is threading.main_thread():
            with _signals_held_back():
                yield
        else:  # handlers run elsewhere then
            yield


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Note signals that come, and send the first of them again in the end."""
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        came.append(number)

    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: handler for number in numbers if (handler := signal.getsignal(number)) is not None}
    for number in before:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)


def _renameat2(source: Path, target: Path, flag: int) -> bool:
    """Rename as Linux can; say whether it could. Raises ``OSError`` where it can and the renaming failed."""
    call = _call()
    if call is None:
        return False
    if call(_HERE, os.fsencode(source), _HERE, os.fsencode(target), flag) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNSUPPORTED:  # by this file system
        return False
    raise OSError(number, os.strerror(number), str(source), None, str(target))


def _call() -> Any:
    if not sys.platform.startswith("linux"):
        return None
    call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if call is not None:
        call.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint]
    return call
