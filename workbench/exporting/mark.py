"""A mark inside a file by which endoct knows it for its own, unaltered, whatever the format.

A writer puts :data:`BLANK` where its format holds text: a comment, a header, a tag. Into that, :func:`mark` then writes
the digest of the whole file with the mark blank. A folder says what it holds in a file of its own
(:mod:`endoct.base.files.contents`). A single file that other programs read has no place but its own text.
"""

import hashlib
import re
import zlib
from pathlib import Path
from typing import BinaryIO

_NAME = "endoct-output-1 "
_DIGITS = 32
BLANK = _NAME + _DIGITS * "0"
"""Text for a writer to put into its file, once, within the first bytes."""
_MARK = re.compile(_NAME.encode() + rb"([0-9a-f]{%d})" % _DIGITS)
_PNG, _KEY, _CHECK_BYTES = b"\x89PNG\r\n\x1a\n", "Software", 4
_BEFORE_BYTES = len(f"tEXt{_KEY}\0")
"""Of a chunk of text in a PNG, before the text: what it is and its key."""
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
        if _starts_png(file):
            file.seek(found.start(0) - _BEFORE_BYTES)
            text = file.read(_BEFORE_BYTES + len(BLANK))
            file.seek(found.end(0))
            file.write(zlib.crc32(text).to_bytes(_CHECK_BYTES, "big"))


def _starts_png(file: BinaryIO) -> bool:
    file.seek(0)
    return file.read(len(_PNG)) == _PNG


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
    """Return the digest of an open file as if the bytes from ``blank[0]`` to before ``blank[1]`` were zeros.

    In a PNG the sum that checks the text follows, which changes with it, and counts as zeros too.
    """
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    file.seek(0)
    head = bytearray(file.read(_HEAD_BYTES))
    head[slice(*blank)] = b"0" * _DIGITS
    if head.startswith(_PNG):
        head[blank[1] : blank[1] + _CHECK_BYTES] = bytes(_CHECK_BYTES)
    digest.update(head)
    while block := file.read(_BLOCK_BYTES):
        digest.update(block)
    return digest.hexdigest().encode()
