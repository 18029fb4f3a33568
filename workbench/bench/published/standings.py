"""Where methods stand on a published set: by generator and difficulty, and where endoct's own are beaten."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.checking import Receipt, read_receipts
from endoct.workbench.bench.published.definition import (
    DIFFICULTIES,
    Difficulty,
    Generator,
    Half,
    ScoredTask,
    Size,
    load_definition,
    planned,
)
from endoct.workbench.bench.published.submission import digest_of, read_submission
from endoct.workbench.bench.published.submitted import MOST_METHODS, OURS, Scored, Submission, check_credible
from endoct.workbench.bench.results.score_summary import Share, share
from endoct.workbench.bench.task import load_task

MOST_FILES = 1000


@dataclass(frozen=True)
class Entrant:
    """A method of a submission, by a name that no other of the board has; ``file``: that of the submission.

    ``checked``: specimens that were run again to the same scores; 0 where none was, -1 where scores were others.
    """

    name: str
    origin: str
    file: str
    submission: Submission
    rows: tuple[Scored, ...]
    checked: int = 0


@dataclass(frozen=True)
class Standing:
    """What a method scored on the cases of one generator, of one of its difficulties, or of one side.

    ``success`` and ``median`` of the main score, with its 95 % interval ``low`` to ``high``, are over all cases: what
    was not answered is worse than any answer, infinite. The interval is NaN where there are too few cases. ``mean`` is
    over the ``ok`` cases that have a score; NaN where there is none.
    """

    entrant: Entrant
    cases: int
    ok: int
    declined: int
    failed: int
    success: Share
    median: float
    low: float
    high: float
    mean: float
    seconds: float


@dataclass(frozen=True)
class Loss:
    """Where a method beats endoct's own: cases in which it is better, worse and even, and ``p`` of the sign test.

    An answer that succeeds is better than one that does not, and of two alike the main score decides. ``theirs`` and
    ``ours``: the medians of the main score over the cases that both answered; ``successes``: of both.
    """

    generator: Generator
    side: str
    method: str
    better: int
    worse: int
    even: int
    theirs: float
    ours: float
    successes: tuple[int, int]
    p: float


@dataclass(frozen=True)
class TaskBoard:
    """The entrants of one task on one set, all on the same recordings."""

    set: str
    half: Half
    size: Size
    task: str
    scored: ScoredTask
    meaning: str
    entrants: tuple[Entrant, ...]

    @property
    def generators(self) -> tuple[Generator, ...]:
        """Return who made the specimens, in order."""
        entries = self.entrants[0].submission.specimens
        return tuple(dict.fromkeys(entry.generator for entry in entries))

    @property
    def sign(self) -> int:
        """Return 1 where a higher main score is better, else -1."""
        return 1 if self.scored.better == "higher" else -1

    @property
    def has_equal_data(self) -> bool:
        """Say whether all entrants were given data that are equal to the bit."""
        return len({entrant.submission.data_digest for entrant in self.entrants}) == 1

    def sides(self, generator: Generator) -> tuple[str, ...]:
        """Return which sides the cases of a generator are of, where the task tells: "oct", "endoscope", "both"."""
        return tuple(sorted({side_of(row) for row in self.rows(self.entrants[0], generator)}))

    def rows(
        self, entrant: Entrant, generator: Generator, difficulty: Difficulty | None = None, side: str | None = None
    ) -> list[Scored]:
        """Return an entrant's rows on the specimens of a generator, or of one of its difficulties, or of a side."""
        wanted = {
            specimen.name
            for specimen in entrant.submission.specimens
            if specimen.generator == generator and difficulty in (None, specimen.difficulty)
        }
        return [row for row in entrant.rows if row.specimen in wanted and side in (None, side_of(row))]

    def standings(
        self, generator: Generator, difficulty: Difficulty | None = None, side: str | None = None
    ) -> list[Standing]:
        """Return the entrants' standings, best first: those that were checked, then by success, then the main score.

        What was not answered is worse than any answer. Who was found to have other scores comes last.
        """
        given = [(entrant, self.rows(entrant, generator, difficulty, side)) for entrant in self.entrants]
        made = [_standing(entrant, rows, self.scored.score, -self.sign) for entrant, rows in given if rows]
        trust = {0: 1, -1: 2}
        return sorted(
            made,
            key=lambda standing: (
                trust.get(standing.entrant.checked, 0),
                -standing.success.k / standing.success.n,
                -self.sign * standing.median,
                standing.cases - standing.ok,
            ),
        )

    def difficulties(self, generator: Generator) -> tuple[Difficulty, ...]:
        """Return the difficulties that the specimens of a generator have, easy first."""
        given = {entry.difficulty for entry in self.entrants[0].submission.specimens if entry.generator == generator}
        return tuple(difficulty for difficulty in DIFFICULTIES if difficulty in given)

    def losses(self) -> list[Loss]:
        """Return where another method is better than endoct's own in more cases than it is worse, or succeeds more."""
        ours = next((entrant for entrant in self.entrants if entrant.name == OURS), None)
        if ours is None:
            return []
        losses = [
            self._loss(generator, ours, other, side)
            for generator in self.generators
            for side in self.sides(generator)
            for other in self.entrants
            if other != ours and other.checked >= 0
        ]
        return [loss for loss in losses if loss.better > loss.worse or loss.successes[0] > loss.successes[1]]

    def _loss(self, generator: Generator, ours: Entrant, other: Entrant, side: str | None = None) -> Loss:
        mine = {row.case: row for row in self.rows(ours, generator, side=side)}
        better = worse = even = 0
        both: list[tuple[float, float]] = []
        theirs_of = self.rows(other, generator, side=side)
        for row in theirs_of:
            if (against := mine.get(row.case)) is None:
                continue
            theirs, own = (scored.score_of(self.scored.score) for scored in (row, against))
            if np.isfinite(theirs) and np.isfinite(own):
                both.append((theirs, own))
            lead = float(row.succeeds - against.succeeds)
            if not lead and np.isfinite(theirs) and np.isfinite(own):
                lead = self.sign * (theirs - own)
            better, worse, even = better + (lead > 0), worse + (lead < 0), even + (lead == 0)
        medians = np.median(both, axis=0) if both else (np.nan, np.nan)
        successes = sum(row.succeeds for row in theirs_of), sum(row.succeeds for row in mine.values())
        p = float(stats.binomtest(better, better + worse).pvalue) if better + worse else 1.0
        medians_of = float(medians[0]), float(medians[1])
        return Loss(generator, side or "", other.name, better, worse, even, *medians_of, successes, p)


def side_of(row: Scored) -> str:
    """Return the side that a case is of, as its name says after its specimen's; "" where the task has one case."""
    return row.case.removeprefix(row.specimen).lstrip("/-").partition("/")[0]


def read_boards(folder: Path, receipts: Path | None = None) -> list[TaskBoard]:
    """Return a board for each task and set that the submissions in ``folder`` are of, and what ``receipts`` say.

    Raises :class:`EndoctError` where there is none, one was changed or cannot be believed, there are too many methods,
    or two were run on different recordings.
    """
    files = sorted(folder.glob("*.json"))
    if not files or len(files) > MOST_FILES:
        raise EndoctError(
            f"{folder} holds {'too many' if files else 'no'} submissions", expected=f"1 to {MOST_FILES} JSON files"
        )
    read = [(path.stem, read_submission(path)) for path in files]
    known = read_receipts(receipts)
    boards = []
    for board in dict.fromkeys(submission.board for _, submission in read):
        same = [(name, submission) for name, submission in read if submission.board == board]
        _check_alike(same)
        name, half, size, task_name = board
        definition = load_definition(name)
        if task_name not in definition.tasks:
            raise EndoctError(f"{name} has no task '{task_name}'", expected=" or ".join(definition.tasks))
        generators = {specimen.generator for specimen in same[0][1].specimens}
        all_planned = [
            specimen
            for specimen in planned(definition, half, size, definition.public_key)
            if specimen.kind.generator in generators and task_name in specimen.kind.tasks
        ]
        tested = [specimen for specimen in all_planned if specimen.split == "test"] or all_planned
        whole = [specimen.name for specimen in tested]
        for file, submission in same:
            check_credible(submission, file, whole)
        scored = definition.tasks[task_name]
        meaning = load_task(task_name).scores[scored.score]
        boards.append(TaskBoard(name, half, size, task_name, scored, meaning, tuple(_entrants(same, known))))
    return boards


def _check_alike(same: Sequence[tuple[str, Submission]]) -> None:
    first_name, first = same[0]
    cases = {(row.specimen, row.case) for row in first.rows}
    for name, other in same[1:]:
        pairs = zip(first.specimens, other.specimens, strict=False)
        alike = len(first.specimens) == len(other.specimens) and all(mine.is_alike(theirs) for mine, theirs in pairs)
        if not alike or {(row.specimen, row.case) for row in other.rows} != cases:
            raise EndoctError(
                f"the submissions {first_name} and {name} were run on different recordings",
                found=f"{len(first.specimens)} and {len(other.specimens)} specimens of {first.set}",
                remedy="submit both on one set, or keep them in two folders",
            )


def _entrants(same: Sequence[tuple[str, Submission]], known: Mapping[str, Sequence[Receipt]]) -> list[Entrant]:
    n_methods = sum(len(submission.methods) for _, submission in same)
    if n_methods > MOST_METHODS:
        raise EndoctError("a board has too many methods", found=f"{n_methods}", expected=f"{MOST_METHODS} at most")
    entrants: list[Entrant] = []
    receipts = {file: known.get(digest_of(submission), ()) for file, submission in same}
    for file, submission in sorted(same, key=lambda one: not receipts[one[0]]):  # a name is first of who was checked
        for name, origin in submission.methods.items():
            checks = [receipt for receipt in receipts[file] if name in receipt.verdicts]
            checked = len({specimen for check in checks for specimen in check.specimens})
            if any(check.verdicts[name] == "different" for check in checks):
                checked = -1
            taken = any(entrant.name == name for entrant in entrants)
            rows = tuple(row for row in submission.rows if row.method == name)
            entrants.append(Entrant(f"{name} ({file})" if taken else name, origin, file, submission, rows, checked))
    return entrants


def _standing(entrant: Entrant, rows: Sequence[Scored], score: str, sign: int) -> Standing:
    status = [row.status for row in rows]
    every = np.array([row.score_of(score) for row in rows])
    values = every[np.isfinite(every)]
    every = np.where(np.isfinite(every), every, sign * np.inf)
    low, high = _interval(every)
    return Standing(
        entrant,
        len(rows),
        status.count("ok"),
        status.count("declined"),
        status.count("failed"),
        share(sum(row.succeeds for row in rows), len(rows)),
        float(np.median(every)),
        low,
        high,
        float(values.mean()) if values.size else np.nan,
        float(np.median([row.seconds for row in rows])),
    )


def _interval(values: Coordinates) -> tuple[float, float]:
    """Return the 95 % interval of a median by order statistics; NaN where there are too few values for one."""
    if values.size < 2:
        return np.nan, np.nan
    interval = stats.quantile_test(values, p=0.5).confidence_interval(0.95)
    return float(interval.low), float(interval.high)
