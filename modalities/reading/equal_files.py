"""Files with the same bytes: by size, then by a few bytes inside, and only then by all of them."""

import os
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular, sha256_of

_BLOCK = 4096
_PARTS = 2


def sets_of_equal(files: Sequence[Path]) -> list[list[Path]]:
    """Return the sets of two and more of ``files`` that hold the same bytes; empty files are left out.

    Of most files nothing but the size is read. What cannot be read is equal to nothing.
    """
    by_size = _grouped((size, file) for file in files if (size := _size(file)))
    by_parts = [_grouped((_parts(file), file) for file in group) for group in by_size.values() if len(group) > 1]
    alike = [group for groups in by_parts for parts, group in groups.items() if parts and len(group) > 1]
    by_content = [_grouped((_digest(file), file) for file in group) for group in alike]
    return [group for groups in by_content for digest, group in groups.items() if digest and len(group) > 1]


def _grouped(pairs: Iterable[tuple[Hashable, Path]]) -> dict[Hashable, list[Path]]:
    groups: dict[Hashable, list[Path]] = defaultdict(list)
    for key, file in pairs:
        groups[key].append(file)
    return groups


def _size(file: Path) -> int:
    with suppress(OSError, ValueError):
        return file.stat().st_size
    return 0


def _parts(file: Path) -> bytes:
    """Return some bytes from the whole length of a file; empty where it cannot be read."""
    with suppress(EndoctError, OSError), open_regular(file) as opened:
        size = opened.seek(0, os.SEEK_END)
        read = []
        for k in range(_PARTS):
            opened.seek(max(0, size * (k + 1) // (_PARTS + 1) - _BLOCK // 2))
            read.append(opened.read(min(_BLOCK, size)))
        return b"".join(read)
    return b""


def _digest(file: Path) -> str:
    with suppress(EndoctError, OSError):
        return sha256_of(file)
    return ""
