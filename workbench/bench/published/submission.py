"""A submission: what methods scored on a published set, with digests of data and code, versions, machine and times.

It is one JSON file with a digest of itself, so that a file that was edited or cut off is noticed. That is no
protection against forgery, so :func:`check` runs a sample of its cases again and compares scores to the last digit.
Nothing that a submission names is run but methods that are installed here: commands come from whoever checks.
"""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from endoct.base.entry_points import unknown_name
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import check_output, new_output
from endoct.workbench.bench.checkpoint import machine, open_checkpoint, source_digests
from endoct.workbench.bench.program import with_programs
from endoct.workbench.bench.published.specimen_set import (
    Entry,
    SpecimenSet,
    check_specimen,
    digest_of_entries,
    read_finished_set,
)
from endoct.workbench.bench.published.submitted import FORMAT, check_credible
from endoct.workbench.bench.published.submitted import Scored as Scored  # part of what this module offers
from endoct.workbench.bench.published.submitted import Submission as Submission
from endoct.workbench.bench.runner import Plan, Row, run, run_source
from endoct.workbench.bench.task import AnyTask, check_names, load_task, origin
from endoct.workbench.running.outputs import SUBMISSION, versions
from endoct.workbench.running.progress import Stages

NO_PROGRAMS: Mapping[str, str] = MappingProxyType({})
MOST_BYTES = 64_000_000
NEAR = 1e-6
"""Scores that differ relatively by less are the same but for the last bits, which depend on the processor."""


def submit(
    data: Path,
    task_name: str,
    output: Path,
    *,
    methods: Sequence[str] = (),
    programs: Mapping[str, str] = NO_PROGRAMS,
    workers: int = 1,
    overwrite: bool = False,
    stages: Stages,
) -> Submission:
    """Run methods on the specimens of the set in ``data`` that are for a task, and write ``output``.

    ``programs``: commands of methods that are programs, by name; with some, only those ``methods`` that are named run.
    Every specimen is checked against its digests first. A run that was stopped goes on with the same command. Raises
    :class:`EndoctError` where the set is damaged, none of its specimens is for the task, or ``output`` exists.
    """
    specimens = read_finished_set(data)
    task = with_programs(load_task(task_name), programs)
    entries = entries_for(specimens, task_name, data)
    folders = tuple((data / one.name).absolute() for one in entries)
    plan = Plan(
        task_name, check_names(task, [*methods, *programs]), own=folders, programs=programs, hidden=data.absolute()
    )
    check_output(output, SUBMISSION, overwrite=overwrite, inputs=[data], is_ours=is_submission)
    check_entries(data, entries, stages)
    checkpoint = open_checkpoint(output, plan, overwrite=overwrite)
    start = time.perf_counter()
    rows = checkpoint.read()

    def keep(place: int, new: Sequence[Row]) -> None:
        checkpoint.save(place, new)
        rows[place] = list(new)

    try:
        with stages.stage(f"bench {task_name}") as advance:
            run(plan, workers=workers, advance=advance, finished=dict(rows), keep=keep)
    except KeyboardInterrupt:
        kept = f"{len(checkpoint.read())} of {len(entries)} specimens are kept in {checkpoint.folder}"
        raise KeyboardInterrupt(f"{kept}; the same command goes on") from None
    submission = _submission(specimens, task, entries, plan, rows, workers, time.perf_counter() - start)
    with new_output(output, SUBMISSION, overwrite=overwrite, inputs=[data], is_ours=is_submission) as scratch:
        scratch.write_bytes(text_of(submission).encode())
    checkpoint.remove()
    return submission


def entries_for(specimens: SpecimenSet, task: str, folder: Path) -> tuple[Entry, ...]:
    """Return the specimens of a set that are for a task. Raises :class:`EndoctError` where there is none."""
    entries = tuple(one for one in specimens.specimens if task in one.tasks)
    if not entries:
        known = sorted({each for one in specimens.specimens for each in one.tasks})
        raise EndoctError(f"no specimen of {folder} is for the task '{task}'", expected=" or ".join(known))
    return entries


def check_entries(data: Path, entries: Sequence[Entry], stages: Stages) -> None:
    """Compare specimens with their digests. Raises :class:`EndoctError` where one is not as the set says."""
    with stages.stage("check of the data") as advance:
        for done, entry in enumerate(entries, 1):
            check_specimen(data, entry)
            advance(done / len(entries))


def _submission(
    specimens: SpecimenSet,
    task: AnyTask,
    entries: tuple[Entry, ...],
    plan: Plan,
    rows: dict[int, list[Row]],
    workers: int,
    seconds: float,
) -> Submission:
    every = [(entries[place].name, row) for place in sorted(rows) for row in rows[place]]
    left_out = {row.method: row.reason for _, row in every if row.status == "missing"}
    scored = tuple(scored_row(name, row) for name, row in every if row.method not in left_out)
    if not scored:
        raise EndoctError("none of the methods is installed", found="; ".join(left_out.values()))
    return Submission(
        set=specimens.set,
        half=specimens.half,
        size=specimens.size,
        task=task.name,
        specimens=entries,
        methods={name: origin(task, name) for name in plan.methods if name not in left_out},
        programs=dict(plan.programs),
        sources=dict(source_digests(plan)),
        left_out=left_out,
        rows=scored,
        versions=versions(),
        machine=machine(),
        workers=workers,
        seconds=round(seconds, 1),
    )


def scored_row(specimen: str, row: Row) -> Scored:
    """Return a row of a run as a submission states it."""
    facts = asdict(row)
    del facts["conditions"]
    return Scored(specimen=specimen, **facts)


def text_of(submission: Submission) -> str:
    """Return the JSON of a submission, with the digest of its content."""
    content = submission.model_dump(mode="json")
    return json.dumps({**content, "digest": _digest(content)}, indent=1, ensure_ascii=False) + "\n"


def read_submission(path: Path) -> Submission:
    """Return what :func:`submit` wrote. Raises :class:`EndoctError` where it is something else, or was changed."""
    with refusing(f"{path} cannot be used", expected="a file that `endoct bench submit` wrote", remedy="submit again"):
        content = json.loads(read_small(path, MOST_BYTES))
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise ValueError("it is no submission")
        if content.pop("digest", None) != _digest(content):
            raise ValueError("its content was changed since it was written")
        return Submission.model_validate(content)


def is_submission(path: Path) -> bool:
    """Say whether a file is a submission that nobody changed."""
    try:
        read_submission(path)
    except EndoctError:
        return False
    return True


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Rerun:
    """One row of a submission, and what came of it here."""

    stated: Scored
    again: Scored

    @property
    def worst(self) -> float:
        """Return the largest relative difference of a score; infinite where status or scores are others."""
        before, again = self.stated.scores, self.again.scores
        if self.stated.status != self.again.status or before.keys() != again.keys():
            return float("inf")
        pairs = [(before[name], again[name]) for name in before]
        return max((abs(a - b) / max(abs(a), abs(b)) for a, b in pairs if a != b), default=0.0)

    @property
    def verdict(self) -> str:
        """Return "equal" to the last digit, "near" or "different"."""
        if self.stated.outcome == self.again.outcome:
            return "equal"
        return "near" if self.worst < NEAR else "different"


@dataclass(frozen=True)
class Checked:
    """A submission, its rows that were run again, and the digest of the data here.

    ``programs``: by name, the command of each method that is a program here, "" where it was not run again.
    """

    submission: Submission
    reruns: tuple[Rerun, ...]
    data_digest: str
    programs: Mapping[str, str]

    @property
    def is_of_equal_data(self) -> bool:
        """Say whether the data here are equal to the bit to those of the submission."""
        return self.data_digest == self.submission.data_digest

    def count(self, verdict: str) -> int:
        """Return how many rows have a verdict."""
        return sum(rerun.verdict == verdict for rerun in self.reruns)


def check(
    path: Path,
    data: Path,
    *,
    sample: int,
    methods: Sequence[str] = (),
    programs: Mapping[str, str] = NO_PROGRAMS,
    stages: Stages,
) -> Checked:
    """Run ``sample`` specimens of a submission again, drawn by the digest of its content, with all or some ``methods``.

    ``programs``: commands, by name, of those methods that are programs. The file's own commands are never run: its
    programs are left out but for these. Raises :class:`EndoctError` where ``data`` is not the set it was run on, the
    submission lacks some of it or cannot be believed, or a method is not installed here.
    """
    submission = read_submission(path)
    expected = entries_for(read_finished_set(data), submission.task, data)
    check_credible(submission, str(path), [one.name for one in expected])
    names = _methods_to_run(submission, methods, programs)
    entries = _here(submission, data)
    chosen = sorted(entries, key=lambda one: hashlib.sha256(f"{submission.data_digest} {one.name}".encode()).digest())
    chosen = chosen[:sample]
    check_entries(data, chosen, stages)
    task = with_programs(load_task(submission.task), programs)
    plan = Plan(submission.task, check_names(task, names), programs=programs, hidden=data.absolute())
    stated = {(row.specimen, row.case, row.method): row for row in submission.rows}
    reruns: list[Rerun] = []
    with stages.stage(f"{len(chosen)} of {len(entries)} specimens again") as advance:
        for done, entry in enumerate(chosen, 1):
            for row in run_source(plan, (data / entry.name).absolute()):
                if row.status == "missing":
                    raise EndoctError(
                        f"the method '{row.method}' cannot be run again here",
                        found=row.reason,
                        remedy="install that, or name the methods to run with --methods",
                    )
                again = scored_row(entry.name, row)
                before = stated.get((again.specimen, again.case, again.method))
                if before is None:
                    raise EndoctError(f"the submission lacks {again.method} on {again.case}", found=str(path))
                reruns.append(Rerun(before, again))
            advance(done / len(chosen))
    here = {name: programs.get(name, "") for name in submission.programs}
    return Checked(submission, tuple(reruns), digest_of_entries(entries), here)


def _methods_to_run(submission: Submission, methods: Sequence[str], programs: Mapping[str, str]) -> tuple[str, ...]:
    """Return the methods to run again. Raises :class:`EndoctError` for an unknown one, and where there is none."""
    for name in (*methods, *programs):
        if name not in submission.methods:
            unknown_name(name, tuple(submission.methods), "method of the submission")
    if installed := [name for name in programs if name not in submission.programs]:
        raise EndoctError(f"'{installed[0]}' is no program", found=submission.methods[installed[0]])
    known = [name for name in submission.methods if name not in submission.programs or name in programs]
    lacking = [name for name in methods or submission.programs if name not in known]
    if lacking and (methods or not known):
        raise EndoctError(
            f"the method '{lacking[0]}' is a program, and no command of a file is run",
            found=f"the file says {submission.programs[lacking[0]]}",
            remedy=f"install that, and say how to run it: --program {lacking[0]}=COMMAND",
        )
    return tuple(dict.fromkeys([*methods, *programs])) if methods else tuple(known)


def _here(submission: Submission, data: Path) -> tuple[Entry, ...]:
    """Return the specimens of a submission as they are in ``data``. Raises where it has others by the same names."""
    there = {one.name: one for one in read_finished_set(data).specimens}
    for entry in submission.specimens:
        if entry.name not in there:
            raise EndoctError(f"{data} lacks {entry.name}", expected=f"the {submission.half} half of {submission.set}")
        if not there[entry.name].is_alike(entry):
            raise EndoctError(f"{entry.name} in {data} is another specimen", found=there[entry.name].digest[:16])
    return tuple(there[entry.name] for entry in submission.specimens)
