"""A submission checked: a sample of its cases run again here, and compared to the last digit."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from endoct.base.entry_points import unknown_name
from endoct.base.errors import EndoctError
from endoct.workbench.bench.program import with_programs
from endoct.workbench.bench.published.specimen_set import Entry, digest_of_entries, read_finished_set
from endoct.workbench.bench.published.submission import Scored, Submission, check_entries, read_submission, scored_row
from endoct.workbench.bench.runner import Plan, run_source
from endoct.workbench.bench.task import check_names, load_task
from endoct.workbench.running.progress import Stages

NEAR = 1e-6
"""Relative: scores that differ by less are the same but for the last bits, which depend on the processor."""


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
    """A submission, its rows that were run again, and the digest of the data here."""

    submission: Submission
    reruns: tuple[Rerun, ...]
    data_digest: str

    @property
    def is_of_equal_data(self) -> bool:
        """Say whether the data here are equal to the bit to those of the submission."""
        return self.data_digest == self.submission.data_digest

    def count(self, verdict: str) -> int:
        """Return how many rows have a verdict."""
        return sum(rerun.verdict == verdict for rerun in self.reruns)


def check(path: Path, data: Path, *, sample: int, methods: Sequence[str] = (), stages: Stages) -> Checked:
    """Run ``sample`` specimens of a submission again, drawn by the digest of its content, with all or some ``methods``.

    Raises :class:`EndoctError` where ``data`` is not the set it was run on, or a method is not installed here.
    """
    submission = read_submission(path)
    if others := [name for name in methods if name not in submission.methods]:
        unknown_name(others[0], tuple(submission.methods), "method of the submission")
    entries = _here(submission, data)
    chosen = sorted(entries, key=lambda one: hashlib.sha256(f"{submission.data_digest} {one.name}".encode()).digest())
    chosen = chosen[:sample]
    check_entries(data, chosen, stages)
    names = tuple(methods or submission.methods)
    programs = {name: command for name, command in submission.programs.items() if name in names}
    task = with_programs(load_task(submission.task), programs)
    plan = Plan(submission.task, check_names(task, names), programs=programs)
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
    return Checked(submission, tuple(reruns), digest_of_entries(entries))


def _here(submission: Submission, data: Path) -> tuple[Entry, ...]:
    """Return the specimens of a submission as they are in ``data``. Raises where it has others by the same names."""
    there = {one.name: one for one in read_finished_set(data).specimens}
    for entry in submission.specimens:
        if entry.name not in there:
            raise EndoctError(f"{data} lacks {entry.name}", expected=f"the {submission.half} half of {submission.set}")
        if not there[entry.name].is_alike(entry):
            raise EndoctError(f"{entry.name} in {data} is another specimen", found=there[entry.name].digest[:16])
    return tuple(there[entry.name] for entry in submission.specimens)
