"""Many cases, in processes that are watched from outside; the files of findings are stored, to be read again."""

import re
import shutil
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from benchmarks.fuzz.case_process import Case, Report, try_cases
from benchmarks.fuzz.outcome import READ, REFUSED, Outcome
from benchmarks.fuzz.readers import READERS
from benchmarks.fuzz.trees import copy_case

BATCH = 250
FEWEST = 10
"""Cases of a reader at least: of fewer it might well read none."""
STORED_ALIKE = 3
"""Of findings of one kind at one place so many are stored."""
PATIENCE = 12.0
"""A process that has not ended a case after so many times its limit hangs in C and is killed."""

Group = tuple[str, str, str]


@dataclass
class Account:
    """What came of all cases: by reader how many ended how, and by (reader, kind, where) the findings.

    "entered" are those that were not refused where an empty file is; ``of_sound``: these and how many were read, by
    reader and by the sound file that was damaged.
    """

    ends: dict[str, Counter[str]] = field(default_factory=dict)
    findings: Counter[Group] = field(default_factory=Counter)
    examples: dict[Group, list[tuple[Path | None, Case, str]]] = field(default_factory=dict)
    printed: Counter[str] = field(default_factory=Counter)
    printed_examples: dict[str, str] = field(default_factory=dict)
    refusals: dict[Group, str] = field(default_factory=dict)
    of_sound: dict[tuple[str, str], Counter[str]] = field(default_factory=dict)

    def add(self, report: Report, stored: Path | None) -> None:
        """Count one case."""
        outcome, reader = report.outcome, report.case.reader
        ends = self.ends.setdefault(reader, Counter())
        ends["finding" if outcome.is_finding else outcome.kind] += 1
        ends["entered"] += report.entered
        if report.sound:
            ends_of_sound = self.of_sound.setdefault((reader, report.sound), Counter())
            ends_of_sound["cases"] += 1
            ends_of_sound["entered"] += report.entered
            ends_of_sound["read"] += outcome.kind == READ
        if report.output:
            self.printed[reader] += 1
            self.printed_examples.setdefault(f"{reader}: {re.sub('[0-9]+', '#', report.output[:60])}", report.output)
        if outcome.kind == REFUSED:
            self.refusals.setdefault((reader, outcome.where, outcome.message[:20]), outcome.message)
        if outcome.is_finding:
            group = (reader, outcome.kind, outcome.where)
            self.findings[group] += 1
            if stored is not None or group not in self.examples:
                self.examples.setdefault(group, []).append((stored, report.case, outcome.message))

    @property
    def reading_nothing(self) -> list[str]:
        """The readers that read none of their files: they were tried on nothing but their first check."""
        return [name for name, ends in self.ends.items() if not ends[READ]]

    @property
    def n_findings(self) -> int:
        """All findings."""
        return sum(self.findings.values())


@dataclass
class _Worker:
    """A process, what it is to try, and how far it is."""

    process: Any
    connection: Connection
    cases: Sequence[Case]
    scratch: Path
    done: int = 0
    since: float = field(default_factory=time.monotonic)
    leaving: bool = False


def plan_cases(count: int, readers: Sequence[str], *, sound: int = 0) -> list[list[Case]]:
    """Return ``count`` cases shared out among ``readers``, in batches of one reader; before them ``sound`` each."""
    shares = {name: READERS[name].share for name in readers}
    batches = [[Case(name, -1 - k) for k in range(sound)] for name in readers] if sound else []
    for name, share in shares.items():
        n = max(FEWEST, round(count * share / sum(shares.values())))
        batches += [[Case(name, k) for k in range(first, min(first + BATCH, n))] for first in range(0, n, BATCH)]
    return batches


def run(
    batches: Sequence[Sequence[Case]],
    *,
    seed: int = 0,
    processes: int = 1,
    findings: Path | None = None,
    seconds: float | None = None,
    progress: Callable[[Account], None] | None = None,
) -> Account:
    """Try all cases and return the account; store examples of findings below ``findings``."""
    context, account = get_context("spawn"), Account()
    waiting = [list(batch) for batch in batches if batch]
    if processes == 1:  # one process for all, which need not be begun anew for each batch
        waiting = [[case for batch in waiting for case in batch]]
    shared_memory = Path("/dev/shm")
    root = Path(tempfile.mkdtemp(prefix="endoct-fuzz-", dir=shared_memory if shared_memory.is_dir() else None))
    workers: list[_Worker] = []
    try:
        number = 0
        while waiting or workers:
            while waiting and len(workers) < processes:
                cases = waiting.pop(0)
                while processes > 1 and waiting and len(cases) < 8 * BATCH:
                    cases = cases + waiting.pop(0)
                workers.append(_begun(context, cases, seed, root / f"{number}", seconds))
                number += 1
            wait([worker.connection for worker in workers], timeout=1.0)
            for worker in list(workers):
                left = _follow(worker, account, findings, seconds)
                if left is not None:
                    workers.remove(worker)
                    shutil.rmtree(worker.scratch, ignore_errors=True)
                    if left:
                        waiting.insert(0, list(left))
            if progress is not None:
                progress(account)
    finally:
        for worker in workers:
            worker.process.kill()
            worker.process.join()
        shutil.rmtree(root, ignore_errors=True)
    return account


def _begun(context: Any, cases: Sequence[Case], seed: int, scratch: Path, seconds: float | None) -> _Worker:
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=try_cases, args=(sending, cases, seed, scratch, seconds), daemon=True)
    process.start()
    sending.close()
    return _Worker(process, receiving, cases, scratch)


def _follow(worker: _Worker, account: Account, findings: Path | None, seconds: float | None) -> Sequence[Case] | None:
    """Count what a worker reports; return the cases that are left where it has ended, else None."""
    ended = False
    try:
        while worker.connection.poll():
            report: Report = worker.connection.recv()
            _add(report, account, findings)
            worker.done += 1
            worker.since = time.monotonic()
            worker.leaving = report.leave
    except EOFError:
        ended = True
    left = worker.cases[worker.done :]
    if ended:
        worker.process.join(10)
        if not left or worker.leaving:
            return left
        code = worker.process.exitcode
        if code == 1:
            raise RuntimeError(f"the harness failed at {left[0]}: {_last_words(worker)}")
        name = signal.Signals(-code).name if code is not None and code < 0 else f"status {code}"
        _add_lost(worker, Outcome("died", name, _last_words(worker)), account, findings)
        return left[1:]
    limit = seconds or READERS[left[0].reader].seconds if left else 60.0
    if time.monotonic() - worker.since > PATIENCE * limit + (300.0 if not worker.done else 0.0):
        worker.process.kill()
        worker.process.join()
        _add_lost(worker, Outcome("hangs in C", "", _last_words(worker)), account, findings)
        return left[1:]
    return None


def _add_lost(worker: _Worker, outcome: Outcome, account: Account, findings: Path | None) -> None:
    if not (worker.scratch / "case").is_dir():
        raise RuntimeError(f"a process cannot begin: {outcome.message}")
    _add(Report(worker.cases[worker.done], outcome, files=worker.scratch / "case"), account, findings)


def _add(report: Report, account: Account, findings: Path | None) -> None:
    stored = None
    if report.files is not None:
        group = (report.case.reader, report.outcome.kind, report.outcome.where)
        if findings is not None and account.findings[group] < STORED_ALIKE:
            stored = _stored(report, report.files, findings)
        shutil.rmtree(report.files, ignore_errors=True)
    account.add(report, stored)


def _stored(report: Report, files: Path, findings: Path) -> Path:
    """Store a finding's files as they were made, and its message."""
    outcome, case = report.outcome, report.case
    name = "-".join(filter(None, (outcome.kind, outcome.where, str(case.number))))
    place = findings / case.reader / "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    text = f"{case.reader} {case.number}: {outcome.kind} in {outcome.where}\n\n{outcome.message}\n"
    (place / "outcome.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
    copy_case(files, place / "case")
    return place


def _last_words(worker: _Worker) -> str:
    try:
        return (worker.scratch / "stderr").read_bytes()[-4000:].decode("utf-8", "replace")
    except OSError:
        return ""
