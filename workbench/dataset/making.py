"""Makes one unit of a data set, in whatever process: a specimen's folder, or a shard."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from endoct.stitching.errors import EndoctError
from endoct.stitching.scratch import scratch_beside
from endoct.workbench.dataset.files import digest_of, put_unit, store_and_digest
from endoct.workbench.dataset.plan import Job, Plan, Unit, job
from endoct.workbench.dataset.records import (
    MadeSpecimen,
    Record,
    Scalar,
    finished,
    read_record,
    sound_record,
    write_record,
)
from endoct.workbench.dataset.shards import add_specimen, copy_specimens, new_shard
from endoct.workbench.running.disk_errors import refusing_disk_errors

Make = Callable[[Path, Plan, Job], None]
"""Makes a specimen in a folder that does not exist yet."""


@dataclass(frozen=True)
class Done:
    """What the maker of a unit reports: specimens in it, those that it had to make, and their seconds and bytes."""

    specimens: int
    made: int
    seconds: float
    bytes: int


def simulate_specimen(folder: Path, plan: Plan, job: Job) -> None:
    """Simulate the specimen on one thread of this process."""
    from endoct.synthetic.specimen import simulate

    with _one_thread():
        simulate(
            folder,
            preset=plan.preset,
            seed=job.seed,
            bore_seed=job.bore_seed,
            ranges=plan.ranges,
            labels=plan.labels,
            workers=1,
        )


def make_unit(root: Path, plan: Plan, unit: Unit, make: Make = simulate_specimen) -> Done:
    """Make ``unit`` of the data set in ``root`` and write its record; leave what is finished already.

    A unit may come twice: the worker that had it may have died after finishing it and before saying so.
    Raises :class:`EndoctError` where it cannot be made or written.
    """
    with refusing_disk_errors(root):
        if (record := finished(root, plan, unit)) is not None:
            return Done(len(unit.indices), 0, 0.0, record.bytes)
        start = time.perf_counter()
        place = root / unit.place
        specimens: tuple[MadeSpecimen, ...]
        with scratch_beside(place) as scratch:
            made = scratch / place.name
            if plan.format == "folders":
                specimen, files = _make_specimen(made, plan, job(plan, unit.indices[0]), make)
                specimens, n_made = (specimen,), 1
            else:
                old = sound_record(root, unit)
                specimens, n_made = _make_shard(scratch, place, old, plan, unit, make)
                files = {place.name: store_and_digest(made)}
            if (record := finished(root, plan, unit)) is not None:  # by a worker that an earlier run had left behind
                return Done(len(unit.indices), 0, 0.0, record.bytes)
            old_record = read_record(root, unit)
            put_unit(made, place, scratch, root, (files, *([old_record.files] if old_record else [])))
            seconds = time.perf_counter() - start
            record = Record(specimens, files, round(seconds, 3))
            write_record(root, unit, record)
    return Done(len(unit.indices), n_made, seconds, record.bytes)


def _make_specimen(folder: Path, plan: Plan, job: Job, make: Make) -> tuple[MadeSpecimen, dict[str, tuple[int, str]]]:
    try:
        make(folder, plan, job)
    except EndoctError as error:
        raise EndoctError(
            f"specimen {job.index} (seed {job.seed}, bore seed {job.bore_seed}) cannot be made: {error.what}",
            found=error.found,
            expected=error.expected,
            remedy=error.remedy,
        ) from error
    files = {
        path.relative_to(folder).as_posix(): store_and_digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    sample = json.loads((folder / "truth" / "sample.json").read_text(encoding="utf-8"))
    parameters: dict[str, Scalar] = {
        f"{part}.{name}": value
        for part in ("bore", "oct", "endoscope")
        for name, value in sample[part].items()
        if isinstance(value, bool | int | float | str)
    }
    return MadeSpecimen(job.index, job.seed, job.bore_seed, digest_of(files), parameters), files


def _make_shard(
    scratch: Path, place: Path, old: Record | None, plan: Plan, unit: Unit, make: Make
) -> tuple[tuple[MadeSpecimen, ...], int]:
    """Write the tar of ``unit`` in ``scratch``; what an ``old``, shorter one at ``place`` holds is copied from it."""
    jobs = [job(plan, index) for index in unit.indices]
    specimens: list[MadeSpecimen] = []
    with new_shard(scratch / place.name) as tar:
        if old is not None and _begins(unit, old) and old.files[place.name] == store_and_digest(place):
            copy_specimens(place, tar)
            specimens.extend(old.specimens)
        missing = jobs[len(specimens) :]
        for one in missing:
            folder = scratch / one.name
            specimen, _ = _make_specimen(folder, plan, one, make)
            add_specimen(tar, one.name, folder)
            shutil.rmtree(folder)
            specimens.append(specimen)
    return tuple(specimens), len(missing)


def _begins(unit: Unit, old: Record) -> bool:
    return [specimen.index for specimen in old.specimens] == list(unit.indices[: len(old.specimens)])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep OpenCV to one thread: each of many processes has one core."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
