"""Files of a data set: their digests, and how they come into it.

Whatever is replaced is removed only where its record lists its bytes; else it stays, in ``damaged/`` or nearby.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from endoct.base.errors import EndoctError
from endoct.base.files.contents import Contents, differences, sync
from endoct.base.files.files import plain_name, sha256_of
from endoct.base.files.json_values import read_object
from endoct.base.files.scratch import REPLACED, exchange, keep_aside, new_file, put_new, scratch_next_to, uninterrupted

DAMAGED = "damaged"
WRITTEN = ".written.json"
"""The digests of the files at the top of the set, by which changed ones are recognised."""

Files = Mapping[str, tuple[int, str]]
"""Path → (bytes, sha256)."""


def store_and_digest(path: Path) -> tuple[int, str]:
    """Make sure that the file is on the disk; return its size in bytes and its sha256."""
    sync(path)
    return path.stat().st_size, sha256_of(path)


def digest_of(files: Files) -> str:
    """Return the sha256 of the lines "sha256  path", sorted by path: that of ``sha256sum`` over them all."""
    lines = "".join(f"{sha}  {path}\n" for path, (_, sha) in sorted(files.items()))
    return hashlib.sha256(lines.encode("utf-8", "surrogatepass")).hexdigest()  # damaged records have any letters


def put_unit(made: Path, place: Path, scratch: Path, root: Path, known: tuple[Files, ...]) -> None:
    """Put a specimen's folder, or a shard, in its place in the set ``root``.

    What is there goes where one of ``known`` lists all its bytes; else it is moved to ``damaged/`` first.
    """
    with uninterrupted():
        if os.path.lexists(place) and not any(_is_known(place, files) for files in known):
            (root / DAMAGED).mkdir(exist_ok=True)
            keep_aside(place, root / DAMAGED / place.name)
        try:
            put_new(made, place)
        except FileExistsError:
            aside = scratch / REPLACED / place.name
            aside.parent.mkdir(exist_ok=True)
            exchange(made, place, aside)  # the old one goes with the scratch folder
        sync(place.parent)


def _is_known(place: Path, files: Files) -> bool:
    """Say whether all bytes of a specimen's folder, or of a shard, are in ``files``."""
    if not place.is_dir():
        return (place.stat().st_size, sha256_of(place)) == files.get(place.name)
    found = differences(place, Contents("specimen", files))
    return not found.altered and not found.added


def count_damaged(root: Path) -> int:
    """Return how many units were moved to ``damaged/`` since the set was begun."""
    return sum(1 for _ in (root / DAMAGED).iterdir()) if (root / DAMAGED).is_dir() else 0


@contextmanager
def top_file(root: Path, name: str) -> Iterator[IO[bytes]]:
    """Open a file at the top of the set to write anew; one that was changed since stays, as NAME.kept-1."""
    path, written = root / name, _written(root)
    with scratch_next_to(path) as scratch:
        made = scratch / name
        with made.open("wb") as file:
            yield file
        digest = store_and_digest(made)[1]
        # noted first, so that a run that dies in between leaves no unknown file
        _note_written(root, written | {name: [*written.get(name, [])[-1:], digest]})
        with uninterrupted():
            if os.path.lexists(path) and sha256_of(path) not in (digest, *written.get(name, ())):
                keep_aside(path, path)
            made.replace(path)
        sync(root)


def settle_written(root: Path) -> None:
    """Note of every file at the top only what is there now: so the note depends on the set alone, not on its past."""
    written = _written(root)
    now = {name: [sha256_of(root / name)] for name in sorted(written) if (root / name).is_file()}
    if settled := {name: digest for name, digest in now.items() if digest[0] in written[name]}:
        _note_written(root, settled)


def changed_top_files(root: Path) -> list[str]:
    """Return the names of the files at the top of the set that are not as they were written, or gone."""
    return [
        name
        for name, digests in sorted(_written(root).items())
        if not (root / plain_name(name, "a file of the set")).is_file() or sha256_of(root / name) not in digests
    ]


def _written(root: Path) -> dict[str, list[str]]:
    try:
        stored = read_object(root / WRITTEN)
        return {name: [str(digest) for digest in digests] for name, digests in stored.items()}
    except (EndoctError, TypeError):
        return {}  # then every file that differs is kept


def _note_written(root: Path, written: Mapping[str, list[str]]) -> None:
    with new_file(root / WRITTEN) as file:
        file.write((json.dumps(written, indent=1) + "\n").encode())
