"""ZIP files that hold no more than they may: checked before anything in them is listed or expanded."""

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import open_regular

_END, _END_BYTES, _LONGEST_COMMENT = b"PK\5\6", 22, 65_535
_LOCATOR, _LOCATOR_BYTES = b"PK\6\7", 20
_ENTRY_BYTES = 1000
"""Of the list of members; a member's name and its other fields rarely take 100."""


@contextmanager
def open_zip(path: Path, most_members: int, most_bytes: int, refusal: str) -> Iterator[zipfile.ZipFile]:
    """Open a ZIP file to read, stored or deflated; ``refusal`` is said of one that cannot be read.

    Raises :class:`EndoctError` where it is none, has more than ``most_members``, which expand to more than
    ``most_bytes`` in all, or are packed otherwise; also for whatever is raised while it is open.
    """
    with refusing(refusal), open_regular(path) as file:
        _check_list(file, path, most_members, refusal)
        with zipfile.ZipFile(file) as members:
            listed = members.infolist()
            n_bytes = sum(member.file_size for member in listed)
            if len(listed) > most_members or n_bytes > most_bytes:
                raise EndoctError(
                    f"{path} holds too much",
                    found=f"{len(listed)} files of {n_bytes / 1e6:.3g} MB",
                    expected=f"{most_members} of {most_bytes / 1e6:g} MB at most",
                    remedy="check whether it is the right file",
                )
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in listed):
                raise EndoctError(f"{path} is packed in a way that is not read", expected="stored or deflated")
            yield members


def _check_list(file: IO[bytes], path: Path, most_members: int, refusal: str) -> None:
    """Check how long the list of members is, which is read whole when a ZIP file is opened."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _LONGEST_COMMENT - _END_BYTES - _LOCATOR_BYTES))
    end = file.read()
    file.seek(0)
    place = end.rfind(_END)
    if place < 0:
        raise EndoctError(refusal, found="no ZIP file, or one that is cut off")
    is_long = end[max(0, place - _LOCATOR_BYTES) :].startswith(_LOCATOR)
    if is_long or int.from_bytes(end[place + 12 : place + 16], "little") > most_members * _ENTRY_BYTES:
        raise EndoctError(f"{path} holds too many files", expected=f"{most_members} at most")
