"""The tables that a run prints."""

from dataclasses import replace
from pathlib import Path

from bench_tasks import DOUBLING, row
from rich.console import Console

from endoct.workbench.bench.results.result_tables import (
    difference_table,
    footnotes,
    table,
    write_csv,
)
from endoct.workbench.bench.results.score_summary import Difference, Spread


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


def test_rows_become_lines_with_gaps_where_there_is_nothing(tmp_path: Path) -> None:
    rows = [
        replace(row("right", "1-0", "ok", other=0.1234567891, error=2.0), conditions={"size": 0.5, "kind": "odd"}),
        replace(row("wrong", "1-0", "declined", success=0.0), conditions={"size": 1 / 3}, reason="too hard, \udce9"),
    ]
    write_csv(rows, DOUBLING, tmp_path / "results.csv")
    assert (tmp_path / "results.csv").read_bytes().decode().split("\r\n") == [
        "task,case,method,status,reason,seconds,cpu_seconds,condition.size,condition.kind,score.success,score.error,score.other",
        "doubling,1-0,right,ok,,1,1,0.5,odd,,2,0.123456789",
        r'doubling,1-0,wrong,declined,"too hard, \udce9",1,1,0.333333333,,0,,',
        "",
    ]


def test_differences_of_the_first_scores_are_a_line_a_method() -> None:
    of = {"a": (0.5, -1.0, 2.0), "b": (-0.25, -0.5, -0.125), "lost": None}
    differing = [
        Difference(method, score, Spread(9, *values), lower=2, higher=6)
        for score in ("one", "two", "three", "four")
        for method, values in of.items()
        if values
    ]
    differing.append(Difference("lost", "two", Spread(9, 1.0, 1.0, 1.0), lower=0, higher=9))
    found = difference_table(differing, "endoct")
    assert [column.header for column in found.columns] == ["less endoct", "one", "two", "three", "higher/lower/cases"]
    cells = [list(column.cells) for column in found.columns]
    assert cells[0] == ["a", "b", "lost"]
    assert cells[-1] == ["6/2/9", "6/2/9", "–"]
    assert cells[1][2] == "–"
    assert cells[2][2] == "+1 (+1 to +1)"
    assert cells[1][:2] == cells[2][:2] == cells[3][:2]


def test_reasons_beyond_the_first_are_counted() -> None:
    rows = [replace(row("a", str(k), "failed"), reason=f"reason {k}") for k in range(5)]
    assert footnotes(rows, DOUBLING)[-4:] == [
        *(f"a: failed: reason {k}" for k in range(3)),
        "a: and 2 other reasons, see results.csv",
    ]
    assert footnotes(rows[:3], DOUBLING)[-1] == "a: failed: reason 2"


def test_medians_and_shares_in_words() -> None:
    rows = [row("a", str(k), "ok", success=float(k > 0), error=float(k - 1)) for k in range(4)]
    found = table(rows, DOUBLING)
    assert [column.header for column in found.columns][3:] == ["ok", "declined", "failed", "s"]
    assert [cell for column in found.columns for cell in column.cells] == [
        "a", "3/4 (30%–95%)", "0.5 (-0.25 to 1.25)", "4", "0", "0", "1",
    ]  # fmt: skip
    assert list(table([row("a", "1", "ok", error=2.0)], DOUBLING).columns[1].cells) == ["2 (2–2)"]
