"""The files of a data set: their digests, how they come into the set, and the records of what is finished.

A record is one file a unit, ``records/NAME.json``, written after what it describes. Whatever is replaced is removed
only where its record lists its bytes; else it stays, in ``damaged/`` or nearby.
"""

import hashlib
import json
import os
import tarfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.contents import Contents, differences, sync
from endoct.base.files.files import inside, plain_name, read_small, sha256_of
from endoct.base.files.json_values import read_object
from endoct.base.files.scratch import REPLACED, exchange, keep_aside, new_file, put_new, scratch_next_to, uninterrupted
from endoct.workbench.dataset.plan import DatasetPlan, Unit, job, units

DAMAGED = "damaged"
WRITTEN = ".written.json"
"""The digests of the files at the top of the set, by which changed ones are recognised."""

Files = Mapping[str, tuple[int, str]]
"""Path → (bytes, sha256)."""
RECORDS = "records"
MOST_BYTES = 16_000_000
Scalar = bool | int | float | str


def store_and_digest(path: Path) -> tuple[int, str]:
    """Make sure that the file is on the disk; return its size in bytes and its sha256."""
    sync(path)
    return path.stat().st_size, sha256_of(path)


def digest_of(files: Files) -> str:
    """Return the sha256 of the lines "sha256  path", sorted by path: that of ``sha256sum`` over them all."""
    lines = "".join(f"{sha}  {path}\n" for path, (_, sha) in sorted(files.items()))
    return hashlib.sha256(lines.encode("utf-8", "surrogatepass")).hexdigest()  # damaged records have any letters


def add_array(tar: tarfile.TarFile, name: str, values: NDArray[Any]) -> None:
    """Add an array to a tar file, as ``.npy``."""
    buffer = BytesIO()
    np.save(buffer, values, allow_pickle=False)
    add_member(tar, name, buffer.getvalue())


def add_member(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file to a tar file, with the same bytes from any machine."""
    info = tarfile.TarInfo(name)  # owner, time and rights are those of TarInfo: nobody, 1970, 644
    info.size = len(data)
    tar.addfile(info, BytesIO(data))


def put_unit(made: Path, place: Path, scratch: Path, root: Path, known: tuple[Files, ...]) -> None:
    """Put a specimen's folder, or a shard, in its place in the set ``root``.

    What is there goes where one of ``known`` lists all its bytes; else it is moved to ``damaged/`` first.
    """
    with uninterrupted():
        if os.path.lexists(place) and not any(_is_known(place, files) for files in known):
            (root / DAMAGED).mkdir(exist_ok=True)
            keep_aside(place, root / DAMAGED / place.name)
        try:
            put_new(made, place)
        except FileExistsError:
            aside = scratch / REPLACED / place.name
            aside.parent.mkdir(exist_ok=True)
            exchange(made, place, aside)  # the old one goes with the scratch folder
        sync(place.parent)


def _is_known(place: Path, files: Files) -> bool:
    """Say whether all bytes of a specimen's folder, or of a shard, are in ``files``."""
    if not place.is_dir():
        return (place.stat().st_size, sha256_of(place)) == files.get(place.name)
    found = differences(place, Contents("specimen", files))
    return not found.altered and not found.added


def count_damaged(root: Path) -> int:
    """Return how many units were moved to ``damaged/`` since the set was begun."""
    return sum(1 for _ in (root / DAMAGED).iterdir()) if (root / DAMAGED).is_dir() else 0


@contextmanager
def top_file(root: Path, name: str) -> Iterator[IO[bytes]]:
    """Open a file at the top of the set to write anew; one that was changed since stays, as NAME.kept-1."""
    path, written = root / name, _written(root)
    with scratch_next_to(path) as scratch:
        made = scratch / name
        with made.open("wb") as file:
            yield file
        digest = store_and_digest(made)[1]
        # noted first, so that a run that dies in between leaves no unknown file
        _note_written(root, written | {name: [*written.get(name, [])[-1:], digest]})
        with uninterrupted():
            if os.path.lexists(path) and sha256_of(path) not in (digest, *written.get(name, ())):
                keep_aside(path, path)
            made.replace(path)
        sync(root)


def settle_written(root: Path) -> None:
    """Note of every file at the top only what is there now: so the note depends on the set alone, not on its past."""
    written = _written(root)
    now = {name: [sha256_of(root / name)] for name in sorted(written) if (root / name).is_file()}
    if settled := {name: digest for name, digest in now.items() if digest[0] in written[name]}:
        _note_written(root, settled)


def changed_top_files(root: Path) -> list[str]:
    """Return the names of the files at the top of the set that are not as they were written, or gone."""
    return [
        name
        for name, digests in sorted(_written(root).items())
        if not (root / plain_name(name, "a file of the set")).is_file() or sha256_of(root / name) not in digests
    ]


def _written(root: Path) -> dict[str, list[str]]:
    try:
        stored = read_object(root / WRITTEN)
        return {name: [str(digest) for digest in digests] for name, digests in stored.items()}
    except (EndoctError, TypeError):
        return {}  # then every file that differs is kept


def _note_written(root: Path, written: Mapping[str, list[str]]) -> None:
    with new_file(root / WRITTEN) as file:
        file.write((json.dumps(written, indent=1) + "\n").encode())


@dataclass(frozen=True)
class MadeSpecimen:
    """One finished specimen.

    ``digest`` is the sha256 of the lines of ``sha256sum`` over its files as simulated, sorted by path. So it is the
    same for a folder and in a shard. ``parameters`` are all drawn numbers and words, "part.name" → value.
    """

    index: int
    seed: int
    bore_seed: int
    digest: str
    parameters: Mapping[str, Scalar]


@dataclass(frozen=True)
class Record:
    """One finished unit: ``files``, path below the unit's place (or the shard's own name) → (bytes, sha256)."""

    specimens: tuple[MadeSpecimen, ...]
    files: Mapping[str, tuple[int, str]]
    seconds: float

    @property
    def bytes(self) -> int:
        """The size of all files."""
        return sum(size for size, _ in self.files.values())


def write_record(root: Path, unit: Unit, record: Record) -> None:
    """Write the record of ``unit``, whole or not at all."""
    with new_file(_path(root, unit)) as file:
        file.write((json.dumps(asdict(record), indent=1) + "\n").encode())


def read_record(root: Path, unit: Unit) -> Record | None:
    """Return the record of ``unit``, None where there is none or it cannot be read."""
    try:
        stored: dict[str, Any] = json.loads(read_small(_path(root, unit), MOST_BYTES))
        return Record(
            specimens=tuple(MadeSpecimen(**specimen) for specimen in stored["specimens"]),
            files={path: (int(size), str(sha)) for path, (size, sha) in stored["files"].items()},
            seconds=float(stored["seconds"]),
        )
    except (EndoctError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None


def made_beyond(root: Path, plan: DatasetPlan) -> list[str]:
    """Return the names of specimens and shards in ``root`` that ``plan`` would not make, or not with all they hold."""
    wanted = {unit.name: unit for unit in units(plan)}
    beyond = [
        place.name.removesuffix(".tar")
        for folder in ("specimens", "shards")
        for place in sorted((root / folder).glob("[!.]*"))
        if place.name.removesuffix(".tar") not in wanted
    ]
    for name, unit in wanted.items():
        record = read_record(root, unit)
        if record is not None and any(made.index not in unit.indices for made in record.specimens):
            beyond.append(name)
    return sorted(beyond)


def sound_record(root: Path, unit: Unit) -> Record | None:
    """Return the record of ``unit`` where every file it names is there with its bytes, else None.

    It may list fewer specimens than ``unit`` has: of a shard that was the last of a smaller set.
    """
    record = read_record(root, unit)
    if record is None:
        return None
    return record if not faults(root, unit, record) else None


def faults(root: Path, unit: Unit, record: Record) -> list[str]:
    """Return the paths of the files that ``record`` names and that are not there with their bytes."""
    place, wrong = root / unit.place, []
    for path, (size, digest) in record.files.items():
        try:
            file = (
                place if path == place.name and not place.is_dir() else inside(place, path, f"the record {unit.name}")
            )
            if file.is_symlink() or file.stat().st_size != size or sha256_of(file) != digest:
                wrong.append(path)
        except (EndoctError, OSError):
            wrong.append(path)
    return wrong


def finished(root: Path, plan: DatasetPlan, unit: Unit) -> Record | None:
    """Return the record of ``unit`` where it is finished as ``plan`` wants it, else None."""
    record = sound_record(root, unit)
    if record is None:
        return None
    wanted = [(j.index, j.seed, j.bore_seed) for j in (job(plan, index) for index in unit.indices)]
    return record if [(s.index, s.seed, s.bore_seed) for s in record.specimens] == wanted else None


def _path(root: Path, unit: Unit) -> Path:
    return root / RECORDS / f"{unit.name}.json"
