"""A user's files: opened with care, held against size limits, named safely, listed, and digested.

Only regular files are opened, and small ones are read whole. Their states before and after say whether they stayed
as they are while they were read. The size of an array that a file asks for is checked before memory is taken.

Texts from files become parts of paths only after a check, and cells of a table such that no spreadsheet takes them
for a formula. Digests of what a recording consists of, by path, say which bytes a result came from.
"""

import hashlib
import math
import os
import re
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path

from endoct.base.errors import EndoctError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
SMALL_BYTES = 1_000_000
"""Sidecars and similar files are at most this large."""
BLOCK_BYTES = 2**22
"""A digest reads this much at a time. Its thread waits for the interpreter at every block: 5 ms and more, if that is
busy."""
HELD_FOLDERS = Path("/proc/self/fd")
"""The system lists open folders here: a path through it leads into such a folder wherever that was moved."""
State = dict[str, tuple[int, ...]]
"""Device, number, size, and the times of the last changes of every file below a path."""
VARIABLE = "ENDOCT_LARGEST_ARRAY_GB"
DEFAULT_GB = 0.5
"""A B-scan of the paper has 0.014 GB, a channel of a panorama of 14 000 × 3 000 samples 0.17."""
LISTED_FILES = 8


def plain_name(name: object, subject: str) -> str:
    """Return ``name`` if it can be a part of a path: letters, digits, ``_``, ``.``, ``-``, the first no sign.

    ``subject`` says whose name it is. Raises :class:`EndoctError` for anything else, as ``../x``.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise EndoctError(
            f"the name of {subject} cannot be used",
            found=repr(name)[:80],
            expected="letters, digits, '_', '.' and '-', at most 100, beginning with a letter or digit",
        )
    return name


def inside(folder: Path, relative: object, subject: str) -> Path:
    """Return ``folder / relative``, which ``subject`` names. Raises :class:`EndoctError` where that leads out of it."""
    parts = relative.split("/") if isinstance(relative, str) else [""]
    if any(part in ("", ".", "..") or os.sep in part or "\0" in part or Path(part).is_absolute() for part in parts):
        raise EndoctError(f"{subject} names a place outside {folder}", found=repr(relative)[:80])
    return folder.joinpath(*parts)


def leads_below(folder: Path, path: Path) -> bool:
    """Say whether ``path`` is or lies below ``folder``, links followed; not where no file can have such a name."""
    try:
        return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    except ValueError:  # a name with a zero in it, or half a character
        return False


def is_left_by_system(name: str) -> bool:
    """Say whether file managers leave a file of that name in every folder they show: nobody's work."""
    return name in (".DS_Store", "Thumbs.db", "desktop.ini") or name.startswith("._")


def spreadsheet_text(text: str) -> str:
    """Return ``text`` as a cell of a CSV that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


@contextmanager
def open_regular(path: Path) -> Iterator[BufferedReader]:
    """Open a file to read. Raises :class:`EndoctError` for anything else: a device, a pipe, which would never end.

    An error of the system at opening is an :class:`EndoctError` too; a later one is an ``OSError``.
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
    """Yield a path that leads to the folder now at ``folder``, even after it has been moved or replaced.

    Once the folder is removed, nothing can be made in it. Only Linux has such paths; elsewhere it is ``folder`` itself.
    Raises :class:`EndoctError` where there is no folder.
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
            return file.read(count) or b""  # None where a file of the system has nothing to say just now
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


def largest_array_bytes() -> int:
    """Return the limit. Raises :class:`EndoctError` where the environment sets it to something else than a size."""
    text = os.environ.get(VARIABLE, "")
    try:
        gigabytes = float(text) if text else DEFAULT_GB
    except ValueError:
        gigabytes = math.nan
    if not 0 < gigabytes < 1e6:
        raise EndoctError(f"{VARIABLE} is no size", found=f"'{text}'", expected="gigabytes, as 2 or 0.5")
    return int(gigabytes * 1e9)


def check_array_size(shape: Sequence[int], itemsize: int, subject: str) -> None:
    """Raise :class:`EndoctError` where an array of ``shape`` is larger than the limit; ``subject`` asks for it."""
    n_bytes, limit = math.prod(map(int, shape)) * itemsize, largest_array_bytes()
    if n_bytes > limit:
        raise EndoctError(
            f"{subject} asks for too much memory",
            found=f"{' × '.join(map(str, shape))} samples, {n_bytes / 1e9:.3g} GB",
            expected=f"{limit / 1e9:g} GB at most in one array",
            remedy=f"check the file; if it is right, set {VARIABLE} to more",
        )


def digests(path: Path, before_block: Callable[[], None] | None = None) -> dict[str, str]:
    """Return sha256 by path of a file, or of the files in a folder.

    ``before_block`` is called again and again, as by :func:`sha256_of`: it may wait, or raise.

    Many files share one entry, ``folder/*``: the sha256 over their lines "name sha256" in order of name. Paths are
    as :func:`path_text` gives them.
    """
    if path.is_file():
        return {path_text(path): sha256_of(path, before_block)}
    files = sorted(f for f in _below(path, before_block) if f.is_file() and not f.name.startswith("."))
    each = {f: sha256_of(f, before_block) for f in files}
    if len(each) <= LISTED_FILES:
        return {path_text(f): digest for f, digest in each.items()}
    lines = "".join(f"{path_text(f.relative_to(path).as_posix())} {digest}\n" for f, digest in each.items())
    return {path_text(path / "*"): hashlib.sha256(lines.encode()).hexdigest()}


def _below(folder: Path, before_each: Callable[[], None] | None) -> Iterator[Path]:
    for entry in folder.rglob("*"):
        if before_each is not None:
            before_each()
        yield entry


def path_text(path: Path | str) -> str:
    """Return a path as text that can be stored anywhere: bytes of a name that are no UTF-8 are written as ``\\xe9``."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def entries(folder: Path) -> list[Path]:
    """Return what lies in ``folder``, but for hidden files. Raises :class:`EndoctError` where it cannot be listed."""
    try:
        return [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise EndoctError(f"{folder} cannot be listed", found=error.strerror or str(error)) from error


def is_folder(path: Path) -> bool:
    """Say whether ``path`` is a folder, as far as it can be seen."""
    with suppress(OSError):
        return path.is_dir()
    return False


def exists(path: Path) -> bool:
    """Say whether there is anything at ``path``, as far as it can be seen."""
    with suppress(OSError):
        return path.exists()
    return False
