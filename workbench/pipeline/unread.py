"""Files that nothing reads: how many there are, and of the first ones why."""

from collections.abc import Container
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError
from endoct.base.files.contents import NAME as LIST_NAME
from endoct.base.files.files import entries, path_text
from endoct.modalities.contract import Manifest
from endoct.modalities.reading.other_formats import kind_not_read
from endoct.modalities.reading.recording import gives_frames, open_stack

MOST_LISTED = 20
MOST_ASKED = 1000
"""So many files of a folder are opened to see what they are."""


class Unread:
    """Files that nothing reads, as they are met."""

    def __init__(self) -> None:
        self.count = 0
        self._listed: list[dict[str, str]] = []

    def add(self, name: str, path: Path, why: str = "") -> None:
        """Count the file at ``path``; the first ones are listed as ``name``, with ``why`` or what speaks against it."""
        self.count += 1
        if len(self._listed) < MOST_LISTED:
            self._listed.append({"name": path_text(name), "why": why or _why(path)})

    def to_json(self) -> dict[str, Any]:
        """Return ``count``, and of the first ``files`` name and reason."""
        return {"count": self.count, "files": list(self._listed)}


def unread_next_to(folder: Path, manifest: Manifest, cited: Container[str]) -> Unread:
    """Return the files in the folder of a recording that are no part of it, by name.

    No frames, no sidecars or files ``cited`` there, and of no suffix that its plug-in reads. Beyond ``MOST_ASKED``
    files, those whose suffix frames have had are taken for frames.
    """
    unread = Unread()
    files = (file for file in sorted(entries(folder)) if file.is_file() and not accompanies(file))
    others = (file for file in files if file.suffix.lower() not in manifest.suffixes and file.name not in cited)
    of_frames: set[str] = set()
    for asked, file in enumerate(others):
        if file.suffix in of_frames and asked >= MOST_ASKED:
            continue
        if asked >= MOST_ASKED:
            unread.add(file.name, file, f"not looked at, as {MOST_ASKED} others were")
        elif gives_frames(file):
            of_frames.add(file.suffix)
        else:
            unread.add(file.name, file)
    return unread


def accompanies(file: Path) -> bool:
    """Whether a file only says something of others: a sidecar, a calibration, a chirp, a list of what lies there."""
    known = file.name in ("zarr.json", LIST_NAME) or file.stem.lower() in ("chirp", "offseterrors")
    return known or file.suffix.lower() == ".toml"


def texts_in(value: object) -> set[str]:
    """Return all texts in a value of JSON or TOML, at any depth: names of files may be among them."""
    texts: set[str] = set()
    left = [value]
    while left:
        this = left.pop()
        if isinstance(this, dict):
            left.extend(this.values())
        elif isinstance(this, str):
            texts.add(this)
    return texts


def _why(path: Path) -> str:
    """Return what speaks against a file; the folder it lies in is not looked at, as that may hold thousands."""
    try:
        if (kind := kind_not_read(path)) is not None:
            return f"{kind.name}, which is not read"
        open_stack(path)
    except EndoctError as error:
        return "; expected ".join(text for text in (error.found or error.what, error.expected) if text)
    return "an image, and no recording by itself"
