"""What many rows come to, by method."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.task import DOUBTED, SUCCESS


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of the ``n`` values there are."""

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
    """What a method made of all cases.

    ``scores`` are over the cases that have the score: those it answered, and of declined comparisons what each side
    scores by itself. Of those it answered it called ``doubted`` doubtful itself. ``success`` is over all cases,
    declined and failed ones included, or None where the task does not judge success.
    """

    method: str
    cases: int
    ok: int
    doubted: int
    declined: int
    failed: int
    success: Share | None
    scores: dict[str, Spread]
    seconds: Spread
    reasons: tuple[str, ...]


def spread(values: Sequence[float]) -> Spread:
    """Return median and quartiles of at least one value."""
    low, median, high = np.percentile(values, [25, 50, 75])
    return Spread(len(values), float(median), float(low), float(high))


def share(k: int, n: int) -> Share:
    """Return ``k`` of ``n`` > 0 with its interval."""
    interval = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    return Share(k, n, float(interval.low), float(interval.high))


def score_names(rows: Sequence[Row], listed: Sequence[str]) -> list[str]:
    """Return the names of the scores that rows have, ``listed`` first, ``success`` and ``doubted`` left out."""
    present = dict.fromkeys(name for row in rows for name in row.scores if name not in (SUCCESS, DOUBTED))
    return [name for name in listed if name in present] + [name for name in present if name not in listed]


def summarise(rows: Sequence[Row], listed: Sequence[str] = ()) -> list[Summary]:
    """Return a summary for every method of ``rows``, in the order in which they were run."""
    judges_success = any(SUCCESS in row.scores for row in rows)
    summaries = []
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method]
        count = {status: sum(row.status == status for row in own) for status in ("ok", "declined", "failed")}
        succeeded = sum(row.scores.get(SUCCESS, 0.0) > 0.5 for row in own)
        values = {name: [row.scores[name] for row in own if name in row.scores] for name in score_names(rows, listed)}
        summaries.append(
            Summary(
                method,
                len(own),
                count["ok"],
                sum(row.scores.get(DOUBTED, 0.0) > 0.5 for row in own),
                count["declined"],
                count["failed"],
                share(succeeded, len(own)) if judges_success else None,
                {name: spread(found) for name, found in values.items() if found},
                spread([row.seconds for row in own]),
                tuple(dict.fromkeys(f"{row.status}: {row.reason}" for row in own if row.reason)),
            )
        )
    return summaries
