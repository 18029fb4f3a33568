"""What many rows come to, by method."""

import pytest
from bench_tasks import row

from endoct.workbench.bench.results.summary import share, spread, summarise


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
