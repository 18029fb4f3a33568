"""Texts from files: as names that become paths, as what a terminal shows, as cells of a table."""

import os
import re
from pathlib import Path

from endoct.stitching.errors import EndoctError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def plain_name(name: object, what: str) -> str:
    """Return ``name`` if it can be a part of a path: letters, digits, ``_``, ``.``, ``-``, the first no sign.

    ``what`` says whose name it is. Raises :class:`EndoctError` for anything else, as ``../x``.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise EndoctError(
            f"the name of {what} cannot be used",
            found=repr(name)[:80],
            expected="letters, digits, '_', '.' and '-', at most 100, beginning with a letter or digit",
        )
    return name


def inside(folder: Path, relative: object, what: str) -> Path:
    """Return ``folder / relative``, which ``what`` names. Raises :class:`EndoctError` where that leads out of it."""
    parts = relative.split("/") if isinstance(relative, str) else [""]
    if any(part in ("", ".", "..") or os.sep in part or "\0" in part or Path(part).is_absolute() for part in parts):
        raise EndoctError(f"{what} names a place outside {folder}", found=repr(relative)[:80])
    return folder.joinpath(*parts)


def is_left_by_system(name: str) -> bool:
    """Say whether file managers leave a file of that name in every folder they show: nobody's work."""
    return name in (".DS_Store", "Thumbs.db", "desktop.ini") or name.startswith("._")


def spreadsheet_text(text: str) -> str:
    """Return ``text`` as a cell of a CSV that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text
