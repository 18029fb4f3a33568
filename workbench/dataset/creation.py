"""Make a data set, or what is missing of one; or forecast what that would take. What `endoct dataset` prints of it."""

import hashlib
import math
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from threading import Event

from endoct.base.compute.own_process import undone_in_the_end
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.files.output import check_place
from endoct.base.files.scratch import HeldError, TemporaryFolder, clear_dead_scratch, held
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.presets import PRESETS
from endoct.workbench.dataset.identity import check_identity, write_identity
from endoct.workbench.dataset.overview import MANIFEST, SHEET, readme, text, write_contact_sheet, write_manifest
from endoct.workbench.dataset.plan import DatasetPlan, Unit, job, split_counts, units
from endoct.workbench.dataset.set_files import (
    DAMAGED,
    RECORDS,
    WRITTEN,
    count_damaged,
    finished,
    settle_written,
    top_file,
)
from endoct.workbench.dataset.unit_files import Done, Make, make_on, make_unit, simulate_specimen
from endoct.workbench.running.outputs import DATA_SET_FILE
from endoct.workbench.running.progress import SilentStages, Stages
from endoct.workbench.running.refusals import refusing_disk_errors
from endoct.workbench.settings import ranges_text

LOCK_NAME = ".lock"
TOP_FILES = (DATA_SET_FILE, "LICENSE", "README.md", MANIFEST, SHEET)


@dataclass(frozen=True)
class Built:
    """What a run did: specimens in the set, made now, and finished before; bytes of them all; seconds it took.

    ``set_aside``: how many specimens or shards were not as their records say, and lie in ``damaged/`` now.
    """

    count: int
    made: int
    kept: int
    bytes: int
    seconds: float
    set_aside: int = 0


@dataclass(frozen=True)
class Forecast:
    """What making the rest of a set would take, estimated from one specimen made for that.

    ``missing`` specimens in so many ``files`` and ``bytes``, where there is room for ``free_bytes``; ``seconds``
    for ``workers`` processes that do not slow one another down.
    """

    missing: int
    files: int
    bytes: int
    free_bytes: int
    seconds: float
    workers: int


def make_dataset(
    output: Path | str,
    plan: DatasetPlan,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    stages: Stages | None = None,
    make: Make = simulate_specimen,
) -> Built:
    """Make the data set of ``plan`` in the folder ``output``, or what is missing of it there.

    ``workers`` processes of one thread each make it (default: one for each processor); one alone is this process.
    Or the workers of the dask ``scheduler`` at that address do, which must see ``output`` under the same name. The
    bytes depend on none of that. A script that calls this with more than one worker needs the usual
    ``if __name__ == "__main__":``. Raises :class:`EndoctError` where ``output`` holds something else, another run is at
    work in it, or a worker does not see it. It is also raised where the disk is full or read-only, or a specimen cannot
    be made.
    """
    start = time.perf_counter()
    stages = stages or SilentStages()
    root, workers = _checked(output, plan, workers, scheduler)
    with refusing_disk_errors(root), _begun(root, plan) as handed_out:
        _clear(root)
        set_aside = count_damaged(root)
        sizes = _finished_bytes(root, plan, stages)
        missing = [unit for unit in units(plan) if unit.name not in sizes]
        size = sum(sizes.values())
        to_make = sum(len(unit.indices) for unit in missing)
        made = gone_by = 0
        if missing:
            try:
                with (
                    stages.stage(f"{to_make} specimens") as advance,
                    _makers(root, plan, missing, workers, scheduler, make, handed_out) as makers,
                ):
                    for done in makers:
                        made += done.made
                        size += done.bytes
                        gone_by += done.specimens
                        advance(gone_by / to_make)
            finally:
                _clear(root)  # what workers left that died, or that were ended with their cluster
        with stages.stage("manifest and contact sheet"):
            write_manifest(root, plan)
            write_contact_sheet(root)
        settle_written(root)
    set_aside = count_damaged(root) - set_aside
    return Built(plan.count, made, plan.count - made, size, time.perf_counter() - start, set_aside)


def forecast(
    output: Path | str,
    plan: DatasetPlan,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    stages: Stages | None = None,
    make: Make = simulate_specimen,
) -> Forecast:
    """Estimate the time and space of :func:`make_dataset` by making one specimen in a temporary folder.

    Nothing else is written. Raises :class:`EndoctError` as :func:`make_dataset` does.
    """
    stages = stages or SilentStages()
    root, workers = _checked(output, plan, workers, scheduler)
    if scheduler is not None:
        from endoct.workbench.running.cluster import existing_cluster

        with existing_cluster(scheduler) as client:
            workers = max(1, sum(client.nthreads().values()))
    missing = [unit for unit in units(plan) if finished(root, plan, unit) is None]
    with stages.stage("one specimen for the estimate"), TemporaryFolder("dry-run") as folder:
        trial = replace(plan, count=1)
        unit = next(units(trial))
        import_module("endoct.synthetic.specimen_files")  # what every process loads once is no part of that time
        done = make_unit(Path(folder), trial, unit, make)
        record = finished(Path(folder), trial, unit)
        files_a_unit = 1 + (len(record.files) if record is not None else 0)
    specimens = sum(len(unit.indices) for unit in missing)
    existing = next(path for path in (root, *root.parents) if path.exists())
    return Forecast(
        missing=specimens,
        files=files_a_unit * len(missing),
        bytes=done.bytes * specimens,
        free_bytes=shutil.disk_usage(existing).free,
        seconds=done.seconds * math.ceil(specimens / workers),
        workers=workers,
    )


def _checked(output: Path | str, plan: DatasetPlan, workers: int | None, scheduler: str | None) -> tuple[Path, int]:
    """Return the folder of the set and the number of processes. Raises where they or the plan are impossible."""
    if workers is not None and scheduler is not None:
        raise EndoctError("--workers and --scheduler exclude one another", remedy="leave one of them out")
    if workers is not None and workers < 1:
        raise EndoctError("--workers cannot be that", found=str(workers), expected="1 or more")
    root = Path(os.path.abspath(output))  # noqa: PTH100 - where a link leads may differ between machines
    check_place(root)
    for name in ("specimens", "shards", RECORDS, DAMAGED, LOCK_NAME):
        if (root / name).is_symlink():
            raise EndoctError(f"{root / name} is a link", expected="a data set in one place", remedy="move it away")
    check_identity(root, plan)
    first = job(plan, 0)
    draw(plan.preset, first.seed, bore_seed=first.bore_seed, ranges=plan.ranges)
    return root, workers or os.cpu_count() or 1


@contextmanager
def _begun(root: Path, plan: DatasetPlan) -> Iterator[Event]:
    """Hold the lock of ``root`` and write the files that describe the set; leave nothing where no specimen was made.

    The event that is yielded is to be set once processes that outlive this one may make something.
    """
    handed_out = Event()

    def leave_nothing() -> None:
        if made and not handed_out.is_set() and not any((root / RECORDS).glob("*.json")):
            _clear(root)
            for name in (*TOP_FILES, WRITTEN, LOCK_NAME):
                (root / name).unlink(missing_ok=True)
            _remove_empty(path for path in root.iterdir() if path.is_dir())
            _remove_empty(made)

    made = [folder for folder in (root, *root.parents) if not folder.exists()]
    try:
        root.mkdir(parents=True, exist_ok=True)
        with held(root / LOCK_NAME), undone_in_the_end(leave_nothing):
            check_identity(root, plan)  # again: another run may have begun one just now
            try:
                write_identity(root, plan)
                for name, said in (("LICENSE", text("LICENSE")), ("README.md", readme(plan))):
                    with top_file(root, name) as file:
                        file.write(said.encode())
                yield handed_out
            finally:
                leave_nothing()
            os.truncate(root / LOCK_NAME, 0)  # who made a set is nobody's business
    except HeldError as error:
        raise EndoctError(
            f"another run is at work in {root}", found=str(error), remedy="wait for that, or end it"
        ) from error
    finally:
        _remove_empty(made)  # where it came to nothing before anything was begun


def _finished_bytes(root: Path, plan: DatasetPlan, stages: Stages) -> dict[str, int]:
    """Return the bytes of every unit that is finished, by name; each byte is read and held against its record."""
    every = list(units(plan)) if (root / RECORDS).is_dir() else []
    sizes: dict[str, int] = {}
    with stages.stage("check of what is there") as advance:
        records = thread_map(lambda unit: finished(root, plan, unit), every)
        for done, (unit, record) in enumerate(zip(every, records, strict=True), 1):
            if record is not None:
                sizes[unit.name] = record.bytes
            advance(done / len(every))
    return sizes


def _clear(root: Path) -> None:
    clear_dead_scratch(root)
    for folder in sorted(root.iterdir()):
        if folder.is_dir() and not folder.is_symlink() and not folder.name.startswith("."):
            clear_dead_scratch(folder)


def _remove_empty(folders: Iterable[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # something lies in it
            folder.rmdir()


@contextmanager
def _makers(
    root: Path,
    plan: DatasetPlan,
    missing: Sequence[Unit],
    workers: int,
    scheduler: str | None,
    make: Make,
    handed_out: Event,
) -> Iterator[Iterator[Done]]:
    """Yield what makes the ``missing`` units.

    Workers of somebody else's cluster finish what they are at, whatever becomes of this run: then the set stays begun.
    """
    if scheduler is None and workers == 1:
        yield (make_unit(root, plan, unit, make) for unit in missing)
        return
    from endoct.workbench.running.cluster import existing_cluster, own_cluster

    if scheduler is not None:
        with existing_cluster(scheduler) as client:
            handed_out.set()
            yield make_on(client, root, plan, missing, make)
    else:
        with own_cluster(min(workers, len(missing))) as client:
            yield make_on(client, root, plan, missing, make)


def run_dataset(
    output: Path, plan: DatasetPlan, *, workers: int | None, scheduler: str | None, dry_run: bool, stages: Stages
) -> tuple[dict[str, object], list[str]]:
    """Make the data set, or only estimate it; return the result as facts and as lines for people."""
    if dry_run:
        return _dry_run(output, plan, workers, scheduler, stages)
    try:
        built = make_dataset(output, plan, workers=workers, scheduler=scheduler, stages=stages)
    except KeyboardInterrupt:
        kept = f"{output} is begun, and the same command goes on with it" if (output / DATA_SET_FILE).exists() else ""
        raise KeyboardInterrupt(kept) from None
    manifest = output / MANIFEST
    digest = hashlib.sha256(manifest.read_bytes()).hexdigest()
    facts = {"output": str(output), **asdict(built), "seconds": round(built.seconds, 1), "manifest_sha256": digest}
    return facts, [
        f"data set: {output} ({built.count} specimens, {_size(built.bytes)}; {built.made} made in "
        f"{_duration(built.seconds)}, {built.kept} were there)",
        f"manifest: {manifest} (sha256 {digest[:16]}…)",
    ]


def _dry_run(
    output: Path, plan: DatasetPlan, workers: int | None, scheduler: str | None, stages: Stages
) -> tuple[dict[str, object], list[str]]:
    reckoned = forecast(output, plan, workers=workers, scheduler=scheduler, stages=stages)
    counts, size = split_counts(plan), PRESETS[plan.preset]
    drawn = dict(size.ranges) | dict(plan.ranges)
    facts = {
        "output": str(output),
        "count": plan.count,
        "bores": -(-plan.count // plan.recordings_per_bore),
        "splits": counts,
        "drawn_otherwise": {key: list(range_) for key, range_ in drawn.items()},
        **asdict(reckoned),
        "seconds": round(reckoned.seconds, 1),
    }
    return facts, [
        f"to make: {reckoned.missing} of {plan.count} specimens of {facts['bores']} bores "
        f"({', '.join(f'{split} {count}' for split, count in counts.items())})",
        f"each: {size.n_slices} B-scans of {size.n_ascans} A-scans, {size.n_frames} endoscope frames, truth"
        f"{' and labels' if plan.labels else ''}; bone: {' or '.join(size.bone)}",
        f"drawn otherwise than docs/reference/parameters.md says: {ranges_text(drawn)}",
        f"about {reckoned.files} files and {_size(reckoned.bytes)}; {_size(reckoned.free_bytes)} are free",
        f"about {_duration(reckoned.seconds)} with {reckoned.workers} processes, reckoned from one specimen made alone",
    ]


def _size(n_bytes: int) -> str:
    power = min(4, max(0, math.floor(math.log10(max(1, n_bytes)) / 3)))
    return f"{n_bytes / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
