"""What a submission says, and whether it can be believed before anything is run again."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from pydantic import NonNegativeFloat

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.definition import Half, Size, Stored
from endoct.workbench.bench.published.specimen_set import Entry, digest_of_entries
from endoct.workbench.bench.runner import Status
from endoct.workbench.bench.task import SUCCESS, load_task, score_range

FORMAT = "endoct bench submission 1"
OURS = "endoct"
"""The name of the method that endoct itself uses, in every task."""
PARTS = frozenset(
    f"endoct.workbench.bench.{place}"
    for place in (
        "rivals.learned_segmentation:learned_eye",
        "rivals.speckle:face_and_speckle",
        "rivals.wall:believed",
        "rivals.wall:endoscope",
        "rivals.wall:oct_alone",
        "tasks.oct:brightest",
        "tasks.oct:even",
        "tasks.oct:without_lost_ascans",
        "tasks.oct:without_rotation",
        "tasks.oct:without_start_angle",
        "tasks.oct:without_turn_length",
    )
)
"""Functions of methods that are no rival's: steps of endoct alone, and endoct with a step more or less.

What others published is none of them, even where endoct's settings do the same, nor what thresholds or joins endoct's
evidence in another way.
"""
MOST_METHODS = 100
"""Of a submission, and of a task of the board: more lines could not be told apart."""


class Scored(Stored):
    """What came of one method on one case of a specimen; see :class:`endoct.workbench.bench.runner.MethodResult`."""

    specimen: str
    case: str
    method: str
    status: Status
    reason: str
    scores: dict[str, float]
    seconds: NonNegativeFloat
    cpu_seconds: NonNegativeFloat

    @property
    def outcome(self) -> tuple[str, dict[str, float]]:
        """Return what does not depend on the machine's speed."""
        return self.status, self.scores

    @property
    def succeeds(self) -> bool:
        """Say whether the judge called it a success."""
        return self.scores.get(SUCCESS, 0.0) > 0.5

    def score_of(self, name: str) -> float:
        """Return a score of a case that was answered; NaN where there is none."""
        return self.scores.get(name, math.nan) if self.status == "ok" else math.nan


class Submission(Stored):
    """The content of a submission.

    ``specimens``: those it was run on, with the digests of what was read. ``methods``: by name where each comes from;
    of these ``programs`` are commands, of whose source nothing is known.
    ``sources``: digests of endoct's source and of the modules of others' methods. ``left_out``: methods whose library
    is not installed, with the reason.
    """

    format: str = FORMAT
    set: str
    half: Half
    size: Size
    task: str
    specimens: tuple[Entry, ...]
    methods: dict[str, str]
    programs: dict[str, str]
    sources: dict[str, str]
    left_out: dict[str, str]
    rows: tuple[Scored, ...]
    versions: dict[str, str]
    machine: dict[str, Any]
    workers: int
    seconds: float

    @property
    def board(self) -> tuple[str, Half, Size, str]:
        """The set and the task whose board it is of."""
        return self.set, self.half, self.size, self.task

    @property
    def data_digest(self) -> str:
        """Return the digest of the specimens that it was run on."""
        return digest_of_entries(self.specimens)


def check_credible(submission: Submission, name: str, specimens: Sequence[str]) -> None:
    """Raise :class:`EndoctError` where a submission called ``name`` cannot be what came of a run.

    Each of its methods has been given every one of ``specimens`` and no other, every case once, and all methods the
    same cases. Scores are those of the task, within what they can be. Programs are methods, under names of their own.
    """

    def refuse(why: str, value: str, expected: str) -> EndoctError:
        return EndoctError(f"the submission {name} cannot be used: {why}", found=value, expected=expected)

    if not (submission.methods and submission.specimens):
        raise refuse("it is empty", "no methods" if submission.specimens else "no specimens", "one at least")
    if len(submission.methods) > MOST_METHODS:
        raise refuse("too many methods", f"{len(submission.methods)}", f"{MOST_METHODS} at most")
    for program, command in submission.programs.items():
        if submission.methods.get(program) != command or program == OURS:
            raise refuse("a program is no method of it, or is called as ours", program, "a name of its own")
    listed = [one.name for one in submission.specimens]
    if sorted(listed) != sorted(specimens):
        missing = sorted(set(specimens) - set(listed))
        raise refuse(
            "it is not of the whole set",
            f"{len(listed)} specimens" + (f", without {missing[0]}" if missing else ""),
            f"each of {len(specimens)} once",
        )
    cases: dict[str, list[tuple[str, str]]] = {method: [] for method in submission.methods}
    task = load_task(submission.task)
    ranges = {score: score_range(task, score) for score in {name for row in submission.rows for name in row.scores}}
    for row in submission.rows:
        if row.method not in cases:
            raise refuse("a row is of none of its methods", row.method, "the methods that it lists")
        cases[row.method].append((row.specimen, row.case))
        for score, value in row.scores.items():
            low, high = ranges[score]
            if not low <= value <= high:
                why = f"{score} of {row.method} on {row.case} is impossible"
                raise refuse(why, f"{value:g}", f"{low:g} to {high:g}")
    of_specimen = {one.name: one.cases(submission.task) for one in submission.specimens}
    first = set(next(iter(cases.values()), ()))
    for method, done in cases.items():
        if set(done) != first or len(done) != len(first) or Counter(specimen for specimen, _ in done) != of_specimen:
            raise refuse(
                f"{method} was not run on every case once",
                f"{len(done)} rows, {len(set(done))} cases",
                f"{sum(of_specimen.values())} cases",
            )
