"""A run of the bench that was stopped goes on where it was, and comes to what one that was not comes to."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from bench_tasks import DOUBLING, install

from endoct.base.errors import EndoctError
from endoct.workbench.bench import checkpoint
from endoct.workbench.bench.checkpoint import Facts, machine, plan_facts
from endoct.workbench.bench.command import run_bench
from endoct.workbench.bench.runner import BenchPlan
from endoct.workbench.bench.task import AnyTask, Case, Range, Task, draw, load_task


class Squaring:
    """A task that counts its cases, and is interrupted, as by Ctrl-C, before one of them."""

    def __init__(self) -> None:
        self.made: list[str] = []
        self.stops_before: str | None = None
        methods = {"right": lambda number: number**2, "wrong": lambda number: number}
        ranges: dict[str, Range] = {"size": (0.0, 1.0)}
        scores = {"error": "error, 1"}
        self.task = Task("squaring", "", self.cases, self.judge, ranges=ranges, scores=scores, methods=methods)

    def cases(self, seed: int, index: int, ranges: Mapping[str, Range]) -> Case[float, float]:
        name = f"{seed}-{index}"
        if name == self.stops_before:
            raise KeyboardInterrupt
        self.made.append(name)
        drawn = draw(seed, index, ranges)
        return Case(name, float(drawn["size"]), float(drawn["size"]) ** 2, drawn)

    def judge(self, case: Case[float, float], answer: float) -> dict[str, float]:
        return {"error": abs(answer - case.truth), "exact": 1 / 3}


@pytest.fixture
def squaring(monkeypatch: pytest.MonkeyPatch) -> Squaring:
    """The task, installed."""
    made = Squaring()
    install(monkeypatch, made.task)
    return made


def bench(output: Path, seeds: str = "3-6", conditions: Sequence[str] = (), *, overwrite: bool = False) -> Facts:
    return run_bench("squaring", conditions, seeds=seeds, output=output, overwrite=overwrite, progress=False)[0]


def rows_of(output: Path) -> list[dict[str, str]]:
    with (output / "results.csv").open(encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if "seconds" not in k} for row in csv.DictReader(file)]


def stopped(squaring: Squaring, output: Path) -> Path:
    squaring.stops_before = "5-0"
    with pytest.raises(KeyboardInterrupt, match="2 of 4 cases are kept"):
        bench(output)
    squaring.stops_before = None
    squaring.made.clear()
    return output.with_name("out.unfinished")


def test_what_is_done_is_kept_and_not_done_again(squaring: Squaring, tmp_path: Path) -> None:
    bench(tmp_path / "whole")
    unfinished = stopped(squaring, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert sorted(path.name for path in unfinished.iterdir()) == ["000000.json", "000001.json", "lock", "run.json"]
    told = bench(tmp_path / "out")
    assert squaring.made == ["5-0", "6-0"]
    assert told["taken_over"] == 2
    assert rows_of(tmp_path / "out") == rows_of(tmp_path / "whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "whole"]


def test_another_run_does_not_take_it_over(squaring: Squaring, tmp_path: Path) -> None:
    unfinished = stopped(squaring, tmp_path / "out")
    with pytest.raises(EndoctError, match="another seeds"):
        bench(tmp_path / "out", seeds="3-7")
    with pytest.raises(EndoctError, match="another conditions"):
        bench(tmp_path / "out", conditions=["size=0.5"])
    assert len(list(unfinished.iterdir())) == 4
    told = bench(tmp_path / "out", seeds="3-7", overwrite=True)
    assert "taken_over" not in told
    assert len(squaring.made) == 5


def test_a_run_that_goes_on_is_neither_joined_nor_replaced(
    squaring: Squaring, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = []

    def judge_and_rerun(case: Case[float, float], answer: float) -> dict[str, float]:
        for seeds, overwrite in (("3-6", False), ("3-7", True)):
            with pytest.raises(EndoctError, match=r"another run uses .*out\.unfinished"):
                bench(tmp_path / "out", seeds, overwrite=overwrite)
            refused.append(case.name)
        return squaring.judge(case, answer)

    install(monkeypatch, replace(squaring.task, judge=judge_and_rerun))
    bench(tmp_path / "out")
    assert refused == [name for name in squaring.made for _ in range(4)]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_other_code_does_not_take_it_over(squaring: Squaring, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stopped(squaring, tmp_path / "out")
    monkeypatch.setattr(checkpoint, "_digest", lambda files: f"{len(files)} other files")
    with pytest.raises(EndoctError, match="another source"):
        bench(tmp_path / "out")


def test_others_methods_count_by_their_modules() -> None:
    task = replace(load_task("segmentation"), methods={})
    plan = BenchPlan("segmentation", ("endoct", "otsu"), (1,), 1, task.ranges)
    assert json.dumps(plan_facts(plan))
    assert set(checkpoint.source_digests(plan)) == {"endoct"}
    assert checkpoint._files("csv") == [Path(csv.__file__)]
    assert checkpoint._files("no_such_module_anywhere.at_all") == []


def test_facts_can_be_written_as_json(doubling: AnyTask) -> None:
    facts = plan_facts(BenchPlan("doubling", ("right",), (3,), 1, DOUBLING.ranges))
    assert json.loads(json.dumps(facts)) == facts
    assert facts["conditions"] == {"size": [0.0, 1.0], "kind": ["plain", "odd"]}
    assert {"processor", "cores", "cores_usable", "system"} <= set(json.loads(json.dumps(machine())))
