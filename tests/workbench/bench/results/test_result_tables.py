"""The tables that a run prints."""

from dataclasses import replace
from pathlib import Path

from bench_tasks import DOUBLING, row
from rich.console import Console

from endoct.workbench.bench.results.result_tables import footnotes, table, write_csv, write_differences
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


def test_differences_become_lines(tmp_path: Path) -> None:
    write_differences([Difference("a", "error", Spread(3, -1.0, -2.0, 1 / 3), 2, 1)], "b", tmp_path / "d.csv")
    assert (tmp_path / "d.csv").read_text(encoding="utf-8").splitlines() == [
        "method,against,score,cases,median,quartile_1,quartile_3,lower,higher",
        "a,b,error,3,-1,-2,0.333333,2,1",
    ]
