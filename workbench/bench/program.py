"""Methods that are programs in any language: a case is given as files, and the answer is read from files.

A program is called as ``COMMAND GIVEN ANSWER``, both folders. GIVEN holds ``given.json`` and arrays as ``.npy``; the
program writes ``answer.json`` and arrays into ANSWER. ``{"declined": "why"}`` in ``answer.json`` says "I do not know".
What both folders hold is up to the task, see :class:`endoct.workbench.bench.task.Exchange`.
"""

import json
import shlex
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, cause_of
from endoct.base.files.files import open_regular
from endoct.base.files.json_values import read_object
from endoct.base.files.npy import read_npy
from endoct.base.files.scratch import TemporaryFolder
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.task import AnyTask, Declined, Exchange

GIVEN, ANSWER = "given.json", "answer.json"
LONGEST_LAST_WORDS = 200


@dataclass(frozen=True)
class Program:
    """A method that calls a program. ``command`` is split as a shell does, and run without one."""

    command: str
    exchange: Exchange[Any, Any]

    def __call__(self, *given: object) -> object:
        """Return the program's answer. Raises :class:`EndoctError` where it fails or answers nothing."""
        case = given[0] if len(given) == 1 else given
        with TemporaryFolder("program") as scratch:
            folders = [Path(scratch) / name for name in ("given", "answer")]
            for folder in folders:
                folder.mkdir()
            self.exchange.write(case, folders[0])
            self._run(folders)
            answer = read_answer(folders[1])
            if isinstance(reason := answer.get("declined"), str):
                raise Declined(reason)
            return self.exchange.read(case, folders[1])

    def _run(self, folders: list[Path]) -> None:
        command = [*shlex.split(self.command), *map(str, folders)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        except OSError as error:
            raise EndoctError(f"the program '{command[0]}' cannot be run", found=cause_of(error)) from error
        if done.returncode:
            last = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["nothing printed"]
            status = f"exit status {done.returncode}"
            raise EndoctError(f"the program failed with {status}", found=last[0][-LONGEST_LAST_WORDS:])


def with_programs(task: AnyTask, programs: Mapping[str, str]) -> AnyTask:
    """Return the task with programs as further methods, by name.

    Raises :class:`EndoctError` where the task states no files for them, or a command cannot be split.
    """
    if not programs:
        return task
    if task.exchange is None:
        raise EndoctError(f"the task '{task.name}' cannot be given to programs", remedy="write the method in Python")
    for name, command in programs.items():
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise EndoctError(f"the command of '{name}' cannot be read", found=str(error)) from error
        if not words:
            raise EndoctError(f"the program '{name}' has no command", expected="NAME=COMMAND")
    exchange = task.exchange
    methods = {name: Program(command, exchange) for name, command in programs.items()}
    return replace(task, methods={**task.methods, **methods})


def parse_programs(texts: tuple[str, ...]) -> dict[str, str]:
    """Return commands by name from "NAME=COMMAND". Raises :class:`EndoctError` for another form."""
    programs: dict[str, str] = {}
    for text in texts:
        name, equals, command = text.partition("=")
        if not (equals and name.strip() and command.strip()) or name in programs:
            raise EndoctError(
                "a program cannot be read", found=f"'{text[:80]}'", expected="NAME=COMMAND, each name once"
            )
        programs[name.strip()] = command.strip()
    return programs


def write_given(folder: Path, facts: Mapping[str, object], **arrays: NDArray[Any] | None) -> None:
    """Write ``given.json``, and each array that is not None as ``NAME.npy``."""
    (folder / GIVEN).write_text(json.dumps(facts, indent=1), encoding="utf-8")
    for name, array in arrays.items():
        if array is not None:
            np.save(folder / f"{name}.npy", array, allow_pickle=False)


def write_panorama(folder: Path, panorama: Panorama) -> None:
    """Write a panorama as ``intensity.npy``, ``valid.npy``, ``depth_mm.npy`` where there is depth, and its places."""
    facts = {
        "modality": panorama.modality,
        "z_mm": panorama.z_mm.tolist(),
        "theta_rad": panorama.grid.theta_rad.tolist(),
        "radius_mm": panorama.grid.radius_mm,
        "handedness_known": panorama.handedness_known,
        "travel_known": panorama.travel_known,
    }
    write_given(folder, facts, intensity=panorama.intensity, valid=panorama.valid, depth_mm=panorama.depth_mm)


def read_answer(folder: Path) -> dict[str, Any]:
    """Return what ``answer.json`` holds; nothing where there is none. Raises :class:`EndoctError` for a damaged one."""
    path = folder / ANSWER
    return read_object(path) if path.is_file() else {}


def read_array(folder: Path, name: str) -> NDArray[Any]:
    """Return an array of the answer. Raises :class:`EndoctError` where the program did not write it."""
    path = folder / f"{name}.npy"
    if not path.is_file():
        raise EndoctError(f"the program wrote no {name}.npy")
    with open_regular(path) as file:
        return read_npy(file, f"{name}.npy of the answer")
