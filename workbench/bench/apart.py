"""Methods in Python run as programs are: a process for every case, a copy of what is given, and no truth in reach.

A method that ran beside its judge could look the truth up in memory, or next to the recording that it is given. Here it
gets a pickled case in which every path is that of a copy. Its answer returns as files that hold nothing but data.
"""

import hashlib
import pickle
import random
import shlex
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np

from endoct.base.errors import EndoctError
from endoct.workbench.bench.program import Program, write_answer
from endoct.workbench.bench.task import AnyTask, Declined, NotInstalled, load_method, load_task
from endoct.workbench.running.scheduler import one_blas_thread

CASE = "case.pickle"


def apart(task: AnyTask, names: Sequence[str], hidden: Path) -> AnyTask:
    """Return the task with ``names``, its methods, as programs from which the folder ``hidden`` is hidden.

    Raises :class:`EndoctError` where the task states no files for answers.
    """
    if task.exchange is None:
        raise EndoctError(f"the task '{task.name}' cannot be run apart from its truth")
    exchange = replace(task.exchange, write=write_case)
    methods = dict(task.methods)
    for name in names:
        known = methods.get(name)
        if not isinstance(known, Program):
            known = Program(shlex.join([sys.executable, "-m", __name__, task.name, name]), exchange)
        methods[name] = replace(known, hidden=hidden)
    return replace(task, methods=methods)


def write_case(given: object, folder: Path) -> None:
    """Write what a method is called with; each file and folder that it names is copied."""
    with (folder / CASE).open("wb") as file:
        _Copying(file, folder).dump(given)


def read_case(folder: Path) -> object:
    """Return what :func:`write_case` wrote, with the paths of the copies."""
    with (folder / CASE).open("rb") as file:
        return _Copied(file, folder).load()


class _Copying(pickle.Pickler):
    def __init__(self, file: IO[bytes], folder: Path) -> None:
        super().__init__(file)
        self.folder = folder

    def persistent_id(self, part: Any) -> str | None:
        if not isinstance(part, Path):
            return None
        copy = self.folder / part.name
        shutil.copytree(part, copy, dirs_exist_ok=True) if part.is_dir() else shutil.copyfile(part, copy)
        return part.name


class _Copied(pickle.Unpickler):
    def __init__(self, file: IO[bytes], folder: Path) -> None:
        super().__init__(file)
        self.folder = folder

    def persistent_load(self, name: str) -> Path:
        return self.folder / name


def seed_global_generators(name: str) -> None:
    """Make methods that draw from a library's global generator repeatable, in any order of cases."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little") // 2
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002 – the one that libraries draw from
    cv2.setRNGSeed(seed)


@one_blas_thread()
def main(task_name: str, name: str, given: str, answer: str) -> None:
    """Run a method on the case in the folder ``given``, and write what it answers into ``answer``."""
    task, case, place = load_task(task_name), read_case(Path(given)), Path(answer)
    if task.exchange is None:
        raise EndoctError(f"the task '{task_name}' states no files for answers")
    try:
        method = load_method(task, name)
        seed_global_generators("")  # a case has no name here, since names tell seeds
        task.exchange.answer(method(*case) if isinstance(case, tuple) else method(case), place)
    except Declined as declined:
        write_answer(place, {"declined": declined.reason})
    except NotInstalled as missing:
        write_answer(place, {"missing": [missing.library, missing.remedy]})
    except ModuleNotFoundError as error:
        if (error.name or "endoct").startswith("endoct"):
            raise
        write_answer(place, {"missing": [error.name, None]})
    except EndoctError as error:
        sys.exit(str(error))  # one line says it


if __name__ == "__main__":
    main(*sys.argv[1:])
