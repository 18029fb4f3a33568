"""A submission checked: a sample of its rows is run again, and compared to the last digit.

Nothing that a submission names is run but methods that are installed here: commands come from whoever checks. What came
of it is a receipt. A board believes what has one, and marks the rest as not checked.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from endoct.base.entry_points import unknown_name
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.workbench.bench.program import with_programs
from endoct.workbench.bench.published.definition import Stored
from endoct.workbench.bench.published.specimen_set import Entry, digest_of_entries, read_finished_set
from endoct.workbench.bench.published.submission import (
    NO_PROGRAMS,
    check_entries,
    digest_of,
    entries_for,
    read_submission,
    scored_row,
)
from endoct.workbench.bench.published.submitted import Scored, Submission, check_credible
from endoct.workbench.bench.runner import BenchPlan, run_source
from endoct.workbench.bench.task import check_names, load_task
from endoct.workbench.running.progress import Stages

NEAR = 1e-6
"""Scores that differ relatively by less are the same but for the last bits, which depend on the processor."""
Verdict = Literal["equal", "near", "different"]
VERDICTS: tuple[Verdict, ...] = ("equal", "near", "different")
RECEIPT_FORMAT = "endoct bench receipt 1"


class Receipt(Stored):
    """What came of a check, for the board: by method, the worst verdict of its rows on ``specimens``."""

    format: str = RECEIPT_FORMAT
    submission: str
    nonce: str
    specimens: tuple[str, ...]
    verdicts: dict[str, Verdict]


def read_receipts(folder: Path | None) -> dict[str, list[Receipt]]:
    """Return the receipts in a folder, by the digests of submissions. Raises :class:`EndoctError` for another file."""
    receipts: dict[str, list[Receipt]] = {}
    for path in sorted(folder.glob("*.json")) if folder is not None else ():
        with refusing(f"{path} is no receipt", expected="a file that `endoct bench check --receipt` wrote"):
            content = json.loads(read_small(path))
            if content.get("format") != RECEIPT_FORMAT:
                raise ValueError("it has another format")
            receipt = Receipt.model_validate(content)
        receipts.setdefault(receipt.submission, []).append(receipt)
    return receipts


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
    def verdict(self) -> Verdict:
        """Return "equal" to the last digit, "near" or "different"."""
        if self.stated.outcome == self.again.outcome:
            return "equal"
        return "near" if self.worst < NEAR else "different"


@dataclass(frozen=True)
class Checked:
    """A submission, its rows that were run again, and the digest of the data here.

    ``nonce``: what the sample was drawn by. ``programs``: by name, the command of each method that is a program here,
    "" where it was not run again.
    """

    submission: Submission
    reruns: tuple[Rerun, ...]
    data_digest: str
    programs: Mapping[str, str]
    nonce: str = ""

    @property
    def is_of_equal_data(self) -> bool:
        """Say whether the data here are equal to the bit to those of the submission."""
        return self.data_digest == self.submission.data_digest

    @property
    def receipt(self) -> "Receipt":
        """Return what a board needs of it."""
        verdicts: dict[str, Verdict] = {}
        for rerun in self.reruns:
            before = verdicts.get(rerun.again.method, "equal")
            verdicts[rerun.again.method] = max(before, rerun.verdict, key=VERDICTS.index)
        specimens = tuple(dict.fromkeys(rerun.again.specimen for rerun in self.reruns))
        return Receipt(submission=digest_of(self.submission), nonce=self.nonce, specimens=specimens, verdicts=verdicts)

    def count(self, verdict: str) -> int:
        """Return how many rows have a verdict."""
        return sum(rerun.verdict == verdict for rerun in self.reruns)


def check(
    path: Path,
    data: Path,
    *,
    sample: int,
    nonce: str,
    methods: Sequence[str] = (),
    programs: Mapping[str, str] = NO_PROGRAMS,
    stages: Stages,
) -> Checked:
    """Run ``sample`` specimens of a submission again, with all or some ``methods``.

    The sample is drawn by ``nonce``, which whoever checks makes up once the submission is there, so that nobody knows
    before which rows have to be true.
    ``programs``: commands, by name, of those methods that are programs. The file's own commands are never run: its
    programs are left out but for these. Raises :class:`EndoctError` where ``data`` is not the set it was run on, the
    submission lacks some of it or cannot be believed, or a method is not installed here.
    """
    submission = read_submission(path)
    expected = entries_for(read_finished_set(data), submission.task, data)
    check_credible(submission, str(path), [one.name for one in expected])
    names = _methods_to_run(submission, methods, programs)
    entries = _here(submission, data)
    digest = digest_of(submission)
    chosen = sorted(entries, key=lambda entry: hashlib.sha256(f"{nonce} {digest} {entry.name}".encode()).digest())
    chosen = chosen[:sample]
    check_entries(data, chosen, stages)
    task = with_programs(load_task(submission.task), programs)
    plan = BenchPlan(submission.task, check_names(task, names), programs=programs, hidden=data.absolute())
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
    return Checked(submission, tuple(reruns), digest_of_entries(entries), here, nonce)


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
    there = {specimen.name: specimen for specimen in read_finished_set(data).specimens}
    for entry in submission.specimens:
        if entry.name not in there:
            raise EndoctError(f"{data} lacks {entry.name}", expected=f"the {submission.half} half of {submission.set}")
        if not there[entry.name].is_alike(entry):
            raise EndoctError(f"{entry.name} in {data} is another specimen", found=there[entry.name].digest[:16])
    return tuple(there[entry.name] for entry in submission.specimens)
