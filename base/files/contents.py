"""What an output of endoct holds, written into it: by that it is known for endoct's own, whole and unaltered.

A folder has a file ``endoct-output.json`` with its kind and the size and sha256 of every file in it. A part that is
written anew by itself is only named there. It is a folder with such a file of its own, or a page whose last line holds
the digest of everything before it.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError, refusing, some_of
from endoct.base.files.files import inside, is_left_by_system, read_small, sha256_of

NAME = "endoct-output.json"
FORMAT = "endoct-output-1"
PAGE = "page"
SMALL_FILES = (
    *(NAME, "result.json", "zarr.json", "comparison.zarr/zarr.json", "panoramas/*/zarr.json"),
    *("sample.json", "wall.zarr/zarr.json"),
)
"""An output is known by these: its list where it has one, and the files that say how its arrays came about."""
SEALED_AT_ONCE = 8
"""Number of files digested at once: hundreds of small ones wait for the disk, not for a processor."""
MOST_BYTES = 16_000_000
"""The list may have this many bytes. It takes some 100 for each file, and twenty times that in memory."""

_MARK = re.compile(rb"<!-- endoct-output-1 sha256 ([0-9a-f]{64}) -->\n\Z")


@dataclass(frozen=True)
class Contents:
    """What a folder holds: ``files``, path → (bytes, sha256); ``parts``, path → kind, which say of themselves."""

    kind: str
    files: Mapping[str, tuple[int, str]]
    parts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Differences:
    """Paths below a folder that are not as its contents say, each sorted."""

    altered: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    added: tuple[str, ...] = ()

    def __str__(self) -> str:
        said = ((self.altered, " changed"), (self.missing, " missing"), (self.added, ", which endoct did not write"))
        return "; ".join(f"{some_of(paths)}{what}" for paths, what in said if paths)


def seal(folder: Path, kind: str) -> None:
    """Write what ``folder`` holds into it, and see to it that all of it is on the disk."""
    files, parts = {}, {}
    for path, found in thread_map(_sealed, list(_walk(folder)), SEALED_AT_ONCE):
        name = path.relative_to(folder).as_posix()
        if isinstance(found, str):
            parts[name] = found
        else:
            files[name] = found
    text = json.dumps({"format": FORMAT, "kind": kind, "files": files, "parts": parts}, sort_keys=True)
    with (folder / NAME).open("w", encoding="utf-8") as file:
        file.write(text + "\n")
        file.flush()
        os.fsync(file.fileno())
    for below, _, _ in os.walk(folder):
        sync(Path(below))


def _sealed(path: Path) -> tuple[Path, str | tuple[int, str]]:
    """Return the kind of what lies at ``path``, or where it has none its size and digest; it is on the disk then."""
    found = kind_of(path) or (path.stat().st_size, sha256_of(path))
    sync(path)
    return path, found


def read_contents(folder: Path) -> Contents | None:
    """Return what ``folder`` should hold, None where it does not say.

    Raises :class:`EndoctError` where what it says cannot be read.
    """
    path = folder / NAME
    if not os.path.lexists(path):
        return None
    with refusing(f"{path} is damaged", remedy="make the output again"):
        stored = json.loads(read_small(path, MOST_BYTES))
        if stored["format"] != FORMAT:
            raise ValueError(f"its format is {stored['format']!r}")
        contents = Contents(
            str(stored["kind"]),
            {str(name): (int(size), str(sha)) for name, (size, sha) in stored["files"].items()},
            {str(name): str(kind) for name, kind in stored["parts"].items()},
        )
    for name in (*contents.files, *contents.parts):
        inside(folder, name, str(path))
    return contents


def output_digest(folder: Path) -> str:
    """Return the sha256 over the small files by which an output is known, with their names."""
    digest = hashlib.sha256()
    for path in small_files(folder):
        try:
            content = read_small(path, MOST_BYTES)
        except EndoctError:
            continue
        digest.update(f"{path.relative_to(folder)}\0{len(content)}\0".encode(errors="surrogateescape") + content)
    return digest.hexdigest()


def small_files(folder: Path) -> list[Path]:
    """Return the small files by which an output is known."""
    return sorted(path for pattern in SMALL_FILES for path in folder.glob(pattern))


def whole_of(folder: Path) -> Path | None:
    """Return the output that lists the files in ``folder`` as its own; None where no folder above it does."""
    folder = folder.resolve()
    return next((above for above in folder.parents if _lists(above, folder)), None)


def differences(folder: Path, contents: Contents) -> Differences:
    """Hold everything in ``folder`` against its ``contents``, parts against theirs. Reads every byte once."""
    altered, missing, added = [], [], []
    present = {path.relative_to(folder).as_posix(): path for path in _walk(folder)}
    for name, path in present.items():
        if name in contents.files:
            if _digest(path) != contents.files[name]:
                altered.append(name)
        elif name not in contents.parts:
            added.append(name)
        elif kind_of(path) != contents.parts[name]:
            altered.append(name)
        elif path.is_dir() and (of_part := read_contents(path)) is not None:
            within = differences(path, of_part)
            altered += [f"{name}/{one}" for one in within.altered]
            missing += [f"{name}/{one}" for one in within.missing]
            added += [f"{name}/{one}" for one in within.added]
    missing += [name for name in (*contents.files, *contents.parts) if name not in present]
    return Differences(tuple(sorted(altered)), tuple(sorted(missing)), tuple(sorted(added)))


def check_intact(folder: Path, which: Callable[[str], bool] = lambda _: True) -> None:
    """Raise :class:`EndoctError` where a file in ``folder``, of those that are asked for, is not as endoct wrote it.

    ``which`` is given paths below ``folder``. A folder that does not say what it holds is not judged; readers check it
    by other means. Parts of it that say of themselves are not looked at.
    """
    contents = read_contents(folder)
    if contents is None:
        return
    wanted = {name: of for name, of in contents.files.items() if which(name)}
    missing = tuple(name for name in wanted if not os.path.lexists(folder / name))
    altered = tuple(name for name, of in wanted.items() if name not in missing and _digest(folder / name) != of)
    if found := str(Differences(altered, missing)):
        raise EndoctError(f"{folder} is not as endoct wrote it", found=found, remedy="make it again")


def write_marked(page: str, path: Path) -> None:
    """Write an HTML page with a last line that holds the digest of all before."""
    data = page.rstrip("\n").encode() + b"\n"
    with path.open("wb") as file:
        file.write(data)
        file.write(f"<!-- {FORMAT} sha256 {hashlib.sha256(data).hexdigest()} -->\n".encode())


def is_marked(path: Path) -> bool:
    """Say whether a file is a page that :func:`write_marked` made, unaltered."""
    if path.suffix != ".html" or not _is_plain(path):
        return False
    data = path.read_bytes()
    mark = _MARK.search(data[-200:])
    if mark is None:
        return False
    return hashlib.sha256(data[: len(data) - (mark.end() - mark.start())]).hexdigest().encode() == mark[1]


def kind_of(path: Path) -> str | None:
    """Return the kind of an output as it says itself, None where it does not say."""
    if path.is_symlink():
        return None
    if path.is_dir():
        return None if (contents := read_contents(path)) is None else contents.kind
    return PAGE if is_marked(path) else None


def remove_listed(folder: Path, contents: Contents) -> bool:
    """Remove what ``contents`` lists, and the folders that are empty then; say whether all is gone."""
    for path in _walk(folder):
        name = path.relative_to(folder).as_posix()
        if path.is_dir() and not path.is_symlink():
            of_part = read_contents(path) if name in contents.parts else None
            if of_part is not None:
                remove_listed(path, of_part)
        elif name in contents.files or name in contents.parts:
            path.unlink()
    for below, _, _ in os.walk(folder, topdown=False):
        left = os.listdir(below)  # noqa: PTH208 - iterdir would keep the folder open on some systems
        if all(name == NAME or is_left_by_system(name) for name in left):  # else the list stays with what is left
            for name in left:
                (Path(below) / name).unlink()
            Path(below).rmdir()
    return not folder.exists()


def sync(path: Path) -> None:
    """See to it that a file or a folder is on the disk."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _walk(folder: Path) -> Iterator[Path]:
    """Yield every file, link and other entry below ``folder``, and folders only where they are outputs themselves."""
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        path = Path(entry.path)
        if entry.is_dir(follow_symlinks=False):
            if os.path.lexists(path / NAME):
                yield path
            else:
                yield from _walk(path)
        elif path != folder / NAME and not is_left_by_system(entry.name):
            yield path


def _digest(path: Path) -> tuple[int, str] | None:
    return (path.stat().st_size, sha256_of(path)) if _is_plain(path) else None


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _lists(whole: Path, folder: Path) -> bool:
    """Say whether what ``whole`` holds lists files of ``folder``, and not as a part that says of itself."""
    contents = read_contents(whole)
    within = f"{folder.relative_to(whole).as_posix()}/"
    return contents is not None and any(name.startswith(within) for name in contents.files)
