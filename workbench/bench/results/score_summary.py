"""The results of every method over all its cases, from the rows of a run as a table.

Methods are held against one of them case by case: the same cases, so that their difficulty cancels.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from endoct.workbench.bench.runner import MethodResult
from endoct.workbench.bench.task import DOUBTED, SUCCESS

CONDITION, SCORE = "condition.", "score."
"""The names of columns of conditions and scores begin with these."""
TIMES = ["seconds", "cpu_seconds"]
COLUMNS = ["case", "method", "status", "reason", *TIMES]


def frame_of(rows: Sequence[MethodResult]) -> pd.DataFrame:
    """Return a line a row: :data:`COLUMNS`, ``condition.NAME`` and ``score.NAME``, None or NaN where there is none.

    Names and words stay Python objects: they may come from anybody's method or folder, and be no valid Unicode.
    """
    lines = [_line(row) for row in rows]
    names = list(dict.fromkeys([*COLUMNS, *(name for line in lines for name in line)]))
    values = [[line.get(name) for name in names] for line in lines]
    frame = pd.DataFrame(values, columns=pd.Index(names, dtype=object), dtype=object)
    numbers = [*TIMES, *(name for name in names if name.startswith(SCORE))]
    return frame.astype(dict.fromkeys(numbers, float))


def by_method(frame: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the lines of each method, in the order in which they were run.

    pandas would group by an index, of Arrow's texts where pyarrow is installed, which refuse what is no valid Unicode.
    """
    for method in dict.fromkeys(frame["method"]):
        yield str(method), frame[[name == method for name in frame["method"]]]


def columns_of(frame: pd.DataFrame, beginning: str) -> list[str]:
    """Return the names of the columns that begin with :data:`CONDITION` or :data:`SCORE`, in order."""
    return [name for name in map(str, frame.columns) if name.startswith(beginning)]


def score_names(rows: Sequence[MethodResult], listed: Sequence[str]) -> list[str]:
    """Return the names of the scores that rows have, ``listed`` first, ``success`` and ``doubted`` left out."""
    present = dict.fromkeys(name for row in rows for name in row.scores if name not in (SUCCESS, DOUBTED))
    return [name for name in listed if name in present] + [name for name in present if name not in listed]


def _line(row: MethodResult) -> dict[str, float | str]:
    return {
        **{name: getattr(row, name) for name in COLUMNS},
        **{f"{CONDITION}{name}": value for name, value in row.conditions.items()},
        **{f"{SCORE}{name}": value for name, value in row.scores.items()},
    }


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of ``n`` values."""

    n: int
    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Share:
    """``k`` of ``n``, with Wilson's 95 % interval (Wilson 1927) of the share."""

    k: int
    n: int
    low: float
    high: float


@dataclass(frozen=True)
class Summary:
    """The results of one method over all cases.

    ``scores`` are over the cases that have the score: those it answered, and of declined comparisons what each side
    scores by itself. Of the cases it answered it called ``doubted`` doubtful itself. ``success`` is over all cases,
    declined and failed ones included, or None where the task does not judge success. ``word`` is the one that these
    cases have in common, where the task is summarised by a condition's words.
    """

    method: str
    word: str | None
    cases: int
    ok: int
    doubted: int
    declined: int
    failed: int
    success: Share | None
    scores: dict[str, Spread]
    seconds: Spread
    reasons: tuple[str, ...]


def spread(values: Iterable[float]) -> Spread:
    """Return median and quartiles of at least one value."""
    array = np.fromiter(values, np.float64)
    low, median, high = np.percentile(array, [25, 50, 75])
    return Spread(array.size, float(median), float(low), float(high))


def share(k: int, n: int) -> Share:
    """Return ``k`` of ``n`` > 0 with its interval."""
    interval = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    return Share(k, n, float(interval.low), float(interval.high))


def summarise(rows: Sequence[MethodResult], listed: Sequence[str] = (), by: str | None = None) -> list[Summary]:
    """Return a summary for every method of ``rows``, in the order in which they were run.

    With ``by``, for every word of that condition and method, words in the order of the alphabet.
    """
    names = score_names(rows, listed)
    return [
        _summary(method, word, own, names)
        for word, some in by_word(rows, by)
        for method, own in by_method(frame_of(some))
    ]


def by_word(rows: Sequence[MethodResult], by: str | None) -> list[tuple[str | None, list[MethodResult]]]:
    """Return the rows of every word of the condition ``by``; without one, all rows and None."""
    if by is None:
        return [(None, list(rows))]
    words = sorted({str(row.conditions[by]) for row in rows})
    return [(word, [row for row in rows if row.conditions[by] == word]) for word in words]


def _summary(method: str, word: str | None, own: pd.DataFrame, names: Sequence[str]) -> Summary:
    status = own["status"].value_counts()
    values = {name: own[f"{SCORE}{name}"].dropna() for name in names if f"{SCORE}{name}" in own}
    reasons = own.loc[own["reason"] != "", ["status", "reason"]].drop_duplicates()
    return Summary(
        method=method,
        word=word,
        cases=len(own),
        ok=int(status.get("ok", 0)),
        doubted=count_true(own, DOUBTED),
        declined=int(status.get("declined", 0)),
        failed=int(status.get("failed", 0)),
        success=share(count_true(own, SUCCESS), len(own)) if f"{SCORE}{SUCCESS}" in own else None,
        scores={name: spread(column) for name, column in values.items() if len(column)},
        seconds=spread(own["seconds"]),
        reasons=tuple(f"{line.status}: {line.reason}" for line in reasons.itertuples()),
    )


def count_true(frame: pd.DataFrame, score: str) -> int:
    """Return in how many lines a score that stands for yes or no says yes."""
    return int((frame[f"{SCORE}{score}"] > 0.5).sum()) if f"{SCORE}{score}" in frame else 0


@dataclass(frozen=True)
class Difference:
    """A score of a method minus that of the reference, over the cases that have both.

    ``lower`` and ``higher`` count the cases in which it is negative and positive.
    """

    method: str
    score: str
    spread: Spread
    lower: int
    higher: int


def differences(rows: Sequence[MethodResult], reference: str, scores: Sequence[str]) -> list[Difference]:
    """Return every method's differences from ``reference``, those of the first score first.

    So a method that has no first score, since it was never aligned, changes nothing in the order of the scores.
    """
    frame = frame_of(rows)
    is_reference = frame["method"] == reference
    base, others = frame[is_reference], frame[~is_reference]
    differing, of_methods = [], list(by_method(others))
    for column in (f"{SCORE}{score}" for score in scores):
        of_reference = dict(zip(base["case"], base[column], strict=True))
        for method, own in of_methods:
            values = (own[column] - [of_reference.get(case, np.nan) for case in own["case"]]).dropna()
            if values.empty:
                continue
            lower, higher = int((values < 0).sum()), int((values > 0).sum())
            differing.append(Difference(method, column.removeprefix(SCORE), spread(values), lower, higher))
    return differing
