"""Files that appear whole or not at all, their digests, locks that die with their holder, and full disks."""

import hashlib
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from endoct.stitching.errors import EndoctError

SCRATCH_PREFIX = ".making-"
LOCK_NAME = "lock"


class HeldError(Exception):
    """Somebody else holds the lock; the message is what he wrote into it."""


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock ``path``; the operating system lets go of it with the process, however that ends.

    Raises :class:`HeldError` where another process holds it.
    """
    with path.open("a+", encoding="utf-8") as file:
        try:
            _lock(file)
        except (BlockingIOError, PermissionError) as error:
            file.seek(0)
            raise HeldError(file.read().strip() or "another process") from error
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        file.flush()
        yield


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
def scratch_beside(place: Path) -> Iterator[Path]:
    """Yield a hidden folder beside ``place`` that is removed in the end; while it is in use, its lock is held."""
    place.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f"{SCRATCH_PREFIX}{place.stem}-", dir=place.parent))
    try:
        with held(scratch / LOCK_NAME):
            yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def clear_dead_scratch(folder: Path) -> int:
    """Remove the scratch folders in and below ``folder`` whose makers are dead, and return how many those were."""
    cleared = 0
    for scratch in [*folder.glob(f"{SCRATCH_PREFIX}*"), *folder.glob(f"*/{SCRATCH_PREFIX}*")]:
        try:
            with held(scratch / LOCK_NAME):
                pass
        except (HeldError, FileNotFoundError):  # in use, or removed by its maker just now
            continue
        shutil.rmtree(scratch, ignore_errors=True)
        cleared += 1
    return cleared


def put(made: Path, place: Path, scratch: Path) -> None:
    """Rename ``made`` to ``place``; what is there is moved into ``scratch`` first."""
    if place.is_dir():
        place.rename(scratch / "replaced")
    made.replace(place)
    _sync_folder(place.parent)


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file to write that becomes ``path`` when all is written; until then ``path`` is what it was."""
    with scratch_beside(path) as scratch:
        made = scratch / path.name
        with made.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        made.replace(path)


def store_and_digest(path: Path) -> tuple[int, str]:
    """Make sure that the file is on the disk; return its size in bytes and its sha256."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        os.fsync(file.fileno())
        return file.tell(), digest


def digest_of(files: dict[str, tuple[int, str]]) -> str:
    """Return the sha256 of the lines "sha256  path", sorted by path: that of ``sha256sum`` over them all."""
    lines = "".join(f"{sha}  {path}\n" for path, (_, sha) in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


@contextmanager
def disk_errors_told(folder: Path) -> Iterator[None]:
    """Turn what the disk may do to us into one :class:`EndoctError`."""
    try:
        yield
    except OSError as error:
        raise EndoctError(
            f"{folder} cannot be written",
            found=error.strerror or str(error),
            remedy="mend that and start again with the same arguments; what is finished is kept",
        ) from error


def _sync_folder(folder: Path) -> None:
    if sys.platform != "win32":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
