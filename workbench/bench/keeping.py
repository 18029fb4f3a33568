"""Keeps what a run of the bench has finished beside its output, so that one that was stopped or killed goes on.

``RESULTS.unfinished`` holds ``run.json``, what is run and with what, and a file of rows for every source of cases that
all methods have been through. Each file appears whole or not at all, and the folder goes when the output is there.
"""

import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import read_small
from endoct.stitching.json_values import read_object
from endoct.stitching.scratch import clear_dead_scratch, new_file
from endoct.workbench.bench.methods import load_task, module_of, origin
from endoct.workbench.bench.runner import Plan, Row
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.running.files import disk_errors_told

RUN = "run.json"
_KEPT = re.compile(r"run\.json|[0-9]{6}\.json")
MOST_BYTES = 16_000_000
PARTS = ("stitching", "modalities", "fusion", "synthetic", "workbench")


@dataclass(frozen=True)
class Kept:
    """The folder of what is finished; sources go by their place in the plan."""

    folder: Path

    def read(self) -> dict[int, list[Row]]:
        """Return the rows of every source that is finished. Raises :class:`EndoctError` where a file is damaged."""
        files = sorted(path for path in self.folder.iterdir() if _KEPT.fullmatch(path.name) and path.name != RUN)
        return {int(path.stem): _rows(path) for path in files}

    def put(self, place: int, rows: Sequence[Row]) -> None:
        """Keep the rows of one source."""
        _write(self.folder / f"{place:06d}.json", [asdict(row) for row in rows])

    def remove(self) -> None:
        """Remove the folder, when the output is there."""
        _remove(self.folder)


def kept_beside(output: Path, plan: Plan, *, overwrite: bool) -> Kept:
    """Return the folder beside ``output``, made or found as an earlier run of ``plan`` left it.

    Raises :class:`EndoctError` where it holds what another plan, or other code, began; with ``overwrite`` that goes.
    """
    folder = output.with_name(f"{output.name}.unfinished")
    wanted = json.loads(json.dumps(asked(plan) | {"source": _source(plan)}))
    begun = None
    if os.path.lexists(folder / RUN):
        with refusing(f"{folder / RUN} cannot be read", remedy="remove that folder"):
            begun = read_object(folder / RUN, MOST_BYTES)
    if begun == wanted:
        clear_dead_scratch(folder)
        return Kept(folder)
    if begun is not None and not overwrite:
        other = [name for name in wanted if begun.get(name) != wanted[name]]
        raise EndoctError(
            f"{folder} holds what another run began",
            found=f"another {', '.join(other)}",
            remedy="go on with what it was begun with, choose another output, or say --overwrite",
        )
    _remove(folder)
    _write(folder / RUN, wanted)
    return Kept(folder)


def _rows(path: Path) -> list[Row]:
    with refusing(f"{path} is damaged", remedy="remove it; its cases are run again then"):
        return TypeAdapter(list[Row]).validate_json(read_small(path, MOST_BYTES))


def asked(plan: Plan) -> dict[str, Any]:
    """Return what is run, on what, and with which versions."""
    task = load_task(plan.task)
    return {
        "task": task.name,
        "methods": {name: origin(task, name) for name in plan.methods},
        "seeds": list(plan.seeds),
        "cases_a_seed": plan.count,
        "conditions": {name: list(range_) for name, range_ in (plan.ranges or {}).items()},
        "data": [str(folder) for folder in plan.own],
        "versions": versions(),
    }


def _source(plan: Plan) -> Mapping[str, str]:
    """Return the digests of endoct's source and of the modules that others' methods are in, not of what those load."""
    task = load_task(plan.task)
    ours = [path for part in PARTS for path in sorted(Path(import_module(f"endoct.{part}").__path__[0]).rglob("*.py"))]
    theirs = {module for name in plan.methods if (module := module_of(task, name)).partition(".")[0] != "endoct"}
    return {"endoct": _digest(ours)} | {module: _digest(_files(module)) for module in sorted(theirs)}


def _files(module: str) -> list[Path]:
    try:
        spec = find_spec(module)
    except ImportError:
        return []  # told when the method is run
    return [Path(spec.origin)] if spec is not None and spec.has_location and spec.origin else []


def _digest(files: Sequence[Path]) -> str:
    source = hashlib.sha256()
    for path in files:
        source.update(path.read_bytes())
    return source.hexdigest()[:16]


def _remove(folder: Path) -> None:
    """Remove what is kept. Raises :class:`EndoctError`, and removes nothing, where the folder holds anything else."""
    if not os.path.lexists(folder):
        return
    if folder.is_symlink() or not folder.is_dir():
        raise EndoctError(f"{folder} is no folder that endoct made", remedy="move it away, or choose another output")
    clear_dead_scratch(folder)
    files = sorted(folder.iterdir())
    if files and not (folder / RUN).is_file():
        raise EndoctError(f"{folder} is no folder that endoct made", remedy="move it away, or choose another output")
    others = [path.name for path in files if not (path.is_file() and _KEPT.fullmatch(path.name))]
    if others:
        raise EndoctError(
            f"{folder} holds what endoct did not write",
            found=", ".join(others[:3]),
            remedy="move it away, or choose another output",
        )
    for path in files:
        path.unlink()
    folder.rmdir()


def _write(path: Path, content: Any) -> None:
    with disk_errors_told(path.parent), new_file(path) as file:
        file.write(json.dumps(content).encode())
