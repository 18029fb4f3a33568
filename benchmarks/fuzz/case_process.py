"""The process in which cases are made and read; it may die of them, so another process counts the outcomes."""

import faulthandler
import logging
import multiprocessing
import os
import resource
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

from benchmarks.fuzz.mutate import mutated
from benchmarks.fuzz.outcome import REFUSED, Outcome, outcome_of
from benchmarks.fuzz.readers import READERS, seeds_of
from benchmarks.fuzz.trees import Entry, Seed, write_tree

ADDRESS_BYTES = 4_000_000_000
"""What the process may map beyond what it has at first: more is refused, as on a smaller machine."""
STALE_BYTES = 500_000_000
"""Where so much memory is left resident after a case, another process goes on."""


@dataclass(frozen=True)
class Case:
    """A place in the sequence of a reader's cases."""

    reader: str
    number: int


@dataclass(frozen=True)
class Report:
    """What came of a case; ``output`` is what was written to stdout and stderr meanwhile.

    ``files``: the folder in which a finding's files lie; ``leave``: whether the process ends here. ``sound``: the name
    of the sound case it was made of; ``entered``: whether it was not refused where an empty file is.
    """

    case: Case
    outcome: Outcome
    output: str = ""
    files: Path | None = None
    leave: bool = False
    sound: str = ""
    entered: bool = True


def made(case: Case, seed: int) -> tuple[Seed, dict[str, Entry]]:
    """Return the sound case that ``case`` is made of, and its damaged files; number −1−k is sound case k itself."""
    seeds = seeds_of(case.reader)
    if case.number < 0:
        sound = seeds[-1 - case.number]
        return sound, dict(sound.files)
    rng = Random(f"{seed} {case.reader} {case.number}")
    sound = rng.choice(seeds)
    return sound, mutated(sound, seeds, rng)


def target_of(sound: Seed, tree: dict[str, Entry], case: Path) -> Path:
    """Return what the reader is given: as for the sound case, or the only file there is."""
    if not sound.target:
        return case
    there = {name.partition("/")[0] for name in tree}
    return case / (sound.target if sound.target in there or len(there) != 1 else there.pop())


def try_cases(connection: Connection, cases: Sequence[Case], seed: int, scratch: Path, seconds: float | None) -> None:
    """Try ``cases`` in order; send a :class:`Report` of each. Runs in a process of its own."""
    # locks that libraries make are then gone with the process, however that ends
    multiprocessing.set_start_method("fork", force=True)
    scratch.mkdir(parents=True, exist_ok=True)
    errors = _silenced(scratch / "stderr")
    for name in dict.fromkeys(case.reader for case in cases):
        _warm_up(name, scratch / "warm")
    resident = _resident_bytes()
    _limit_addresses()
    folder = scratch / "case"
    first: dict[tuple[str, str], str] = {}
    for case in cases:
        sound, tree = made(case, seed)
        shutil.rmtree(folder, ignore_errors=True)
        write_tree(tree, folder)
        reader = READERS[case.reader]
        begun = os.fstat(errors).st_size
        outcome = outcome_of(
            reader.read, target_of(sound, tree, folder), case=folder, seconds=seconds or reader.seconds
        )
        output = _output(scratch / "stderr", begun) if os.fstat(errors).st_size > begun else ""
        leave = outcome.kind == "too long" or _resident_bytes() > resident + STALE_BYTES
        files = scratch / f"found-{case.reader}-{case.number}" if outcome.is_finding else None
        if files is not None:  # anew, since a reader may have changed what it read
            write_tree(tree, files)
        key = (case.reader, sound.name)
        if outcome.kind == REFUSED and key not in first:
            first[key] = _first_check(case.reader, sound, scratch / "empty")
        entered = outcome.kind != REFUSED or outcome.where != first[key]
        connection.send(Report(case, outcome, output, files, leave, sound.name, entered))
        if leave:
            os._exit(0)  # threads that never end would hold an orderly end up
    shutil.rmtree(folder, ignore_errors=True)
    connection.close()


def _first_check(name: str, sound: Seed, folder: Path) -> str:
    """Return where the case is refused whose files are all empty, "" where it is not."""
    tree: dict[str, Entry] = {path: b"" if isinstance(entry, bytes) else entry for path, entry in sound.files.items()}
    write_tree(tree, folder)
    outcome = outcome_of(READERS[name].read, target_of(sound, tree, folder), case=folder, seconds=60.0)
    shutil.rmtree(folder, ignore_errors=True)
    return outcome.where if outcome.kind == REFUSED else ""


def _warm_up(name: str, folder: Path) -> None:
    """Read a sound case, so that what has to be loaded is, before time and memory are counted."""
    sound = seeds_of(name)[0]
    write_tree(sound.files, folder)
    outcome_of(READERS[name].read, folder / sound.target, case=folder, seconds=600.0)
    shutil.rmtree(folder, ignore_errors=True)


def _silenced(path: Path) -> int:
    """Send what is written to stdout and stderr to a file; return its descriptor."""
    sys.stdout.flush()
    sys.stderr.flush()
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_TRUNC)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    faulthandler.enable(2)
    logging.captureWarnings(False)
    return handle


def _output(path: Path, begin: int) -> str:
    with path.open("rb") as file:
        file.seek(begin)
        return file.read(2000).decode("utf-8", "replace")


def _limit_addresses() -> None:
    mapped = _status("VmSize")
    if mapped:
        resource.setrlimit(resource.RLIMIT_AS, (mapped + ADDRESS_BYTES, resource.RLIM_INFINITY))


def _resident_bytes() -> int:
    return _status("VmRSS")


def _status(name: str) -> int:
    """Return a size that Linux gives for this process, 0 elsewhere."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
