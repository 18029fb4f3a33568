"""Whether outputs of endoct are as they were written, to the byte."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.files.contents import NAME as LIST_NAME
from endoct.base.files.contents import Contents, Differences, differences, is_marked, read_contents
from endoct.base.files.files import is_left_by_system, sha256_of
from endoct.fusion.files.session import MASKS, read_session
from endoct.fusion.files.session import NAME as SESSION_NAME
from endoct.workbench.dataset.creation import LOCK_NAME, TOP_FILES
from endoct.workbench.dataset.identity import Identity, read_identity
from endoct.workbench.dataset.plan import Unit
from endoct.workbench.dataset.set_files import (
    DAMAGED,
    RECORDS,
    WRITTEN,
    Record,
    changed_top_files,
    digest_of,
    read_record,
)
from endoct.workbench.exporting.mark import has_mark
from endoct.workbench.exporting.mark import is_marked as is_whole
from endoct.workbench.kinds import output_at
from endoct.workbench.page.notes import NAME as NOTES
from endoct.workbench.requests import VerifyRequest, by_request
from endoct.workbench.running.outputs import DATA_SET, DATA_SET_FILE, EXPORT, REPORT, SPECIMEN
from endoct.workbench.running.progress import Advance, Stages, stages_for

_A_MASK = re.compile(rf"{MASKS}/[^/]+/[^/]+\.(png|toml)")
_OF_A_KILLED_SAVE = re.compile(rf"({MASKS}/[^/]+/)?\.endoct[-.][^/]+/.+")
"""Scratch of a mask or a session whose maker died; the next save there clears it."""


@dataclass(frozen=True)
class Integrity:
    """What an output is, how much of it was looked at, and what in it is not as it was written."""

    path: Path
    kind: str
    files: int
    bytes: int
    differences: Differences

    @property
    def intact(self) -> bool:
        """Whether all is as it was written, and nothing else is there."""
        return not str(self.differences)

    def to_json(self) -> dict[str, object]:
        """Return the verdict for machines."""
        parts = self.differences
        lists = {"altered": list(parts.altered), "missing": list(parts.missing), "added": list(parts.added)}
        facts = {"path": str(self.path), "kind": self.kind, "files": self.files, "bytes": self.bytes}
        return {**facts, "intact": self.intact, **lists}


@by_request(VerifyRequest)
def verify(request: VerifyRequest) -> list[Integrity]:
    """Check every byte of an output of endoct against the digests noted when it was written.

    ``path`` is a panorama, a comparison, a report, an export, a summary, results of the bench, a specimen, a data set
    or a part of one, or a folder of such, as `endoct demo` leaves it. Raises :class:`EndoctError` where it is none of
    these.

    With the comparison that :func:`~endoct.workbench.api.demo` makes in its example:

    >>> from endoct.workbench import verify
    >>> {verdict.kind: verdict.intact for verdict in verify("demo")}
    {'comparison': True, 'specimen': True}
    """
    path, stages = Path(request.path), stages_for(request.progress)
    if path.suffix == ".html" and path.is_file():
        return [_page(path)]
    if has_mark(path):
        altered = () if is_whole(path) else (path.name,)
        return [Integrity(path, EXPORT, 1, path.stat().st_size, Differences(altered=altered))]
    below = (folder for folder in _folders(path) if output_at(folder) or _looks_like_one(folder))
    outputs = [path] if _is_output(path) else list(below)
    if not outputs and (path.parent.name in ("specimens", "shards") and (path.parent.parent / DATA_SET_FILE).is_file()):
        return [_unit_verdict(path, _record(path))]
    if not outputs:
        raise EndoctError(
            f"{path} is no output of endoct's, or lacks the list of what it should hold",
            expected="what `endoct unroll`, compare, simulate, dataset, summarise or bench wrote",
            remedy="check the path",
        )
    return [_verdict(output, stages) for output in outputs]


def _verdict(path: Path, stages: Stages) -> Integrity:
    with stages.stage(f"verify {path.name}") as advance:
        contents = read_contents(path)
        if contents is None and (path / DATA_SET_FILE).is_file():
            return _data_set(path, advance)
        if contents is None:
            return Integrity(path, "output without its list", 0, 0, Differences(missing=(LIST_NAME,)))
        size = sum(n_bytes for n_bytes, _ in contents.files.values())
        return Integrity(
            path, contents.kind, len(contents.files), size, _without_own(path, differences(path, contents))
        )


def _without_own(folder: Path, found: Differences) -> Differences:
    """Return differences without what the page saves in a result, session, masks and note: these are the user's."""
    own = {name for name in found.added if _A_MASK.fullmatch(name) or _OF_A_KILLED_SAVE.fullmatch(name)}
    own |= {NOTES} & set(found.added)
    if SESSION_NAME in found.added:
        try:
            read_session(folder / SESSION_NAME)
            own.add(SESSION_NAME)
        except EndoctError:
            pass
    return replace(found, added=tuple(name for name in found.added if name not in own))


def _page(path: Path) -> Integrity:
    changed = () if is_marked(path) else (path.name,)
    return Integrity(path, REPORT, 1, path.stat().st_size, Differences(altered=changed))


def _data_set(root: Path, advance: Advance) -> Integrity:
    """Judge a data set by its records: every specimen or shard, and the files at its top."""
    identity = read_identity(root)
    units = [_unit(identity, path) for path in sorted((root / RECORDS).glob("*.json"))]
    altered, missing, added = list(changed_top_files(root)), [], _others(root, units)
    missing += [name for name in (WRITTEN, *TOP_FILES) if not (root / name).is_file()]
    made = files = size = 0

    def check(unit: Unit) -> tuple[Record | None, Integrity | None]:
        record = read_record(root, unit)
        return record, None if record is None else _unit_verdict(root / unit.place, record)

    for done, (unit, (record, verdict)) in enumerate(zip(units, thread_map(check, units), strict=True), 1):
        advance(done / len(units))
        if record is None or verdict is None:
            altered.append(f"{RECORDS}/{unit.name}.json")
            continue
        made += len(record.specimens)
        files += verdict.files
        size += verdict.bytes
        prefix = "" if unit.place.suffix == ".tar" else f"{unit.place.as_posix()}/"
        altered += [f"{prefix}{name}" for name in verdict.differences.altered]
        missing += [f"{prefix}{name}" for name in verdict.differences.missing]
        added += [f"{prefix}{name}" for name in verdict.differences.added]
        if len(record.specimens) == 1 and prefix and digest_of(record.files) != record.specimens[0].digest:
            altered.append(f"{RECORDS}/{unit.name}.json")
    if made < identity.count:
        missing.append(f"{identity.count - made} specimens")
    return Integrity(root, DATA_SET, files, size, Differences(tuple(altered), tuple(missing), tuple(added)))


def _others(root: Path, units: Sequence[Unit]) -> list[str]:
    """Return what lies in a data set, or in the folders of its specimens and records, and is no part of it."""
    places = {unit.place for unit in units} | {Path(RECORDS, f"{unit.name}.json") for unit in units}
    ours = {*TOP_FILES, WRITTEN, LOCK_NAME, DAMAGED, *(place.parts[0] for place in places)}
    others = [entry.name for entry in root.iterdir() if entry.name not in ours and not is_left_by_system(entry.name)]
    for folder in sorted({place.parent for place in places if (root / place.parent).is_dir()}):
        inside = (folder / entry.name for entry in (root / folder).iterdir() if not is_left_by_system(entry.name))
        others += [place.as_posix() for place in inside if place not in places]
    return sorted(others)


def _unit(identity: Identity, record: Path) -> Unit:
    shards = identity.arguments.get("format") == "webdataset"
    place = Path("shards", f"{record.stem}.tar") if shards else Path("specimens", record.stem)
    return Unit(record.stem, place, ())


def _unit_verdict(place: Path, record: Record) -> Integrity:
    size = sum(n_bytes for n_bytes, _ in record.files.values())
    if place.suffix == ".tar":
        whole = Differences() if _is_shard(place, record) else Differences(altered=(f"shards/{place.name}",))
        return Integrity(place, "shard", 1, size, whole)
    contents = Contents(SPECIMEN, record.files)
    parts = differences(place, contents) if place.is_dir() else Differences(missing=(place.name,))
    return Integrity(place, SPECIMEN, len(record.files), size, parts)


def _is_shard(place: Path, record: Record) -> bool:
    return place.is_file() and (place.stat().st_size, sha256_of(place)) == record.files.get(place.name)


def _is_output(path: Path) -> bool:
    return path.is_dir() and (read_contents(path) is not None or (path / DATA_SET_FILE).is_file())


def _looks_like_one(path: Path) -> bool:
    """Say whether a folder has what a comparison, a store or a specimen has: one that lost its list still counts."""
    return any((path / name).exists() for name in ("result.json", "zarr.json", "truth"))


def _folders(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(entry for entry in path.iterdir() if entry.is_dir() and not entry.name.startswith("."))


def _record(place: Path) -> Record:
    root = place.parent.parent
    record = read_record(root, _unit(read_identity(root), Path(f"{place.stem}.json")))
    if record is None:
        raise EndoctError(f"{root} has no record of {place.name} that can be read", remedy="start its dataset again")
    return record
