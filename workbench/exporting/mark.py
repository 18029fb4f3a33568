"""A mark inside a file by which endoct knows it for its own, unaltered, whatever the format.

A writer puts :data:`BLANK` where its format holds text: a comment, a header, a tag. Into that, :func:`mark` then writes
the digest of the whole file with the mark blank. A folder says what it holds in a file of its own
(:mod:`endoct.base.files.contents`). A single file that other programs read has no place but its own text.
"""

import hashlib
import re
from pathlib import Path
from typing import BinaryIO

_NAME = "endoct-output-1 "
_DIGITS = 32
BLANK = _NAME + _DIGITS * "0"
"""Text for a writer to put into its file, once, within the first bytes."""
_MARK = re.compile(_NAME.encode() + rb"([0-9a-f]{%d})" % _DIGITS)
_HEAD_BYTES = 1 << 18
_BLOCK_BYTES = 1 << 20


def mark(path: Path) -> None:
    """Write the digest of a finished file into its :data:`BLANK`. Raises ``ValueError`` where it has none."""
    with path.open("r+b") as file:
        found = _MARK.search(file.read(_HEAD_BYTES))
        if found is None:
            raise ValueError(f"{path} has no place for its mark")
        digest = _digest(file, found.span(1))
        file.seek(found.start(1))
        file.write(digest)


def is_marked(path: Path) -> bool:
    """Say whether a file was written by endoct and is unaltered since."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        found = _MARK.search(file.read(_HEAD_BYTES))
        return found is not None and found[1] == _digest(file, found.span(1))


def has_mark(path: Path) -> bool:
    """Say whether a file was written by endoct, altered since or not."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return _MARK.search(file.read(_HEAD_BYTES)) is not None


def _digest(file: BinaryIO, blank: tuple[int, int]) -> bytes:
    """Return the digest of an open file as if the bytes from ``blank[0]`` to before ``blank[1]`` were zeros."""
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    file.seek(0)
    head = bytearray(file.read(_HEAD_BYTES))
    head[slice(*blank)] = b"0" * _DIGITS
    digest.update(head)
    while block := file.read(_BLOCK_BYTES):
        digest.update(block)
    return digest.hexdigest().encode()
