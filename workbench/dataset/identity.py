"""What ``dataset.json`` says about a data set, and whether arguments agree with it."""

import json
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.json_values import read_object
from endoct.synthetic.specimen import SPECIMEN_VERSION
from endoct.workbench.dataset.plan import DatasetPlan
from endoct.workbench.dataset.set_files import RECORDS, made_beyond, top_file
from endoct.workbench.running.outputs import DATA_SET_FILE, versions
from endoct.workbench.settings import ranges_text

LICENCE = "CC0-1.0"
FOLDERS = "specimens", "shards", RECORDS
"""These folders of a set appear with its units."""


@dataclass(frozen=True)
class Identity:
    """What ``dataset.json`` holds of a set: specimens it is to have, arguments and versions it was begun with."""

    count: int
    arguments: Mapping[str, object]
    versions: Mapping[str, object]


def write_identity(root: Path, plan: DatasetPlan) -> None:
    """Write ``dataset.json`` for ``plan``."""
    stored = {"count": plan.count, "arguments": _arguments(plan), "licence": LICENCE, "versions": made_with()}
    with top_file(root, DATA_SET_FILE) as file:
        file.write((json.dumps(stored, indent=1) + "\n").encode())


def check_identity(root: Path, plan: DatasetPlan) -> None:
    """Raise :class:`EndoctError` where ``root`` holds something else than the beginning of ``plan``."""
    if not root.exists():
        return
    if not root.is_dir():
        raise EndoctError(f"{root} is no folder", remedy="choose a folder that is empty or does not exist")
    path = root / DATA_SET_FILE
    if not path.exists():
        others = sorted(entry.name for entry in root.iterdir() if not _is_bare(entry))
        if others:
            raise EndoctError(
                f"{root} holds something else than a data set",
                found=", ".join(others[:3]),
                remedy="choose a folder that is empty or does not exist",
            )
        return
    stored = read_identity(root)
    for name, wanted in _arguments(plan).items():
        if (begun_with := stored.arguments.get(name)) != wanted:
            raise EndoctError(
                f"{root} was begun with another --{name.replace('_', '-')}",
                found=_text(wanted),
                expected=_text(begun_with),
                remedy="start it with the arguments it was begun with, or choose another folder",
            )
    if plan.count < stored.count and (beyond := made_beyond(root, plan)):
        raise EndoctError(
            f"{root} holds more specimens already",
            found=f"--count {plan.count}, and {', '.join(beyond[:3])}{' …' * (len(beyond) > 3)} made",
            expected=f"a --count with which these are made too; it was begun with {stored.count}",
            remedy="a set can grow; for a smaller one choose another folder",
        )
    for name, wanted in made_with().items():
        if (begun_with := stored.versions.get(name)) != wanted:
            raise EndoctError(
                f"{root} was begun with another version of {name}, whose specimens may differ",
                found=wanted,
                expected=str(begun_with),
                remedy=f"install that version of {name}, or choose another folder",
            )


def remove_abandoned(root: Path) -> None:
    """Remove the empty folders of a set that is gone, which a worker has made anew."""
    if (root / DATA_SET_FILE).exists():
        return
    for folder in (*(root / name for name in FOLDERS), root):
        with suppress(OSError):  # something lies in it
            folder.rmdir()


def _is_bare(entry: Path) -> bool:
    """Say whether what lies in a folder is hidden, or a folder of a set that never held a specimen."""
    if entry.name.startswith("."):
        return True
    is_folder = entry.name in FOLDERS and entry.is_dir() and not entry.is_symlink()
    return is_folder and all(inner.name.startswith(".") for inner in entry.iterdir())


def read_identity(root: Path) -> Identity:
    """Return what ``dataset.json`` holds. Raises :class:`EndoctError` where it cannot be read."""
    path = root / DATA_SET_FILE
    with refusing(f"{path} cannot be read", remedy="choose another folder"):
        stored = read_object(path)
        if not isinstance(stored["count"], int):
            raise ValueError("its count is no number")
        for key in ("arguments", "versions"):
            if not isinstance(stored[key], dict):
                raise ValueError(f"its {key} are no table")
        ranges = stored["arguments"].get("vary", {})
        if not isinstance(ranges, dict) or not all(isinstance(range_, list) for range_ in ranges.values()):
            raise ValueError("what it varies is no table of lists")
        if any(isinstance(value, dict) for name, value in stored["arguments"].items() if name != "vary"):
            raise ValueError("an argument is a table")
    return Identity(stored["count"], stored["arguments"], stored["versions"])


def check_worker(root: Path) -> None:
    """Raise :class:`EndoctError` where this process cannot see the data set, or would make it differently."""
    where = f"the worker on {socket.gethostname()}"
    path = root / DATA_SET_FILE
    if not path.exists():
        raise EndoctError(
            f"{where} does not see {root}",
            expected="a folder that all workers and this process share under one name",
            remedy="name such a folder, or leave --scheduler out",
        )
    for name, wanted in read_identity(root).versions.items():
        if (found := made_with().get(name)) != wanted:
            raise EndoctError(
                f"{where} has another version of {name}, whose specimens may differ",
                found=str(found),
                expected=str(wanted),
                remedy="give all workers one environment",
            )


@cache
def made_with() -> dict[str, str]:
    """Return the versions on which the bytes of a specimen depend, that of what the simulator writes among them."""
    return versions() | {"simulator": SPECIMEN_VERSION}


def _arguments(plan: DatasetPlan) -> dict[str, object]:
    arguments: dict[str, object] = {
        "preset": plan.preset,
        "seed": plan.seed,
        "vary": {key: list(plan.ranges[key]) for key in sorted(plan.ranges)},
        "format": plan.format,
        "labels": plan.labels,
        "recordings_per_bore": plan.recordings_per_bore,
    }
    return arguments | ({"specimens_per_shard": plan.specimens_per_shard} if plan.format == "webdataset" else {})


def _text(value: object) -> str:
    if not isinstance(value, dict):
        return str(value).lower() if isinstance(value, bool) else str(value)
    return ranges_text({key: tuple(range_) for key, range_ in value.items()})
