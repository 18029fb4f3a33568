"""Runs of endoct's commands: a queue on the disk, which outlives the server, and whatever looks at it.

Every run has a folder of its own. A process of its own, which belongs to no terminal and to no server, carries it out
(:func:`main`). It starts the command, notes how that ends, cancels it, and holds the lock of the folder meanwhile, as
the command does. So the folder says by itself whether a run waits, is under way, has ended and how, or was lost with
the machine. A command whose process was killed is interrupted.
"""

import json
import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Literal

from endoct.base.compute.worker_process import process_group
from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text
from endoct.base.files.json_values import read_object
from endoct.base.files.scratch import HeldError, held
from endoct.workbench.running.progress import EVERY_S_NAME
from endoct.workbench.running.refusals import DONE, INTERRUPTED, NOT_ALIGNED

REQUEST, STARTED, ENDED, CANCEL, LOCK, LOG = "request.json", "started", "ended.json", "cancel", "lock", "log.txt"
"""Files of a run: its command line, that a process was started, how it ended, that it shall end, its lock, its log."""
STARTING_S = 20.0
"""A process that has not taken its lock by then has failed."""
LOOK_S = 0.3
"""How often the queue is looked at."""
MOST_RUNS = 2000
LOG_BYTES, LAST_BYTES = 200_000, 4_000
"""Of the end of what a run printed: to be read, and to see how far it is."""
PROGRAM = "from endoct.workbench.cli import main; main()"
PROGRESS_EVERY_S = "0.5"
WATCH_S = 0.1
"""How often a process looks whether its run is to be cancelled."""
TAKING_S = 10.0
"""How long a process waits for the lock: whoever looks whether it is held holds it for a moment."""

State = Literal["waiting", "running", "done", "unanswered", "failed", "cancelled", "lost"]
_ENDS: dict[int, State] = {DONE: "done", NOT_ALIGNED: "unanswered", INTERRUPTED: "cancelled"}
_PROGRESS = re.compile(r"after \d+ s: (.+)")
_SHARE = re.compile(r"(.+?) (\d{1,3})%(?:, |$)")


@dataclass(frozen=True)
class Run:
    """One run: the words of its command line after `endoct`, run in ``folder``.

    ``seconds``: how long it took, or takes so far. ``stages``: how much of each is done, 0 to 1, in their order.
    """

    name: str
    arguments: tuple[str, ...]
    folder: Path
    state: State
    seconds: float | None
    stages: dict[str, float]
    last_line: str

    @property
    def output(self) -> str:
        """The output that its command line names, "" where it names none."""
        return next((word.removeprefix("--output=") for word in self.arguments if word.startswith("--output=")), "")

    @property
    def is_open(self) -> bool:
        """Whether it waits or is under way."""
        return self.state in ("waiting", "running")

    def to_json(self) -> dict[str, Any]:
        """Return the run for the page, with its command line as a person would type it."""
        as_they_are = "name", "output", "state", "seconds", "stages", "last_line"
        return {
            **{name: getattr(self, name) for name in as_they_are},
            "command": command_line(self.arguments),
            "verb": self.arguments[0],
            "folder": path_text(self.folder),
        }


def command_line(arguments: Sequence[str]) -> str:
    """Return the line that a person would type."""
    return shlex.join(["endoct", *arguments])


class Queue:
    """The runs in ``folder``, of which ``at_once`` are under way at a time: half as many as there are processors.

    Several servers may look at one queue; the one that holds its lock starts what is next.
    """

    def __init__(self, folder: Path, at_once: int | None = None) -> None:
        self.folder = folder
        self._at_once = at_once or max(1, (os.cpu_count() or 1) // 2)  # each unrolls two recordings at a time
        self._lock = threading.Lock()
        self._left = threading.Event()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)

    def add(self, arguments: Sequence[str], folder: Path) -> str:
        """Append a run of ``arguments`` in ``folder`` and return its name.

        Raises :class:`EndoctError` where its output is that of a run that waits or is under way, or there are too many.
        """
        with self._lock:
            runs = self.runs()
            if len(runs) >= MOST_RUNS:
                raise EndoctError("too many runs are listed", expected=f"{MOST_RUNS} at most", remedy="clear the list")
            new = Run("", tuple(arguments), folder, "waiting", None, {}, "")
            if new.output and any(run.is_open and run.output and _place(run) == _place(new) for run in runs):
                raise EndoctError(
                    f"'{new.output}' is written by a run that is in the queue already",
                    expected="an output of its own for every run",
                    remedy="choose another output, or cancel that run",
                )
            name = f"{time.time_ns():020d}"
            made = self.folder / f".{name}"
            made.mkdir(mode=0o700)
            request = {"arguments": list(arguments), "folder": str(folder)}
            (made / REQUEST).write_text(json.dumps(request), encoding="utf-8")
            made.rename(self.folder / name)
            return name

    def runs(self) -> list[Run]:
        """Return all runs in their order, as they are now."""
        paths = sorted(path for path in self.folder.iterdir() if path.name.isdigit() and path.is_dir())
        return [run for path in paths if (run := _read(path)) is not None]

    def run(self, name: str) -> Run:
        """Return one run. Raises :class:`EndoctError` where there is none of that name."""
        run = _read(self._path(name))
        if run is None:
            raise EndoctError("there is no such run", found=name[:40])
        return run

    def log(self, name: str) -> str:
        """Return the end of what a run printed, without the lines that only say how far it is."""
        return "\n".join(line for line in _log(self._path(name), LOG_BYTES) if not _PROGRESS.fullmatch(line))

    def cancel(self, name: str) -> None:
        """Have a run end, or not begin: nothing of it is left half-written."""
        if self.run(name).is_open:
            (self._path(name) / CANCEL).touch()

    def repeat(self, name: str) -> str:
        """Append the run once more and return the new one's name."""
        run = self.run(name)
        return self.add(run.arguments, run.folder)

    def clear(self) -> None:
        """Take the runs off the list that have ended. Their outputs stay."""
        with self._lock:
            for run in self.runs():
                if not run.is_open:
                    shutil.rmtree(self.folder / run.name, ignore_errors=True)  # another window may be at it

    def start(self) -> None:
        """Have a thread start what is next, until :meth:`leave`."""
        threading.Thread(target=self._work, daemon=True).start()

    def leave(self) -> None:
        """Start nothing further. What is under way goes on by itself."""
        self._left.set()

    def _work(self) -> None:
        while not self._left.is_set():
            # another window may clear what is looked at; what fails now is tried again
            with suppress(HeldError, EndoctError, OSError), held(self.folder / LOCK):
                while not self._left.wait(LOOK_S):
                    self._start_next()
            self._left.wait(LOOK_S)

    def _start_next(self) -> None:
        with self._lock:
            runs = self.runs()
            free = self._at_once - sum(run.state == "running" for run in runs)
            for run in [run for run in runs if run.state == "waiting"][: max(0, free)]:
                _start(self.folder / run.name)

    def _path(self, name: str) -> Path:
        if not (name.isascii() and name.isdigit() and len(name) <= 40):
            raise EndoctError("there is no such run", found=name[:40])
        return self.folder / name


def _start(path: Path) -> None:
    (path / STARTED).touch()
    # -P: what lies in the working folder is not imported in place of a library
    program = [sys.executable, "-P", "-c", "from endoct.workbench.desk.runs import main; main()", str(path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(place for place in sys.path if place)}
    try:
        process = subprocess.Popen(
            program, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True, cwd=path, env=environment,
        )  # fmt: skip
    except OSError:  # no memory for a process: it waits on
        (path / STARTED).unlink(missing_ok=True)
        raise
    threading.Thread(target=process.wait, daemon=True).start()  # so that the system forgets it when it has ended


def _read(path: Path) -> Run | None:
    """Return the run in ``path``; None where there is none, or nobody can say what it was."""
    try:
        request = read_object(path / REQUEST)
        arguments, folder = request["arguments"], Path(request["folder"])
        if not isinstance(arguments, list) or not arguments or "\0" in str(folder):
            return None
        if not all(isinstance(word, str) and word.isprintable() for word in arguments):
            return None
    except (EndoctError, KeyError, TypeError):
        return None
    state, seconds = _state(path)
    lines = _log(path, LAST_BYTES) if state != "waiting" else []
    said = [line for line in lines if not _PROGRESS.fullmatch(line)]
    stages = _stages(lines[-1]) if lines and state == "running" else {}
    return Run(path.name, tuple(arguments), folder, state, seconds, stages, said[-1] if said else "")


def _state(path: Path) -> tuple[State, float | None]:
    if (path / ENDED).exists():
        with suppress(EndoctError, KeyError, TypeError, ValueError, OverflowError):
            ended = read_object(path / ENDED)
            seconds = float(ended["seconds"])
            return _ENDS.get(int(ended["status"]), "failed"), seconds if 0 <= seconds < math.inf else None
        return "failed", None
    try:
        since_s = time.time() - (path / STARTED).stat().st_mtime
    except OSError:
        return ("cancelled" if (path / CANCEL).exists() else "waiting"), None
    # a clock that was set back says nothing of how long it takes
    if 0 <= since_s < STARTING_S or _is_held(path / LOCK):
        return "running", since_s if since_s >= 0 else None
    return "lost", None


def _is_held(lock: Path) -> bool:
    try:
        with held(lock):
            return False
    except HeldError:
        return True
    except (EndoctError, OSError):  # it was cleared meanwhile
        return False


def _log(path: Path, n_bytes: int) -> list[str]:
    try:
        with (path / LOG).open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - n_bytes))
            return file.read().decode("utf-8", "replace").splitlines()
    except OSError:
        return []


def _stages(line: str) -> dict[str, float]:
    """Return how far every stage is, by the last line that was printed: one of progress, or a stage's title."""
    progress = _PROGRESS.fullmatch(line)
    return {title: int(share) / 100 for title, share in _SHARE.findall(progress[1])} if progress else {line: 0.0}


def _place(run: Run) -> str:
    return os.path.realpath(run.folder / run.output)


def main() -> None:
    """Carry out the run in the folder that the command line names."""
    path = Path(sys.argv[1])
    for _ in range(round(TAKING_S / WATCH_S)):
        try:
            with held(path / LOCK) as lock:
                _carry_out(path, lock)
                return
        except HeldError:
            time.sleep(WATCH_S)


def _carry_out(path: Path, lock: int) -> None:
    request, begun = read_object(path / REQUEST), time.monotonic()
    if (path / ENDED).exists():
        return
    cancelled = path / CANCEL

    def cancel(number: int, frame: FrameType | None) -> None:
        del number, frame
        cancelled.touch()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, cancel)
    environment = os.environ | {EVERY_S_NAME: PROGRESS_EVERY_S, "COLUMNS": "200"}
    command, folder = [sys.executable, "-P", "-c", PROGRAM, *request["arguments"]], Path(request["folder"])
    with (path / LOG).open("wb") as log:
        try:
            streams: dict[str, Any] = {"stdout": log, "stderr": subprocess.STDOUT}
            with process_group(command, **streams, cwd=folder, env=environment, holds=[lock]) as process:
                asked = False
                while (status := process.poll()) is None:
                    if cancelled.exists() and not asked:
                        process.send_signal(signal.SIGINT)
                        asked = True
                    time.sleep(WATCH_S)
        except OSError as error:
            log.write(f"endoct: {path_text(folder)} cannot be used; found {error.strerror}\n".encode())
            _note(path, 1, begun)
            return
    # one that was interrupted before it could listen ends as the system has it
    _note(path, status if not asked or status in (DONE, NOT_ALIGNED) else INTERRUPTED, begun)


def _note(path: Path, status: int, begun: float) -> None:
    """Note how the run ended, at one stroke."""
    scratch = path / f".{ENDED}"
    scratch.write_text(json.dumps({"status": status, "seconds": time.monotonic() - begun}), encoding="utf-8")
    scratch.replace(path / ENDED)
