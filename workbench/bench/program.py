"""Methods that are programs in any language: a case is given as files, and the answer is read from files.

A program is called as ``COMMAND GIVEN ANSWER``, both folders. GIVEN holds ``given.json`` and arrays as ``.npy``; the
program writes ``answer.json`` and arrays into ANSWER. ``{"declined": "why"}`` in ``answer.json`` says "I do not know".
What both folders hold is up to the task, see :class:`endoct.workbench.bench.task.Exchange`.

A program has bounds of time, memory and what it writes. The folder of the truth can be hidden from it: Linux lets every
user see a file system of his own, in which an empty one lies over that folder. In a container it sees no folder but its
own two, see :mod:`endoct.workbench.bench.container`.
"""

import json
import os
import shlex
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.compute.worker_process import process_group
from endoct.base.errors import EndoctError, cause_of
from endoct.base.files.files import open_regular
from endoct.base.files.json_values import read_object
from endoct.base.files.npy import read_npy
from endoct.base.files.scratch import TemporaryFolder
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.container import MARK, contained, container
from endoct.workbench.bench.task import AnyTask, Declined, Exchange, NotInstalled, method_names

GIVEN, ANSWER = "given.json", "answer.json"
LONGEST_LAST_WORDS = 200
LONGEST_S = 3600.0
MOST_BYTES = 1_000_000_000
MOST_MEMORY_BYTES = 16_000_000_000
"""What a program may take for one case, what it may print and write altogether, and what each of its processes may hold
in memory; beyond any it is ended."""
LOOK_S = 0.02
"""How often a program is looked at."""
_BOUNDED = 'ulimit -d "$0" 2>/dev/null; exec "$@"'
_NAMESPACE = ("unshare", "--user", "--map-root-user", "--mount")
_HIDING = (
    f"""mount -t tmpfs -o ro hidden "$0" && {{ cd "$PWD" 2>/dev/null || cd /; }} && exec {" ".join(_NAMESPACE)} "$@\""""
)
"""Hides a folder, enters the present one anew, as it may lie there, and gives up the right to unhide anything."""


@dataclass(frozen=True)
class Program:
    """A method that calls a program. ``command`` is split as a shell does, and run without one or in a container.

    ``hidden``: a folder that it must not see, where the system can hide it, see :func:`can_hide`.
    """

    command: str
    exchange: Exchange[Any, Any]
    hidden: Path | None = None

    def __call__(self, *given: object) -> object:
        """Return the program's answer. Raises :class:`EndoctError` where it fails or answers nothing."""
        case = given[0] if len(given) == 1 else given
        with TemporaryFolder("program") as scratch:
            folders = [Path(scratch) / name for name in ("given", "answer", "temporary")]
            for folder in folders:
                folder.mkdir()
            self.exchange.write(case, folders[0])
            self._run(folders)
            _check_links(folders[1])
            answer = read_answer(folders[1])
            if isinstance(missing := answer.get("missing"), list):
                raise NotInstalled(*missing)
            if isinstance(reason := answer.get("declined"), str):
                raise Declined(reason)
            return self.exchange.read(case, folders[1])

    def _run(self, folders: list[Path]) -> None:
        words, (given, answer, temporary) = shlex.split(self.command), folders
        apart = words[0].startswith(MARK)
        if not apart and shutil.which(words[0]) is None:
            raise EndoctError(f"the program '{words[0]}' cannot be run", found="no such program")
        out, err = (given.parent / name for name in ("printed", "complained"))
        whole = nullcontext([*words, str(given), str(answer)])
        try:
            with (
                out.open("wb") as stdout,
                err.open("wb") as stderr,
                container(words, given, answer, MOST_MEMORY_BYTES) if apart else whole as command,
                process_group(
                    bounded(command, None if apart else self.hidden),
                    stdout=stdout,
                    stderr=stderr,
                    env={**os.environ, "TMPDIR": str(temporary)},
                ) as process,
            ):
                self._wait(process, given.parent)
        except OSError as error:
            raise EndoctError(f"the program '{words[0]}' cannot be run", found=cause_of(error)) from error
        if process.returncode:
            last = _last_words(err) or _last_words(out) or "nothing printed"
            raise EndoctError(f"the program failed with exit status {process.returncode}", found=last)

    def _wait(self, process: "subprocess.Popen[bytes]", scratch: Path) -> None:
        """Wait for a program. Raises :class:`EndoctError` where it takes or writes more than it may."""
        until, given = time.monotonic() + LONGEST_S, _size(scratch)
        while True:
            if (n_bytes := _size(scratch) - given) > MOST_BYTES:
                raise EndoctError(
                    "the program was ended: it writes too much",
                    found=f"{n_bytes / 1e9:.3g} GB",
                    expected=f"{MOST_BYTES / 1e9:g} GB at most for a case",
                )
            if time.monotonic() > until:
                raise EndoctError("the program was ended: it takes too long", expected=f"{LONGEST_S:g} s at most")
            with suppress(subprocess.TimeoutExpired):
                process.wait(LOOK_S)
                return


def bounded(command: Sequence[str], hidden: Path | None) -> list[str]:
    """Return the command that runs ``command`` with bounded memory, and with a folder hidden where that can be done."""
    if os.name != "posix":
        return [*command]
    hiding = [] if hidden is None or not can_hide() else hiding_command(hidden)
    return ["/bin/sh", "-c", _BOUNDED, str(MOST_MEMORY_BYTES // 1024), *hiding, *command]


def hiding_command(folder: Path) -> list[str]:
    """Return what to put before a command that shall not see ``folder``."""
    return [*_NAMESPACE, "/bin/sh", "-c", _HIDING, str(folder)]


@cache
def can_hide() -> bool:
    """Say whether this system can hide a folder from a program: Linux, where users may have namespaces."""
    with TemporaryFolder("hidden") as folder:
        inside = Path(folder) / "inside"
        inside.touch()
        look = [*hiding_command(Path(folder)), "test", "!", "-e", str(inside)]
        with suppress(OSError):
            return not subprocess.run(look, capture_output=True, check=False).returncode
    return False


def _check_links(folder: Path) -> None:
    """Raise :class:`EndoctError` where an answer holds a link: it could lead to what its program must not read."""
    for path, folders, names in os.walk(folder):
        for name in (*folders, *names):
            if Path(path, name).is_symlink():
                raise EndoctError("the answer holds a link", found=name, expected="files and folders")


def _size(path: Path) -> int:
    """Return the bytes of a file, or of all files below a folder, links not followed."""
    below = (Path(folder, name) for folder, _, names in os.walk(path) for name in names)
    total = 0
    for place in (path, *below):
        with suppress(OSError):  # it was renamed meanwhile; `os.walk` passes over what was
            total += place.lstat().st_size
    return total


def _last_words(path: Path) -> str:
    """Return the end of the last line that a program printed, but no pointer to its help; "" where there is none."""
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - 10 * LONGEST_LAST_WORDS))
        lines = file.read().decode(errors="replace").strip().splitlines()
    lines = [line for line in lines if line.strip() and "--help" not in line] or lines
    return lines[-1][-LONGEST_LAST_WORDS:] if lines else ""


def with_programs(task: AnyTask, programs: Mapping[str, str]) -> AnyTask:
    """Return the task with programs as further methods, by name.

    Raises :class:`EndoctError` where the task states no files for them, a command cannot be split, or a name is that of
    a method that is no program.
    """
    if not programs:
        return task
    if task.exchange is None:
        raise EndoctError(f"the task '{task.name}' cannot be given to programs", remedy="write the method in Python")
    taken = method_names(task)
    for name, command in programs.items():
        if name in taken:
            raise EndoctError(f"a program cannot be called '{name}'", found="a method of that name", remedy="rename it")
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise EndoctError(f"the command of '{name}' cannot be read", found=str(error)) from error
        if not words:
            raise EndoctError(f"the program '{name}' has no command", expected="NAME=COMMAND")
    methods = {name: Program(command, task.exchange) for name, command in programs.items()}
    return replace(task, methods={**task.methods, **methods})


def parse_programs(texts: tuple[str, ...], image: str | None = None) -> dict[str, str]:
    """Return commands by name from "NAME=COMMAND", run in containers of an ``image`` where there is one.

    Raises :class:`EndoctError` for another form, for an image that is not there, and for one without programs.
    """
    programs: dict[str, str] = {}
    for text in texts:
        name, equals, command = text.partition("=")
        if not (equals and name.strip() and command.strip()) or name in programs:
            raise EndoctError(
                "a program cannot be read", found=f"'{text[:80]}'", expected="NAME=COMMAND, each name once"
            )
        programs[name.strip()] = command.strip()
    if image is None:
        return programs
    if not programs:
        raise EndoctError("only programs run in a container", expected="--program NAME=COMMAND beside --container")
    return {name: contained(image, command) for name, command in programs.items()}


def write_given(folder: Path, facts: Mapping[str, object], **arrays: NDArray[Any] | None) -> None:
    """Write ``given.json``, and each array that is not None as ``NAME.npy``."""
    (folder / GIVEN).write_text(json.dumps(facts, indent=1), encoding="utf-8")
    for name, array in arrays.items():
        if array is not None:
            write_array(name, array, folder)


def write_panorama(panorama: Panorama, folder: Path) -> None:
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


def write_panoramas(panoramas: Mapping[str, Panorama], folder: Path) -> None:
    """Write panoramas into folders of their own, by name."""
    for name, panorama in panoramas.items():
        (folder / name).mkdir()
        write_panorama(panorama, folder / name)


def write_answer(folder: Path, said: Mapping[str, object]) -> None:
    """Write ``answer.json``; numbers and arrays of NumPy become JSON's."""
    text = json.dumps(said, default=lambda value: value.tolist())
    (folder / ANSWER).write_text(text, encoding="utf-8")


def write_array(name: str, array: NDArray[Any], folder: Path) -> None:
    """Write an array of the answer as ``NAME.npy``."""
    np.save(folder / f"{name}.npy", array, allow_pickle=False)


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
