"""The records of what is finished: one file a unit, ``records/NAME.json``, written after what it describes."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError
from endoct.base.files.files import inside, read_small, sha256_of
from endoct.base.files.scratch import new_file
from endoct.workbench.dataset.plan import Plan, Unit, job, units

RECORDS = "records"
MOST_BYTES = 16_000_000

Scalar = bool | int | float | str


@dataclass(frozen=True)
class MadeSpecimen:
    """One finished specimen.

    ``digest`` is the sha256 of the lines of ``sha256sum`` over its files as simulated, sorted by path, so it is the
    same for a folder and in a shard; ``parameters`` are all drawn numbers and words, "part.name" → value.
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


def made_beyond(root: Path, plan: Plan) -> list[str]:
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


def finished(root: Path, plan: Plan, unit: Unit) -> Record | None:
    """Return the record of ``unit`` where it is finished as ``plan`` wants it, else None."""
    record = sound_record(root, unit)
    if record is None:
        return None
    wanted = [(j.index, j.seed, j.bore_seed) for j in (job(plan, index) for index in unit.indices)]
    return record if [(s.index, s.seed, s.bore_seed) for s in record.specimens] == wanted else None


def _path(root: Path, unit: Unit) -> Path:
    return root / RECORDS / f"{unit.name}.json"
