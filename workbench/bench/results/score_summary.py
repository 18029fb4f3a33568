"""The results of every method over all its cases, and how methods differ from one of them.

Those are taken case by case, so that how hard a case is cancels.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from endoct.workbench.bench.runner import MethodResult
from endoct.workbench.bench.task import SUCCESS


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

    ``scores`` are over the cases that have the score, ``success`` is over all cases, declined and failed ones included,
    or None where the task does not judge success.
    """

    method: str
    cases: int
    ok: int
    declined: int
    failed: int
    success: Share | None
    scores: dict[str, Spread]
    seconds: Spread
    reasons: tuple[str, ...]


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


def by_method(rows: Sequence[MethodResult]) -> dict[str, list[MethodResult]]:
    """Return the rows of each method, in the order in which they were run."""
    return {method: [row for row in rows if row.method == method] for method in dict.fromkeys(r.method for r in rows)}


def score_names(rows: Sequence[MethodResult], listed: Sequence[str]) -> list[str]:
    """Return the names of the scores that rows have, ``listed`` first, ``success`` left out."""
    present = dict.fromkeys(name for row in rows for name in row.scores if name != SUCCESS)
    return [name for name in listed if name in present] + [name for name in present if name not in listed]


def values_of(rows: Sequence[MethodResult], score: str) -> list[float]:
    """Return a score of the rows that have it."""
    return [row.scores[score] for row in rows if score in row.scores]


def count_true(rows: Sequence[MethodResult], score: str) -> int:
    """Return in how many rows a score that stands for yes or no says yes."""
    return sum(value > 0.5 for value in values_of(rows, score))


def spread(values: Iterable[float]) -> Spread:
    """Return median and quartiles of at least one value."""
    array = np.fromiter(values, np.float64)
    low, median, high = np.percentile(array, [25, 50, 75])
    return Spread(array.size, float(median), float(low), float(high))


def share(k: int, n: int) -> Share:
    """Return ``k`` of ``n`` > 0 with its interval."""
    interval = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    return Share(k, n, float(interval.low), float(interval.high))


def summarise(rows: Sequence[MethodResult], listed: Sequence[str] = ()) -> list[Summary]:
    """Return a summary for every method of ``rows``, in the order in which they were run; ``listed`` scores first."""
    names, judged = score_names(rows, listed), any(SUCCESS in row.scores for row in rows)
    return [_summary(method, own, names, judged=judged) for method, own in by_method(rows).items()]


def _summary(method: str, own: Sequence[MethodResult], names: Sequence[str], *, judged: bool) -> Summary:
    status = [row.status for row in own]
    values = {name: values_of(own, name) for name in names}
    return Summary(
        method=method,
        cases=len(own),
        ok=status.count("ok"),
        declined=status.count("declined"),
        failed=status.count("failed"),
        success=share(count_true(own, SUCCESS), len(own)) if judged else None,
        scores={name: spread(scores) for name, scores in values.items() if scores},
        seconds=spread(row.seconds for row in own),
        reasons=tuple(dict.fromkeys(f"{row.status}: {row.reason}" for row in own if row.reason)),
    )


def differences(rows: Sequence[MethodResult], reference: str, scores: Sequence[str]) -> list[Difference]:
    """Return every method's differences from ``reference``, those of the first score first.

    So a method that has no first score, since it was never aligned, changes nothing in the order of the scores.
    """
    of_reference = {row.case: row.scores for row in rows if row.method == reference}
    others = {method: own for method, own in by_method(rows).items() if method != reference}
    differing = []
    for score in scores:
        for method, own in others.items():
            both = [(row.scores, of_reference.get(row.case, {})) for row in own]
            values = [theirs[score] - base[score] for theirs, base in both if score in theirs and score in base]
            if values:
                lower, higher = sum(value < 0 for value in values), sum(value > 0 for value in values)
                differing.append(Difference(method, score, spread(values), lower, higher))
    return differing
