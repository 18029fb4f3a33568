"""A submission: what methods scored on a published set, with digests of data and code, versions, machine and times.

It is one JSON file with a digest of itself, so that a file that was edited or cut off is noticed. That is no
protection against forgery, which is what :mod:`endoct.workbench.bench.published.checking` is for.
"""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import check_output, new_output
from endoct.workbench.bench.checkpoint import machine, open_checkpoint, source_digests
from endoct.workbench.bench.program import with_programs
from endoct.workbench.bench.published.definition import load_definition
from endoct.workbench.bench.published.specimen_set import Entry, SpecimenSet, check_specimen, read_finished_set
from endoct.workbench.bench.published.submitted import FORMAT, Scored, Submission
from endoct.workbench.bench.runner import BenchPlan, MethodResult, run
from endoct.workbench.bench.task import AnyTask, check_names, load_task, origin
from endoct.workbench.running.outputs import SUBMISSION, versions
from endoct.workbench.running.progress import Stages

NO_PROGRAMS: Mapping[str, str] = MappingProxyType({})
MOST_BYTES = 64_000_000


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
    """Run methods on the specimens of the set in ``data`` to test a task on, and write ``output``.

    ``programs``: commands of methods that are programs, by name; with some, only those ``methods`` that are named run.
    Every specimen is checked against its digests first. A run that was stopped goes on with the same command. Raises
    :class:`EndoctError` where the set is damaged, none of its specimens is for the task, or ``output`` exists.
    """
    specimens = read_finished_set(data)
    task = with_programs(load_task(task_name), programs)
    entries = entries_for(specimens, task_name, data)
    folders = tuple((data / entry.name).absolute() for entry in entries)
    plan = BenchPlan(
        task_name, check_names(task, [*methods, *programs]), own=folders, programs=programs, hidden=data.absolute()
    )
    check_output(output, SUBMISSION, overwrite=overwrite, inputs=[data], is_ours=is_submission)
    check_entries(data, entries, stages)
    checkpoint = open_checkpoint(output, plan, overwrite=overwrite)
    start = time.perf_counter()
    with checkpoint.said_to_resume(plan), stages.stage(f"bench {task_name}") as advance:
        run(plan, workers=workers, advance=advance, finished=checkpoint.read(), keep=checkpoint.save)
    seconds = time.perf_counter() - start
    submission = _submission(specimens, task, entries, plan, checkpoint.read(), workers, seconds)
    with new_output(output, SUBMISSION, overwrite=overwrite, inputs=[data], is_ours=is_submission) as scratch:
        scratch.write_bytes(text_of(submission).encode())
    checkpoint.remove()
    return submission


def entries_for(specimens: SpecimenSet, task: str, folder: Path) -> tuple[Entry, ...]:
    """Return the specimens of a set that methods are scored on in a task.

    Raises :class:`EndoctError` where there is none, and for the set of a closed benchmark.
    """
    if "test" not in load_definition(specimens.set).splits:
        raise EndoctError(
            f"{specimens.set} in {folder} is closed: every specimen of it is to learn from",
            remedy="`endoct bench make` with that folder makes today's benchmark of the same specimens",
        )
    entries = tuple(specimen for specimen in specimens.specimens if task in specimen.tasks and specimen.split == "test")
    if not entries:
        known = sorted({name for specimen in specimens.specimens for name in specimen.tasks})
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
    plan: BenchPlan,
    rows: dict[int, list[MethodResult]],
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


def scored_row(specimen: str, row: MethodResult) -> Scored:
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


def digest_of(submission: Submission) -> str:
    """Return the digest of what a submission says."""
    return _digest(submission.model_dump(mode="json"))


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
