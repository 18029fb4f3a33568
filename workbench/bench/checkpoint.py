"""The checkpoint of a run of the bench, so that a stopped run resumes, and what a run states about itself.

``RESULTS.unfinished`` lies next to the output. Its ``run.json`` says what is run and with what. A file of rows follows
for every source of cases on which all methods have been run. Each file appears whole or not at all, and the folder
goes when the output is complete. While a run uses it, it holds the lock in it.

A run states what is run, with which versions, and on which machine.
"""

import hashlib
import json
import os
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from pydantic import TypeAdapter

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.json_values import read_object
from endoct.base.files.scratch import HeldError, clear_dead_scratch, held, new_file
from endoct.workbench.bench.runner import BenchPlan, MethodResult
from endoct.workbench.bench.task import module_of, origin
from endoct.workbench.running.outputs import versions
from endoct.workbench.running.refusals import refusing_disk_errors

Facts = dict[str, object]
"""Values that can be written as JSON, by name."""
RUN, LOCK = "run.json", "lock"
_ROWS = re.compile(r"[0-9]{6}\.json")
MOST_BYTES = 16_000_000
PARTS = ("stitching", "modalities", "fusion", "synthetic", "workbench")


def plan_facts(plan: BenchPlan) -> Facts:
    """Return what is run, on which cases, and with which versions."""
    task = plan.load_task()
    return {
        "task": task.name,
        "methods": {name: origin(task, name) for name in plan.methods},
        "seeds": list(plan.seeds),
        "cases_a_seed": plan.count,
        "conditions": {name: list(range_) for name, range_ in (plan.ranges or {}).items()},
        "data": [str(folder) for folder in plan.own],
        "versions": versions(),
    }


def machine() -> Facts:
    """Return the processor, its cores and how many of them this process may use, the memory and the system."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    facts: Facts = {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "cores_usable": usable,
        "system": platform.platform(terse=True),
        "omp_num_threads": os.environ.get("OMP_NUM_THREADS", "not set"),
    }
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        facts["memory_gb"] = round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    return facts


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


@dataclass(frozen=True)
class Checkpoint:
    """The folder of what is finished; sources of cases go by their place in the plan."""

    folder: Path

    def read(self) -> dict[int, list[MethodResult]]:
        """Return the rows of every source that is finished. Raises :class:`EndoctError` where a file is damaged."""
        files = sorted(path for path in self.folder.iterdir() if _ROWS.fullmatch(path.name))
        return {int(path.stem): _rows(path) for path in files}

    def save(self, place: int, rows: Sequence[MethodResult]) -> None:
        """Store the rows of one source."""
        _write(self.folder / f"{place:06d}.json", [asdict(row) for row in rows])

    @contextmanager
    def said_to_resume(self, plan: BenchPlan) -> Iterator[None]:
        """Let an interruption say how many cases are kept. Raises :class:`EndoctError` where another run goes on."""
        try:
            with _in_use(self.folder):
                yield
        except KeyboardInterrupt:
            kept = f"{len(self.read())} of {len(plan.sources)} cases are kept in {self.folder}"
            raise KeyboardInterrupt(f"{kept}; the same command goes on") from None

    def remove(self) -> None:
        """Remove the folder, once the output is complete."""
        _remove(self.folder)


def open_checkpoint(output: Path, plan: BenchPlan, *, overwrite: bool) -> Checkpoint:
    """Return the checkpoint of ``plan`` next to ``output``, new or as an earlier run of the same plan left it.

    Raises :class:`EndoctError` where it belongs to another plan, or to other code; with ``overwrite`` that goes.
    """
    folder = output.with_name(f"{output.name}.unfinished")
    wanted = json.loads(json.dumps(plan_facts(plan) | {"source": source_digests(plan)}))
    begun = None
    if os.path.lexists(folder / RUN):
        with refusing(f"{folder / RUN} cannot be read", remedy="remove that folder"):
            begun = read_object(folder / RUN, MOST_BYTES)
    if begun == wanted:
        clear_dead_scratch(folder)
        return Checkpoint(folder)
    if begun is not None and not overwrite:
        other = [name for name in wanted if begun.get(name) != wanted[name]]
        raise EndoctError(
            f"{folder} belongs to another run",
            found=f"another {', '.join(other)}",
            remedy="resume it with the command that began it, choose another output, or add --overwrite",
        )
    _remove(folder)
    _write(folder / RUN, wanted)
    return Checkpoint(folder)


def _rows(path: Path) -> list[MethodResult]:
    with refusing(f"{path} is damaged", remedy="remove it; its cases are then run again"):
        return TypeAdapter(list[MethodResult]).validate_json(read_small(path, MOST_BYTES))


def source_digests(plan: BenchPlan) -> Mapping[str, str]:
    """Return digests of endoct's source and of the modules of others' methods, but not of what those import."""
    task = plan.load_task()
    ours = [path for part in PARTS for path in sorted(Path(import_module(f"endoct.{part}").__path__[0]).rglob("*.py"))]
    theirs = {module for name in plan.methods if (module := module_of(task, name)).partition(".")[0] != "endoct"}
    return {"endoct": _digest(ours)} | {module: _digest(_files(module)) for module in sorted(theirs)}


def _files(module: str) -> list[Path]:
    try:
        spec = find_spec(module)
    except ImportError:
        return []  # running the method says so
    return [Path(spec.origin)] if spec is not None and spec.has_location and spec.origin else []


def _digest(files: Sequence[Path]) -> str:
    source = hashlib.sha256()
    for path in files:
        source.update(path.read_bytes())
    return source.hexdigest()[:16]


@contextmanager
def _in_use(folder: Path) -> Iterator[None]:
    """Let no other run use a checkpoint meanwhile. Raises :class:`EndoctError` where one does."""
    with ExitStack() as lock:
        try:
            lock.enter_context(held(folder / LOCK))
        except HeldError as error:
            remedy = "wait until that ends, or stop it"
            raise EndoctError(f"another run uses {folder}", found=str(error), remedy=remedy) from error
        yield


def _is_own(name: str) -> bool:
    return name in (RUN, LOCK) or _ROWS.fullmatch(name) is not None


def _remove(folder: Path) -> None:
    """Remove a checkpoint. Raises :class:`EndoctError`, and removes nothing, where the folder holds anything else."""
    if not os.path.lexists(folder):
        return
    files, remedy = [], "move it away, or choose another output"
    is_folder = folder.is_dir() and not folder.is_symlink()
    if is_folder:
        clear_dead_scratch(folder)
        files = sorted(folder.iterdir())
    if not is_folder or (files and not (folder / RUN).is_file()):
        raise EndoctError(f"{folder} is no folder that endoct made", remedy=remedy)
    if others := [path.name for path in files if not (path.is_file() and _is_own(path.name))]:
        found = ", ".join(others[:3])
        raise EndoctError(f"{folder} holds what endoct did not write", found=found, remedy=remedy)
    with _in_use(folder):
        pass
    for path in (*files, folder / LOCK):
        path.unlink(missing_ok=True)
    folder.rmdir()


def _write(path: Path, content: object) -> None:
    with refusing_disk_errors(path.parent), new_file(path) as file:
        file.write(json.dumps(content).encode())
