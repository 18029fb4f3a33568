"""The tables that a run prints."""

from bench_tasks import DOUBLING, row
from rich.console import Console

from endoct.workbench.bench.results.tables import footnotes, table


def test_a_line_a_method_with_counts_and_reasons() -> None:
    rows = [row("right", "1", "ok", success=1.0, error=0.5), row("wrong", "1", "declined", success=0.0)]
    console = Console(width=120)
    with console.capture() as printed:
        console.print(table(rows, DOUBLING))
    header, right, wrong = printed.get().splitlines()
    assert header.split() == ["method", "success", "(95", "%)", "error", "ok", "declined", "failed", "s"]
    assert right.split()[:2] == ["right", "1/1"]
    assert wrong.split()[-5:] == ["–", "0", "1", "0", "1"]
    assert "error: error, 1" in footnotes(rows, DOUBLING)
