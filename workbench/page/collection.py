"""A folder of comparisons, panoramas and simulated specimens: what lies in it, from the small files of each only."""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from endoct.fusion.files.result_file import read_result
from endoct.stitching.doubt import Doubt
from endoct.stitching.errors import EndoctError
from endoct.stitching.json_values import read_object
from endoct.stitching.store import is_panorama, read_doubts
from endoct.stitching.zarr_store import read_attributes
from endoct.workbench.report.verdict import Level, Verdict, recording_verdict, verdict_of

Kind = Literal["comparison", "recording", "specimen"]
DEEPEST = 4
"""How many folders below the one that is served anything is looked for."""
MOST_ENTRIES = 5000
MOST_FOLDERS = 50_000
SAMPLE = Path("truth", "sample.json")


@dataclass(frozen=True)
class Entry:
    """One of a collection: where it lies, ``name`` is its path below the collection with "/", and what is known of it.

    ``what`` are its sides, or how it was simulated; the scores are None where there are none. ``fault`` says why it
    cannot be read, "" where it can.
    """

    path: Path
    name: str
    kind: Kind
    what: str = ""
    level: Level | None = None
    headline: str = ""
    jaccard: float | None = None
    interval: tuple[float, float] | None = None
    dice: float | None = None
    confidence: float | None = None
    doubts: tuple[Doubt, ...] = ()
    written: str = ""
    fault: str = ""

    @property
    def can_be_opened(self) -> bool:
        """Whether it has a page of its own."""
        return self.kind != "specimen" and not self.fault


def read_collection(folder: Path) -> tuple[Entry, ...]:
    """Return what lies in ``folder``, by name. Links are not followed; what cannot be read says so itself.

    Raises :class:`EndoctError` where there is nothing, or more than anybody could look through.
    """
    found = []
    for path, kind in _found(folder):
        found.append(_entry(folder, path, kind))
        if len(found) > MOST_ENTRIES:
            raise EndoctError(f"{folder} holds too much to list", expected=f"{MOST_ENTRIES} comparisons at most")
    if not found:
        raise EndoctError(
            f"{folder} cannot be shown",
            found="no comparison, no panorama and no simulated specimen" if folder.is_dir() else "no such folder",
            expected="what `endoct compare` or `endoct unroll` wrote, or a folder with some of these",
        )
    return tuple(sorted(found, key=lambda entry: entry.name))


def check_no_links(path: Path) -> None:
    """Raise :class:`EndoctError` where anything in ``path`` is a link: it could lead out of the collection."""
    for below, folders, files in os.walk(path):
        for name in (*folders, *files):
            if (Path(below) / name).is_symlink():
                raise EndoctError(f"{Path(below) / name} is a link", expected="what endoct wrote, and nothing else")


def _found(folder: Path) -> Iterator[tuple[Path, Kind]]:
    """Yield what is recognised; nothing is looked for inside of it."""
    below = [(folder, 0)]
    for _ in range(MOST_FOLDERS):
        if not below:
            return
        here, depth = below.pop()
        kind = _kind(here) if depth else None
        if kind is not None:
            yield here, kind
        elif depth < DEEPEST:
            below += [(path, depth + 1) for path in _folders(here)]
    raise EndoctError(f"{folder} has too many folders to look through", expected=f"{MOST_FOLDERS} at most")


def _folders(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as scan:
            return [
                Path(one.path) for one in scan if one.is_dir(follow_symlinks=False) and not one.name.startswith(".")
            ]
    except OSError:
        return []  # somebody else's


def _kind(path: Path) -> Kind | None:
    if (path / "comparison.zarr").is_dir():
        return "comparison"
    if (path / SAMPLE).is_file():
        return "specimen"
    return "recording" if path.suffix == ".zarr" and is_panorama(path) else None


def _entry(folder: Path, path: Path, kind: Kind) -> Entry:
    name = path.relative_to(folder).as_posix()
    read = {"comparison": _comparison, "recording": _recording, "specimen": _specimen}[kind]
    try:
        return Entry(path, name, kind, **read(path))
    except EndoctError as error:
        return Entry(path, name, kind, fault=str(error))


def _comparison(path: Path) -> dict[str, Any]:
    result = read_result(path)
    alignment = result.alignment if result.aligned else None
    return {
        "what": " and ".join(result.sides),
        **_verdict(verdict_of(result)),
        "jaccard": result.jaccard if result.aligned else None,
        "interval": result.overlap.jaccard_interval if result.overlap else None,
        "dice": result.dice if result.aligned else None,
        "confidence": None if alignment is None else alignment.confidence,
        "doubts": tuple(result.doubts),
        "written": _written(path / "result.json"),
    }


def _recording(path: Path) -> dict[str, Any]:
    doubts = read_doubts(path)
    return {
        "what": str(read_attributes(path).get("modality", "")),
        **_verdict(recording_verdict(doubts)),
        "doubts": doubts,
        "written": _written(path / "zarr.json"),
    }


def _specimen(path: Path) -> dict[str, Any]:
    sample = read_object(path / SAMPLE)
    bore = sample.get("bore")
    bone = bore.get("bone") if isinstance(bore, dict) else None
    said = (("preset", sample.get("preset")), ("seed", sample.get("seed")), ("bone", bone))
    what = ", ".join(f"{name} {value}" for name, value in said if isinstance(value, str | int))
    return {"what": what[:200], "written": _written(path / SAMPLE)}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {"level": verdict.level, "headline": verdict.headline}


def _written(file: Path) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))
