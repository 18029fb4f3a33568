"""The files of one case, in memory: written out to be read, mutated without touching a disk."""

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Special:
    """Something that is no file with bytes: an empty folder, a pipe that nobody writes to, a link to ``target``."""

    kind: Literal["folder", "pipe", "link"]
    target: str = ""


Entry = bytes | Special
Tree = Mapping[str, Entry]


@dataclass(frozen=True)
class Seed:
    """A sound file or folder: ``files`` by path below the case's folder, ``target`` what the reader is given.

    ``refused``: it is as it should be, but of a kind that endoct does not read.
    """

    name: str
    target: str
    files: Tree
    refused: bool = False


def write_tree(tree: Tree, folder: Path) -> None:
    """Write ``tree`` into ``folder``, which is made; what cannot be (a file below a file) is left out.

    Links come last, so that nothing is written where they lead.
    """
    folder.mkdir(parents=True)
    last = [name for name, entry in tree.items() if isinstance(entry, Special) and entry.kind == "link"]
    for name in [*(name for name in tree if name not in last), *last]:
        entry = tree[name]
        path = folder / name
        if ".." in path.parts or Path(name).is_absolute():
            raise ValueError(f"a case leads out of its folder: {name}")
        try:
            if not path.parent.resolve().is_relative_to(folder.resolve()):  # below a link
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(entry, bytes):
                path.write_bytes(entry)
            elif entry.kind == "folder":
                path.mkdir(exist_ok=True)
            elif entry.kind == "pipe":
                os.mkfifo(path)
            elif not path.exists():
                path.symlink_to(entry.target)
        except OSError:
            continue


def read_tree(folder: Path) -> dict[str, bytes]:
    """Return the files below ``folder``, in order."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def copy_case(case: Path, to: Path) -> None:
    """Copy a case's folder as it is: links as links, pipes as pipes."""
    for path in [case, *sorted(case.rglob("*"))]:
        place = to / path.relative_to(case)
        if path.is_symlink():
            place.symlink_to(path.readlink())
        elif path.is_dir():
            place.mkdir(parents=True, exist_ok=True)
        elif path.is_fifo():
            os.mkfifo(place)
        elif path.is_file():
            shutil.copyfile(path, place)
