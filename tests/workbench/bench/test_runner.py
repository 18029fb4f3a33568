"""The bench: the same cases for all, and nothing that a method does stops a run."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
from bench_tasks import DOUBLING, doubling_case

from endoct.base.errors import EndoctError
from endoct.workbench.bench.runner import BenchPlan, MethodResult, narrowed, parse_seeds, run, run_method
from endoct.workbench.bench.task import AnyTask, Range


def test_whatever_a_method_does_is_its_result(doubling: AnyTask) -> None:
    case = doubling_case(3, 0, {"size": (0.6, 0.6)})
    rows = {name: run_method(doubling, name, case) for name in doubling.methods}
    assert {name: row.status for name, row in rows.items()} == {
        "right": "ok",
        "wrong": "ok",
        "raises": "failed",
        "absent": "missing",
        "text": "failed",
        "ignorant": "declined",
    }
    assert rows["right"].scores == {"error": 0.0, "success": 1.0}  # a score that is not a number is left out
    assert "ZeroDivisionError" in rows["raises"].reason
    assert rows["absent"].reason == "a_library_that_is_not_installed is not installed"
    assert "useless" in rows["text"].reason
    assert rows["ignorant"].reason == "too hard"


def test_methods_share_their_cases_and_cases_depend_on_nothing_else(doubling: AnyTask) -> None:
    plan = BenchPlan("doubling", ("right", "wrong"), (3, 4), 2, doubling.ranges)
    rows = run(plan, workers=1, advance=lambda _: None)
    assert [row.case for row in rows] == [name for name in ("3-0", "3-1", "4-0", "4-1") for _ in range(2)]
    other = run(replace(plan, methods=("wrong",), seeds=(4, 3), count=1), workers=1, advance=lambda _: None)
    conditions = {row.case: row.conditions for row in rows}
    assert sorted(row.case for row in other) == ["3-0", "4-0"]
    assert all(conditions[row.case] == row.conditions for row in other)


@pytest.mark.slow
def test_processes_get_the_same_cases_and_scores() -> None:
    ranges: dict[str, Range] = {"recipe": ("made",), "modality": ("depth",), "missing": (0.1, 0.3)}
    ranges |= {"signal_db": (10.0, 20.0), "cell_mm": (0.5, 1.0), "fill": (0.2, 0.2), "unevenness": (0.5, 0.5)}
    plan = BenchPlan("segmentation", ("li-depth", "k-means"), (1, 2), 1, ranges)
    alone, together = (run(plan, workers=workers, advance=lambda _: None) for workers in (1, 2))
    kept: dict[int, Sequence[MethodResult]] = {}
    goes_on = run(plan, workers=2, advance=lambda _: None, finished={0: alone[:2]}, keep=kept.__setitem__)
    assert kept == {1: goes_on[2:]}
    timeless = [[replace(row, seconds=0.0, cpu_seconds=0.0) for row in rows] for rows in (alone, together, goes_on)]
    assert timeless[0] == timeless[1] == timeless[2]


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
    ],
)
def test_what_cannot_be_drawn_is_refused(ask: Callable[[], object], match: str) -> None:
    with pytest.raises(EndoctError, match=match):
        ask()


def test_seeds_are_read() -> None:
    assert parse_seeds("3-5,9,4") == (3, 4, 5, 9)


def test_a_sweep_holds_the_other_conditions(doubling: AnyTask) -> None:
    assert narrowed(doubling, ["kind=odd"], "size") == {"size": (0.0, 1.0), "kind": ("odd",)}
    assert narrowed(doubling, [], "kind") == {"size": (0.5, 0.5), "kind": ("plain", "odd")}
    usual = replace(doubling, ranges={**doubling.ranges, "kind": ("plain",)}, optional={"kind": ("plain", "odd")})
    assert narrowed(usual, ["size=0.1..0.2"])["kind"] == ("plain",)
    assert narrowed(usual, ["kind=odd"])["kind"] == ("odd",)
