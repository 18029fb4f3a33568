"""What many rows come to, by method."""

import pytest
from bench_tasks import row

from endoct.workbench.bench.results.score_summary import differences, share, spread, summarise


def test_success_counts_cases_that_were_not_answered() -> None:
    rows = [row("a", "1", "ok", success=1.0, error=0.1), row("a", "2", "declined"), row("a", "3", "failed")]
    (summary,) = summarise(rows)
    assert summary.success is not None
    assert (summary.success.k, summary.success.n, summary.scores["error"].n) == (1, 3, 1)
    assert (summary.ok, summary.declined, summary.failed) == (1, 1, 1)


def test_shares_and_spreads_are_the_textbook_s() -> None:
    found = share(8, 10)
    assert (found.low, found.high) == pytest.approx((0.4902, 0.9433), abs=5e-4)  # Wilson 1927
    assert share(10, 10).high == 1.0
    assert (spread([1, 2, 3, 4, 5]).low, spread([1, 2, 3, 4, 5]).median) == (2.0, 3.0)


def test_differences_are_taken_case_by_case() -> None:
    rows = [
        *(row("base", str(k), "ok", error=10.0 * k) for k in range(5)),
        *(row("other", str(k), "ok", error=10.0 * k + 1) for k in range(1, 5)),
        row("other", "9", "ok", error=-1000.0),
    ]
    (found,) = differences(rows, "base", ["error"])
    assert (found.spread.n, found.spread.median, found.higher, found.lower) == (4, 1.0, 4, 0)


def test_a_method_without_the_first_score_leaves_it_first() -> None:
    rows = [
        row("base", "1", "ok", first=1.0, second=1.0),
        row("lost", "1", "declined", second=0.5),
        row("other", "1", "ok", first=2.0, second=3.0),
    ]
    found = [(one.method, one.score, one.spread.median) for one in differences(rows, "base", ["first", "second"])]
    assert found == [("other", "first", 1.0), ("lost", "second", -0.5), ("other", "second", 2.0)]
