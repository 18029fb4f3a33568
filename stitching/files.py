"""A user's files: regular ones only, small ones read whole, and whether they stay as they are while they are read."""

import hashlib
import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from endoct.stitching.errors import EndoctError
from endoct.stitching.names import is_left_by_system

SMALL_BYTES = 1_000_000
"""Sidecars and the like have no more."""

BLOCK_BYTES = 2**22
"""Read at a time for a digest. Its thread waits for the interpreter at every block: 5 ms and more, if that is busy."""

HELD_FOLDERS = Path("/proc/self/fd")
"""Where paths lie that lead into folders which are held open, wherever these lie."""

State = dict[str, tuple[int, ...]]
"""Of every file below a path: device, number, size, and the times of its last changes."""


@contextmanager
def open_regular(path: Path) -> Iterator[BufferedReader]:
    """Open a file to read. Raises :class:`EndoctError` for anything else: a device, a pipe, which would never end.

    What the system says to the opening is an :class:`EndoctError` too; what it says later is an ``OSError``.
    """
    try:
        # a pipe without a writer would have the opening wait
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        found = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise EndoctError(f"{path} cannot be read", found=found, remedy="check the path") from error
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        kind = _kind(handle)
        os.close(handle)
        raise EndoctError(f"{path} is no file with content", found=kind, expected="a regular file")
    with os.fdopen(handle, "rb") as file:
        yield file


@contextmanager
def held_folder(folder: Path) -> Iterator[Path]:
    """Yield a path to the folder that lies at ``folder`` now, which leads there also once that is moved or replaced.

    Once the folder is removed nothing can be made in it. Where the system has no such paths (other than Linux) it is
    ``folder`` itself. Raises :class:`EndoctError` where there is no folder.
    """
    if not sys.platform.startswith("linux"):
        yield folder
        return
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise EndoctError(f"{folder} is no folder", found=error.strerror or str(error)) from error
    try:
        held = HELD_FOLDERS / str(handle)
        yield held if held.exists() else folder
    finally:
        os.close(handle)


def read_start(path: Path, count: int) -> bytes:
    """Return the first ``count`` bytes of a file, none where it is no regular file that can be read."""
    try:
        with open_regular(path) as file:
            return file.read(count)
    except (EndoctError, OSError):
        return b""


def read_small(path: Path, most_bytes: int = SMALL_BYTES) -> bytes:
    """Return the bytes of a file that should be small. Raises :class:`EndoctError` where it is larger or unreadable."""
    with open_regular(path) as file:
        try:
            data = file.read(most_bytes + 1)
        except OSError as error:
            raise EndoctError(f"{path} cannot be read", found=error.strerror or str(error)) from error
    if len(data) > most_bytes:
        raise EndoctError(
            f"{path} is too large for what it should be",
            found=f"more than {most_bytes / 1e6:g} MB",
            remedy="check whether it is the right file",
        )
    return data


def text_of(data: bytes) -> str:
    """Return the text that a file's bytes are: UTF-8, or UTF-16 where its byte-order mark says so, without that mark.

    Raises ``UnicodeDecodeError`` for what is neither.
    """
    return data.decode("utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")


def sha256_of(path: Path, before_block: Callable[[], None] | None = None) -> str:
    """Return the sha256 of a file's bytes. Raises :class:`EndoctError` where it is no regular file.

    ``before_block`` is called again and again, since a large file takes a minute: it may wait, or raise.
    """
    digest = hashlib.sha256()
    with open_regular(path) as file:
        room = memoryview(bytearray(min(BLOCK_BYTES, os.fstat(file.fileno()).st_size + 1)))
        while count := file.readinto(room):
            if before_block is not None:
                before_block()
            digest.update(room[:count])
    return digest.hexdigest()


def state_of(path: Path) -> State:
    """Return the state of a file, or of every file below a folder, to be held against a later one.

    Hidden files, and what file managers leave, do not count.
    """
    files = [path] if not path.is_dir() else [place for place in path.rglob("*") if not place.is_dir()]
    counted = (
        file for file in files if file == path or not (file.name.startswith(".") or is_left_by_system(file.name))
    )
    return {str(file): found for file in counted if (found := _state(file))}


def check_unchanged(path: Path, before: State) -> None:
    """Raise :class:`EndoctError` where a file below ``path`` is not what it was when ``before`` was taken."""
    after = state_of(path)
    changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    if changed:
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise EndoctError(
            f"{path} was changed while it was read",
            found=f"{changed[0]}{more} changed, new or gone",
            expected="files that stay as they are",
            remedy="wait until the recording is copied, and run it again",
        )


def _state(file: Path) -> tuple[int, ...]:
    try:
        of = file.stat()
    except OSError:
        return ()
    return of.st_dev, of.st_ino, of.st_size, of.st_mtime_ns, of.st_ctime_ns


def _kind(handle: int) -> str:
    mode = os.fstat(handle).st_mode
    devices = (stat.S_ISBLK, "a device"), (stat.S_ISCHR, "a device")
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), *devices)
    return next((word for is_kind, word in kinds if is_kind(mode)), "something else")
