"""The bench: same cases for all, nothing a method does stops a run, and figures that say what they are."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.stitching.errors import EndoctError
from endoct.workbench.bench import command, runner
from endoct.workbench.bench.asking import narrowed, parse_seeds
from endoct.workbench.bench.methods import load_task
from endoct.workbench.bench.paired import differences
from endoct.workbench.bench.runner import Plan, Row, run, run_method
from endoct.workbench.bench.summary import share, spread, summarise
from endoct.workbench.bench.task import Case, Declined, Range, Task, draw
from endoct.workbench.cli import main
from endoct.workbench.running.progress import SilentStages


def _right(number: float) -> float:
    return 2 * number


def _absent(number: float) -> float:
    import a_library_that_is_not_installed  # type: ignore[import-not-found]

    return float(a_library_that_is_not_installed.double(number))


def _ignorant(number: float) -> float:
    raise Declined("too hard") if number > 0.5 else Declined("nothing to say", {"success": 1.0})


def _cases(seed: int, index: int, ranges: Mapping[str, Range]) -> Case:
    drawn = draw(seed, index, ranges)
    return Case(f"{seed}-{index}", float(drawn["size"]), 2 * float(drawn["size"]), drawn)


def _judge(case: Case, answer: Any) -> dict[str, float]:
    return {"error": abs(answer - case.truth), "success": float(abs(answer - case.truth) < 0.1), "unknown": np.nan}


DOUBLING = Task(
    "doubling",
    "method(number: float) -> float",
    _cases,
    _judge,
    ranges={"size": (0.0, 1.0), "kind": ("plain", "odd")},
    scores={"error": "error, 1"},
    methods={
        "right": _right,
        "wrong": lambda number: number + 0.3,
        "raises": lambda number: 1 / 0,
        "absent": _absent,
        "text": lambda number: "two",
        "ignorant": _ignorant,
    },
)


@pytest.fixture
def doubling(monkeypatch: pytest.MonkeyPatch) -> Task:
    """The task, installed."""
    for module in (runner, command):
        monkeypatch.setattr(module, "load_task", lambda name: DOUBLING)
    for name in ("writing", "keeping"):
        monkeypatch.setattr(f"endoct.workbench.bench.{name}.load_task", lambda name: DOUBLING)
    return DOUBLING


def bench(**options: Any) -> tuple[dict[str, Any], list[Any]]:
    return command.run_bench("doubling", stages=SilentStages(), **{"seeds": "3-6", "count": 2, **options})


def test_whatever_a_method_does_is_its_result(doubling: Task) -> None:
    case = _cases(3, 0, {"size": (0.6, 0.6)})
    rows = {name: run_method(doubling, name, case) for name in doubling.methods}
    assert {name: row.status for name, row in rows.items()} == {
        "right": "ok",
        "wrong": "ok",
        "raises": "failed",
        "absent": "failed",
        "text": "failed",
        "ignorant": "declined",
    }
    assert rows["right"].scores == {"error": 0.0, "success": 1.0}  # a score that is not a number is left out
    assert "ZeroDivisionError" in rows["raises"].reason
    assert "a_library_that_is_not_installed" in rows["absent"].reason
    assert "useless" in rows["text"].reason
    assert rows["ignorant"].reason == "too hard"


def test_results_are_written_and_told(doubling: Task, tmp_path: Path) -> None:
    told, _ = bench(output=tmp_path / "out", against="wrong")
    with (tmp_path / "out" / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 2 * len(doubling.methods)
    for row in rows:
        if row["method"] == "right":
            assert float(row["score.error"]) == 0.0
            assert row["condition.kind"] in ("plain", "odd")
        if row["status"] != "ok":
            assert row["score.error"] == ""
    stored = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))
    assert stored == json.loads(json.dumps(told))
    assert stored["seeds"] == [3, 4, 5, 6]
    assert {"machine", "versions", "methods", "summary", "conditions"} <= set(stored)
    plots = {path.name for path in (tmp_path / "out" / "plots").iterdir()}
    assert plots == {"overview.png", "against-size.png", "against-kind.png", "differences.png"}
    with (tmp_path / "out" / "differences.csv").open(encoding="utf-8") as file:
        (difference,) = csv.DictReader(file)
    assert (difference["method"], difference["against"], difference["cases"]) == ("right", "wrong", "8")


def test_methods_share_their_cases_and_cases_depend_on_nothing_else(doubling: Task) -> None:
    plan = Plan("doubling", ("right", "wrong"), (3, 4), 2, doubling.ranges)
    rows = run(plan, workers=1, advance=lambda _: None)
    assert [row.case for row in rows] == [name for name in ("3-0", "3-1", "4-0", "4-1") for _ in range(2)]
    other = run(replace(plan, methods=("wrong",), seeds=(4, 3), count=1), workers=1, advance=lambda _: None)
    conditions = {row.case: row.conditions for row in rows}
    assert all(conditions[row.case] == row.conditions for row in other)


@pytest.mark.slow
def test_processes_get_the_same_cases_and_scores() -> None:
    ranges: dict[str, Range] = {"recipe": ("made",), "modality": ("depth",), "missing": (0.1, 0.3)}
    ranges |= {"signal_db": (10.0, 20.0), "cell_mm": (0.5, 1.0), "fill": (0.2, 0.2), "unevenness": (0.5, 0.5)}
    plan = Plan("segmentation", ("li-depth", "k-means"), (1, 2), 1, ranges)
    alone, together = (run(plan, workers=workers, advance=lambda _: None) for workers in (1, 2))
    kept: dict[int, Sequence[Row]] = {}
    goes_on = run(plan, workers=2, advance=lambda _: None, finished={0: alone[:2]}, keep=kept.__setitem__)
    assert kept == {1: goes_on[2:]}
    timeless = [[replace(row, seconds=0.0, cpu_seconds=0.0) for row in rows] for rows in (alone, together, goes_on)]
    assert timeless[0] == timeless[1] == timeless[2]


@given(seed=st.integers(0, 10**6), index=st.integers(0, 1000), low=st.floats(-5, 5), width=st.floats(0, 5))
def test_narrowing_one_condition_leaves_the_others(seed: int, index: int, low: float, width: float) -> None:
    ranges: dict[str, Range] = {"a": (0.0, 1.0), "b": (low, low + width), "c": ("x", "y", "z")}
    drawn = draw(seed, index, ranges)
    assert low <= float(drawn["b"]) <= low + width
    narrow = draw(seed, index, {"c": ("x", "y", "z"), "a": (0.0, 1.0), "b": (low, low)})
    assert (narrow["a"], narrow["c"]) == (drawn["a"], drawn["c"])
    assert narrow["b"] == pytest.approx(low)


def test_a_sweep_holds_the_other_conditions(doubling: Task) -> None:
    assert narrowed(doubling, ["kind=odd"], "size") == {"size": (0.0, 1.0), "kind": ("odd",)}
    assert narrowed(doubling, [], "kind") == {"size": (0.5, 0.5), "kind": ("plain", "odd")}
    usual = replace(doubling, usual={"kind": ("plain",)})
    assert narrowed(usual, ["size=0.1..0.2"])["kind"] == ("plain",)
    assert narrowed(usual, ["kind=odd"])["kind"] == ("odd",)


@pytest.mark.parametrize(
    ("ask", "match"),
    [
        (lambda: narrowed(DOUBLING, ["sise=1"]), "size"),
        (lambda: narrowed(DOUBLING, ["size=2..1"]), "low first"),
        (lambda: narrowed(DOUBLING, ["size=big"]), "low..high"),
        (lambda: narrowed(DOUBLING, ["kind=even"]), "plain or odd"),
        (lambda: narrowed(DOUBLING, ["size=1", "size=2"]), "twice"),
        (lambda: narrowed(DOUBLING, [], "colour"), "no condition"),
        (lambda: parse_seeds("9-3"), "first-last"),
        (lambda: parse_seeds("a"), "first-last"),
        (lambda: bench(methods=["rigt"]), "'right'"),
        (lambda: bench(methods=["right", "right"]), "twice"),
        (lambda: bench(against="best"), "unknown method"),
        (lambda: bench(count=0), "at least 1"),
    ],
)
def test_what_cannot_be_is_told(ask: Callable[[], Any], match: str, doubling: Task) -> None:
    with pytest.raises(EndoctError, match=match):
        ask()


def test_a_task_that_is_not_known_is_told_with_the_nearest() -> None:
    with pytest.raises(EndoctError, match="'segmentation'"):
        load_task("segmentatoin")


def test_seeds_are_read() -> None:
    assert parse_seeds("3-5,9,4") == (3, 4, 5, 9)


def _row(method: str, case: str, status: Any, **scores: float) -> Row:
    return Row(case, method, status, "", 1.0, 1.0, {}, scores)


def test_success_counts_cases_that_were_not_answered() -> None:
    rows = [_row("a", "1", "ok", success=1.0, error=0.1), _row("a", "2", "declined"), _row("a", "3", "failed")]
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
        *(_row("base", str(k), "ok", error=10.0 * k) for k in range(5)),
        *(_row("other", str(k), "ok", error=10.0 * k + 1) for k in range(1, 5)),
        _row("other", "9", "ok", error=-1000.0),
    ]
    (found,) = differences(rows, "base", ["error"])
    assert (found.spread.n, found.spread.median, found.higher, found.lower) == (4, 1.0, 4, 0)


def test_a_method_without_the_first_score_leaves_it_first() -> None:
    rows = [
        _row("base", "1", "ok", first=1.0, second=1.0),
        _row("lost", "1", "declined", second=0.5),
        _row("other", "1", "ok", first=2.0, second=3.0),
    ]
    found = [(one.method, one.score, one.spread.median) for one in differences(rows, "base", ["first", "second"])]
    assert found == [("other", "first", 1.0), ("lost", "second", -0.5), ("other", "second", 2.0)]


def test_the_command_line_lists_describes_and_refuses(capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    def said(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["endoct", "bench", *arguments])
        with pytest.raises(SystemExit) as leave:
            main()
        streams = capsys.readouterr()
        return int(leave.value.code or 0), streams.out + streams.err

    status, text = said("--json")
    assert status == 0
    assert {"segmentation", "ablate", "sensitivity"} <= set(json.loads(text))
    status, text = said("segmentation", "--describe")
    assert status == 0
    assert "signal_db" in text
    assert "otsu" in text
    status, text = said("segmentation", "--methods", "otsuu")
    assert status == 1
    assert "'otsu'" in text
