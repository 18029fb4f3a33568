"""Methods run over cases: the same cases for all, whatever a method does.

The cases are chosen by seeds and by the ranges that conditions are drawn from.
"""

import difflib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Literal

from endoct.base.errors import EndoctError
from endoct.workbench.bench.apart import apart, seed_global_generators
from endoct.workbench.bench.program import with_programs
from endoct.workbench.bench.task import (
    AnyCase,
    AnyTask,
    Conditions,
    Declined,
    NotInstalled,
    Range,
    load_method,
    load_task,
)
from endoct.workbench.running.progress import Advance
from endoct.workbench.running.scheduler import one_blas_thread
from endoct.workbench.settings import numbers, range_texts, words

Status = Literal["ok", "declined", "failed", "missing"]
LONGEST_REASON = 300
MOST_SEEDS = 1_000_000
LONGEST_SEED = 18
Source = tuple[int, int] | Path
"""(seed, index) of a simulated case, or a folder of the user's own data."""


@dataclass(frozen=True)
class BenchPlan:
    """What to run: cases from ``seeds`` × ``count``, drawn from ``ranges``, or those in the folders ``own``.

    ``programs``: the commands of methods that are programs, by name. ``hidden``: the folder that holds the truth of
    ``own``, where every method runs in a process of its own and must not see it.
    """

    task: str
    methods: tuple[str, ...]
    seeds: tuple[int, ...] = ()
    count: int = 1
    ranges: Mapping[str, Range] | None = None
    own: tuple[Path, ...] = ()
    programs: Mapping[str, str] = field(default_factory=dict)
    hidden: Path | None = None

    def load_task(self) -> AnyTask:
        """Return the task with the plan's programs as methods."""
        return with_programs(load_task(self.task), self.programs)

    @property
    def sources(self) -> list["Source"]:
        """Return where the cases come from, in order."""
        return [*self.own] or [(seed, index) for seed in self.seeds for index in range(self.count)]


@dataclass(frozen=True)
class MethodResult:
    """What came of one method on one case.

    ``status`` is "ok", "declined" (it said it does not know), "failed" (it raised, or its answer is useless) or
    "missing" (a library is not installed). All but "ok" have a ``reason``. ``seconds`` are wall time in the method,
    and in its process where it has one; ``cpu_seconds`` are those of all its threads and processes.
    """

    case: str
    method: str
    status: Status
    reason: str
    seconds: float
    cpu_seconds: float
    conditions: Conditions
    scores: Mapping[str, float]


Keep = Callable[[int, Sequence[MethodResult]], None]


def run(
    plan: BenchPlan,
    *,
    workers: int,
    advance: Advance,
    finished: Mapping[int, Sequence[MethodResult]] | None = None,
    keep: Keep | None = None,
) -> list[MethodResult]:
    """Run every method on every case; rows in the order of the cases, then of the methods.

    Cases and scores do not depend on ``workers``, the processes that share them. ``finished`` holds the rows of
    sources, by their place in the plan, that need not be run again; ``keep`` is given those of each as it is done.
    A method that raises, or cannot be imported, has failed and stops nothing; one whose library is not installed is
    missing. Raises :class:`EndoctError` where a case cannot be made, or a method kills its whole process.
    """
    rows = dict(finished or {})
    wanted = {place: source for place, source in enumerate(plan.sources) if place not in rows}
    run_all = _run_here if workers == 1 else partial(_run_by_processes, workers=workers)
    for place, new in run_all(plan, wanted, advance):
        rows[place] = new
        if keep is not None:
            keep(place, new)
    return [row for place in sorted(rows) for row in rows[place]]


def _run_here(
    plan: BenchPlan, wanted: Mapping[int, Source], advance: Advance
) -> Iterator[tuple[int, list[MethodResult]]]:
    for done, (place, source) in enumerate(wanted.items()):
        yield place, run_source(plan, source, lambda share: advance((done + share) / len(wanted)))  # noqa: B023


def _run_by_processes(
    plan: BenchPlan, wanted: Mapping[int, Source], advance: Advance, workers: int
) -> Iterator[tuple[int, list[MethodResult]]]:
    from distributed import KilledWorker, as_completed

    from endoct.workbench.running.cluster import own_cluster

    with own_cluster(max(1, min(workers, len(wanted)))) as client:
        places = {client.submit(run_source, plan, source, pure=False): place for place, source in wanted.items()}
        try:
            for done, future in enumerate(as_completed(places), 1):
                yield places[future], future.result()
                advance(done / len(places))
        except KilledWorker as error:
            raise EndoctError(
                "a method killed its process, again and again",
                expected="an exception at worst",
                remedy="run the methods one by one with --workers 1 to see which",
            ) from error


@one_blas_thread()
def run_source(plan: BenchPlan, source: Source, advance: Advance | None = None) -> list[MethodResult]:
    """Run every method on the cases of one source, BLAS with one thread for all."""
    task = plan.load_task()
    if plan.hidden is not None:
        task = apart(task, plan.methods, plan.hidden)
    cases = _cases(task, source, plan)
    rows: list[MethodResult] = []
    for case in cases:
        try:
            for name in plan.methods:
                rows.append(run_method(task, name, case))
                if advance is not None:
                    advance(len(rows) / (len(cases) * len(plan.methods)))
        finally:
            if case.scratch is not None:
                case.scratch.cleanup()
    return rows


def _cases(task: AnyTask, source: Source, plan: BenchPlan) -> Sequence[AnyCase]:
    if not isinstance(source, Path):
        return [task.cases(*source, task.ranges if plan.ranges is None else plan.ranges)]
    if task.own is None:
        raise EndoctError(f"the task '{task.name}' reads no data of your own", remedy="leave --data out")
    return task.own(source)


def run_method(task: AnyTask, name: str, case: AnyCase) -> MethodResult:
    """Run one method on one case."""
    status: Status = "ok"
    reason = ""
    scores: dict[str, float] = {}
    seconds = cpu_seconds = 0.0
    try:
        method = load_method(task, name)
        seed_global_generators(case.name)
        start, cpu_start = time.perf_counter(), _cpu_s()
        try:
            answer = method(*case.given) if isinstance(case.given, tuple) else method(case.given)
        finally:
            seconds, cpu_seconds = time.perf_counter() - start, _cpu_s() - cpu_start
        scores = _judged(task, case, answer)
    except Declined as declined:
        status, reason, scores = "declined", declined.reason, _numbers(declined.scores)
    except NotInstalled as missing:
        status, reason = "missing", str(missing)
    except Exception as error:  # noqa: BLE001 – whatever a method raises is its result, whoever wrote it
        status, reason = "failed", _reason(error)
        if isinstance(error, ModuleNotFoundError) and not (error.name or "endoct").startswith("endoct"):
            status, reason = "missing", f"{error.name} is not installed"
    return MethodResult(case.name, name, status, reason[:LONGEST_REASON], seconds, cpu_seconds, case.conditions, scores)


def _judged(task: AnyTask, case: AnyCase, answer: object) -> dict[str, float]:
    try:
        return _numbers(task.judge(case, answer))
    except Declined:
        raise
    except Exception as error:
        raise EndoctError(f"the answer is useless: {_reason(error)}") from error


def _numbers(scores: Mapping[str, float]) -> dict[str, float]:
    """Return the scores that are finite; a score that does not exist for a case is left out."""
    return {name: float(value) for name, value in scores.items() if isfinite(value)}


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, EndoctError) else f"{type(error).__name__}: {text}"


def _cpu_s() -> float:
    """Return the seconds of all processors that this process has taken, and those of its that have ended."""
    return sum(os.times()[:4])


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of "1000-1009", "3,5,8" or both, each once. Raises :class:`EndoctError` for another form."""
    seeds: list[int] = []
    for piece in text.split(","):
        first, dash, last = piece.strip().partition("-")
        if not _is_seed(first) or (dash and not (_is_seed(last) and int(last) >= int(first))):
            raise EndoctError(
                "seeds cannot be read", found=f"'{text[:80]}'", expected="first-last, or numbers with commas"
            )
        more = range(int(first), int(last or first) + 1)
        if len(seeds) + len(more) > MOST_SEEDS:
            raise EndoctError("these are too many seeds", found=f"'{text[:80]}'", expected=f"{MOST_SEEDS} at most")
        seeds += more
    return tuple(dict.fromkeys(seeds))


def narrowed(task: AnyTask, wanted: Sequence[str], sweep: str | None = None) -> dict[str, Range]:
    """Return the ranges of ``task``, of which those in ``wanted`` ("name=low..high", "name=word|word") are replaced.

    With ``sweep``, that condition alone is varied. All others
    that are not in ``wanted`` stay at the middle of their range, or at their first word. Raises :class:`EndoctError`
    for a condition that the task does not have, or a range that cannot be drawn from.
    """
    ranges, known = dict(task.ranges), {**task.ranges, **task.optional}
    texts = range_texts(wanted, "condition")
    for name in [*texts, *([sweep] if sweep is not None else [])]:
        if name not in known:
            nearest = difflib.get_close_matches(name, known, 1, cutoff=0.4)
            expected = f"'{nearest[0]}'" if nearest else ", ".join(task.ranges) or "none: it varies nothing"
            raise EndoctError(f"'{name}' is no condition of '{task.name}'", expected=expected)
    for name, text in texts.items():
        ranges[name] = _range(name, text, known[name])
    if sweep is not None:
        ranges.setdefault(sweep, known[sweep])
        for name in ranges.keys() - texts.keys() - {sweep}:
            ranges[name] = middle(ranges[name])
    return ranges


def middle(range_: Range) -> Range:
    """Return a range narrowed to its middle, or to its first word."""
    if known := [word for word in range_ if isinstance(word, str)]:
        return (known[0],)
    value = sum(number for number in range_ if not isinstance(number, str)) / 2
    return value, value


def _is_seed(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= LONGEST_SEED


def _range(name: str, text: str, usual: Range) -> Range:
    known = [word for word in usual if isinstance(word, str)]
    if known:
        if unknown := [word for word in words(text) if word not in known]:
            raise EndoctError(f"'{name}={text}' cannot be drawn", found=", ".join(unknown), expected=" or ".join(known))
        return words(text)
    range_ = numbers(text)
    if range_ is None:
        raise EndoctError("a condition cannot be read", found=f"'{name}={text}'", expected="name=low..high")
    if not (all(map(isfinite, range_)) and range_[0] <= range_[1]):
        raise EndoctError("a condition cannot be drawn", found=f"'{name}={text}'", expected="name=low..high, low first")
    return range_
