"""Hidden folders for unfinished output, and files and folders put in their place at one stroke.

A scratch folder lies next to the place that its content is for. It is locked while it is in use, and cleared away
after its maker has died. The exchange leaves no moment that has neither the old nor the new.
"""

import ctypes
import errno
import os
import re
import shutil
import signal
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import IO, Any

from endoct.base.compute.own_process import exchanging, undone_in_the_end
from endoct.base.errors import EndoctError
from endoct.base.files.contents import Contents, read_contents, remove_listed, sync
from endoct.base.files.files import read_start

_NOREPLACE, _EXCHANGE = 1, 2
_HERE = -100  # AT_FDCWD
_UNSUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
PREFIX = ".endoct-"
GONE = ".endoct.gone-endoct-"
"""The name of a scratch folder that is being removed begins so."""
LOCK_NAME = "lock"
NEW, REPLACED = "new", "replaced"
"""Folders in a scratch folder: of what is made, and of what had to be moved aside for it."""
_LOCK = re.compile(r"process \d+ on .*\n")
_SURELY_LOCKED_S = 5.0
"""A scratch folder that has no lock by then has lost its maker before it was locked."""
_QUIET_S, _LONGEST_AFTER_S = 0.2, 2.0
"""A removed folder must rest for the first of these times, in which nobody writes into it; the second limits the
wait."""


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

    The system exchanges them at one stroke where it can. Else the old one is moved ``aside`` first, and back where the
    new one cannot be put in its place.
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
    is_main = threading.current_thread() is threading.main_thread()  # else handlers run elsewhere
    with exchanging, _signals_held_back() if is_main else nullcontext():
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


class HeldError(Exception):
    """Somebody else holds the lock; the message is what he wrote into it."""


@contextmanager
def held(path: Path) -> Iterator[int]:
    """Hold the lock ``path``; the operating system lets go of it with the process, however that ends.

    Yields the open file: a program that holds it too keeps the lock until it ends.

    Raises :class:`HeldError` where another process holds it. Raises :class:`EndoctError` where something else lies
    there, a link or a file with another text, which is left as it is.
    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)
    of = os.fstat(handle)
    if not stat.S_ISREG(of.st_mode) or of.st_nlink != 1:
        os.close(handle)
        raise EndoctError(f"{path} is no lock of endoct's", found="a link, or no file", remedy="move it away")
    with os.fdopen(handle, "r+", encoding="utf-8", errors="replace") as file:
        if (text := file.read(200)) and not _LOCK.match(text):
            raise EndoctError(f"{path} is no lock of endoct's", found=text[:40], remedy="move it away")
        try:
            _lock(file)
        except (BlockingIOError, PermissionError) as error:
            file.seek(0)
            raise HeldError(file.read().strip() or "another process") from error
        file.seek(0)
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        file.flush()
        yield file.fileno()


if sys.platform == "win32":
    import msvcrt

    def _lock(file: IO[str]) -> None:
        file.seek(1 << 20)  # beyond the text, which others must be able to read
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(file: IO[str]) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def scratch_next_to(place: Path) -> Iterator[Path]:
    """Yield a hidden folder next to ``place`` that is removed in the end; while it is in use, its lock is held."""
    place.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{_short(place.name)}-", dir=place.parent))
    try:
        with undone_in_the_end(lambda: _remove(scratch)), _lock_in(scratch):
            yield scratch
    except BaseException:
        _remove(scratch)
        if threading.active_count() > 1:
            _remove_made_anew(scratch)
        raise
    _remove(scratch)


class TemporaryFolder(tempfile.TemporaryDirectory[str]):
    """A temporary folder, locked while it is in use; those of the same purpose whose makers died are removed first."""

    def __init__(self, purpose: str) -> None:
        prefix = f"endoct-{purpose}-"
        _clear(Path(tempfile.gettempdir()), prefix)
        super().__init__(prefix=prefix, ignore_cleanup_errors=True)
        self._in_use = ExitStack()
        self._in_use.enter_context(undone_in_the_end(lambda: _remove(Path(self.name))))
        self._in_use.enter_context(_lock_in(Path(self.name)))

    def cleanup(self) -> None:
        """Remove the folder."""
        self._in_use.close()
        _remove(Path(self.name))
        super().cleanup()


@contextmanager
def _lock_in(folder: Path) -> Iterator[None]:
    """Hold the lock of a scratch folder; it appears when it is held: who clears away must not come between."""
    begun = folder / (LOCK_NAME if sys.platform == "win32" else f"{LOCK_NAME}.new")
    with held(begun):
        if begun.name != LOCK_NAME:
            begun.rename(folder / LOCK_NAME)
        yield


def _remove(folder: Path) -> None:
    """Remove a scratch folder. If this process dies before all is removed, the folder's name tells so.

    Of an output that was replaced, only what endoct wrote is removed; anything else in it is kept next to it.
    """
    try:
        for output in (*_within(folder / NEW), *_within(folder / REPLACED)):
            is_folder = output.is_dir() and not output.is_symlink()
            remove_or_keep(output, folder.parent / output.name, read_contents(output) if is_folder else None)
    except (EndoctError, OSError):  # it stays where it is, rather than going with the rest
        return
    gone = folder.with_name(f"{GONE}{folder.name.lstrip('.').removeprefix('endoct-')}")
    with suppress(OSError):
        folder = folder.rename(gone)
    shutil.rmtree(folder, ignore_errors=True)


def _remove_made_anew(folder: Path) -> None:
    """Remove a scratch folder that threads of a library make anew, which go on to write after an error."""
    quiet_since = time.monotonic()
    until = quiet_since + _LONGEST_AFTER_S
    while (now := time.monotonic()) < min(until, quiet_since + _QUIET_S):
        if folder.exists():
            shutil.rmtree(folder, ignore_errors=True)
            quiet_since = now
        time.sleep(_QUIET_S / 10)


def clear_dead_scratch(folder: Path, name: str = "") -> int:
    """Remove scratch folders in ``folder`` whose makers are dead, those for ``name`` or all; return how many.

    What a maker had moved aside when it died, before the new stood in its place, is put back first.
    """
    return _clear(folder, f"{PREFIX}{_short(name)}{'-' if name else ''}")


def _clear(folder: Path, prefix: str) -> int:
    cleared = 0
    for scratch in sorted(path for path in folder.iterdir() if path.name.startswith((prefix, GONE))):
        if scratch.is_symlink() or not scratch.is_dir() or not _is_ours(scratch):
            continue
        if scratch.name.startswith(GONE):
            shutil.rmtree(scratch, ignore_errors=True)
            continue
        try:
            if not _is_lock(scratch / LOCK_NAME):  # one of a maker that died at once, or nothing of endoct's
                _remove_unlocked(scratch)
                continue
            with held(scratch / LOCK_NAME):
                _restore(scratch, folder)
        except (HeldError, EndoctError, OSError):  # in use, removed by its maker just now, or nothing of endoct's
            continue
        _remove(scratch)
        cleared += 1
    return cleared


def _is_lock(path: Path) -> bool:
    return not path.is_symlink() and _LOCK.match(read_start(path, 200).decode("utf-8", "replace")) is not None


def _remove_unlocked(scratch: Path) -> None:
    """Remove a folder in which nothing lies but a lock that was begun, if its maker had the time to take it."""
    if time.time() - scratch.stat().st_mtime > _SURELY_LOCKED_S:
        with suppress(OSError):
            if [path.name for path in scratch.iterdir()] == [f"{LOCK_NAME}.new"]:
                (scratch / f"{LOCK_NAME}.new").unlink()
            scratch.rmdir()


def _within(folder: Path) -> list[Path]:
    """Return what lies in a folder, nothing where it is a link or none."""
    return sorted(folder.iterdir()) if folder.is_dir() and not folder.is_symlink() else []


def keep_aside(made: Path, place: Path) -> Path:
    """Move ``made`` to a free name next to ``place`` and return that: NAME.kept-1 or the next."""
    for number in range(1, 1000):
        free = place.with_name(f"{_short(place.name, 200)}.kept-{number}")
        with suppress(FileExistsError):
            put_new(made, free)
            return free
    raise FileExistsError(f"{place}.kept-1 to .kept-999")


def remove_or_keep(output: Path, place: Path, contents: Contents | None) -> Path | None:
    """Remove what endoct wrote, by its ``contents``, into an ``output`` that was replaced; nothing where they are None.

    What else lies in it, or cannot be removed, is kept next to ``place``; return where, or None where nothing is left.
    """
    if contents is None:
        return None
    with suppress(OSError):  # a folder that may not be written
        if remove_listed(output, contents):
            return None
    return keep_aside(output, place)


def _restore(scratch: Path, folder: Path) -> None:
    for old in _within(scratch / REPLACED):
        with suppress(OSError):  # the empty folder by which the place was claimed for the new one
            (folder / old.name).rmdir()
        if not os.path.lexists(folder / old.name):
            put_new(old, folder / old.name)
        elif os.path.lexists(scratch / NEW / old.name):  # the new one never got there: somebody else's did
            keep_aside(old, folder / old.name)
        sync(folder)


def _is_ours(scratch: Path) -> bool:
    return not hasattr(os, "getuid") or scratch.stat().st_uid == os.getuid()


def _short(name: str, most_bytes: int = 60) -> str:
    """Return the beginning of a name: one may be as long as the file system takes, and more is to be added."""
    return os.fsencode(name)[:most_bytes].decode(errors="ignore")


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file to write that becomes ``path`` when all is written; until then ``path`` is what it was.

    For files that are endoct's by their name in a folder that is endoct's.
    """
    with scratch_next_to(path) as scratch:
        made = scratch / path.name
        with made.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        made.replace(path)
        sync(path.parent)
