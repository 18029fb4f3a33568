"""Digests of what a recording consists of, by path: which bytes a result came from."""

import hashlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from endoct.stitching.files import sha256_of

LISTED_FILES = 8


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
