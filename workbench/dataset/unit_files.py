"""Units of a data set: a specimen's folder or a shard, made in this process or by the workers of a cluster.

A unit is made in the same way in whatever process. Shards are tar files as the webdataset library reads them, with the
same bytes from any machine.
"""

import json
import shutil
import tarfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular
from endoct.base.files.scratch import scratch_next_to
from endoct.workbench.dataset.identity import check_identity, check_worker, remove_abandoned
from endoct.workbench.dataset.loader import read_specimen
from endoct.workbench.dataset.plan import DatasetPlan, Job, Unit, job
from endoct.workbench.dataset.set_files import (
    MadeSpecimen,
    Record,
    Scalar,
    add_array,
    add_member,
    digest_of,
    finished,
    put_unit,
    read_record,
    sound_record,
    store_and_digest,
    write_record,
)
from endoct.workbench.running.refusals import refusing_disk_errors

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 1
"""Every thread of the cluster has so many units waiting, so that none runs dry."""
POLL_S = 5.0
LONELY_S = 60.0
AGAIN = "start again with the same arguments; what is finished is kept"
AS_THEY_ARE = {
    "sample.json": "truth/sample.json",
    "recording.json": "truth/recording.json",
    "oct.toml": "oct/acquisition.toml",
    "endoscope.toml": "endoscope/acquisition.toml",
}
"""These files of a specimen are in a shard as they are, by the endings of their names there."""

Make = Callable[[Path, DatasetPlan, Job], None]
"""Makes a specimen in a folder that does not exist yet."""


@dataclass(frozen=True)
class Done:
    """What the maker of a unit reports: specimens in it, those that it had to make, and their seconds and bytes."""

    specimens: int
    made: int
    seconds: float
    bytes: int


def simulate_specimen(folder: Path, plan: DatasetPlan, job: Job) -> None:
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


def make_unit(root: Path, plan: DatasetPlan, unit: Unit, make: Make = simulate_specimen) -> Done:
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
        with scratch_next_to(place) as scratch:
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


def _make_specimen(
    folder: Path, plan: DatasetPlan, job: Job, make: Make
) -> tuple[MadeSpecimen, dict[str, tuple[int, str]]]:
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
    scratch: Path, place: Path, old: Record | None, plan: DatasetPlan, unit: Unit, make: Make
) -> tuple[tuple[MadeSpecimen, ...], int]:
    """Write the tar of ``unit`` in ``scratch``; what an ``old``, shorter one at ``place`` holds is copied from it."""
    jobs = [job(plan, index) for index in unit.indices]
    specimens: list[MadeSpecimen] = []
    with tarfile.open(scratch / place.name, "x", format=tarfile.USTAR_FORMAT) as tar:
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


def make_on(client: "Client", root: Path, plan: DatasetPlan, wanted: Iterable[Unit], make: Make) -> Iterator[Done]:
    """Have the client's workers make the units, few at a time; yield them as they are done.

    A unit whose worker dies goes to another. Raises :class:`EndoctError` where a unit cannot be made, keeps
    killing its workers, or the cluster is lost.
    """
    from distributed import KilledWorker, wait

    left = iter(wanted)
    running: set[Future[Done]] = set()
    last_seen = time.monotonic()
    try:
        while True:
            threads = sum(client.nthreads().values())  # a cluster may grow and shrink
            for unit in islice(left, max(0, (1 + AHEAD) * threads - len(running))):
                running.add(client.submit(_make_on_worker, root, plan, unit, make, pure=False))
            if threads:
                last_seen = time.monotonic()
                if not running:
                    return
            elif time.monotonic() - last_seen > LONELY_S:
                raise EndoctError("the cluster has no worker left", remedy=AGAIN)
            if not running:
                time.sleep(POLL_S)
                continue
            try:
                done, running = wait(running, timeout=POLL_S, return_when="FIRST_COMPLETED")
            except TimeoutError:
                continue
            for future in done:
                yield future.result()
    except KilledWorker as error:
        raise EndoctError(
            "a specimen or shard cannot be made",
            found="one worker after the other died at it",
            remedy=f"see whether memory is short; {AGAIN}",
        ) from error
    except (CancelledError, OSError) as error:
        raise EndoctError("the cluster was lost", found=str(error)[:200], remedy=AGAIN) from error
    finally:
        with suppress(CancelledError, OSError):
            client.cancel(list(running))


def _make_on_worker(root: Path, plan: DatasetPlan, unit: Unit, make: Make) -> Done:
    """Make ``unit``; put it only into the set that it was made for, which may be gone by then, or another."""

    def make_and_look(folder: Path, of: DatasetPlan, job: Job) -> None:
        make(folder, of, job)
        check_worker(root)
        check_identity(root, of)

    check_worker(root)
    try:
        return make_unit(root, plan, unit, make_and_look)
    except EndoctError:
        remove_abandoned(root)
        raise


def add_specimen(tar: tarfile.TarFile, name: str, folder: Path) -> None:
    """Add the specimen in ``folder``: its arrays as ``NAME.array.npy``, its sidecars and what was drawn as they are."""
    for array, values in read_specimen(folder).items():
        add_array(tar, f"{name}.{array}.npy", values)
    for member, path in AS_THEY_ARE.items():
        add_member(tar, f"{name}.{member}", (folder / path).read_bytes())


def copy_specimens(shard: Path, tar: tarfile.TarFile) -> None:
    """Add all that ``shard`` holds."""
    with open_regular(shard) as file, tarfile.open(fileobj=file, mode="r:") as old:
        for member in old:
            if (inner := old.extractfile(member)) is not None:
                tar.addfile(member, inner)
