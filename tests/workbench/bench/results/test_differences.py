"""Differences of methods, case by case."""

from bench_tasks import row

from endoct.workbench.bench.results.summary import differences


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
