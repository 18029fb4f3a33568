"""A small task of the bench whose methods do all that methods may do, and rows of results."""

from collections.abc import Mapping
from importlib import import_module

import numpy as np
import pytest

from endoct.workbench.bench.runner import MethodResult, Status
from endoct.workbench.bench.task import AnyTask, Case, Declined, Range, Task, draw
from endoct.workbench.bench.tasks.alignment import RANGES

LOADERS = ("command", "runner", "results.result_tables")
"""Modules of the bench that load tasks by name."""

EASY: Mapping[str, Range] = {
    **RANGES,
    "theta_shift_rad": (0.02, 0.03),
    "overlap": (0.98, 1.0),
    "z_scale": (1.0, 1.0),
    "orientation": ("upright",),
    "polarity": ("dark",),
    "noise": ("low",),
    "cell_area": (0.2, 0.2),
}
"""Of the task "alignment": two panoramas that hardly lie apart."""


def install(monkeypatch: pytest.MonkeyPatch, task: AnyTask) -> None:
    """Make ``task`` what the bench loads, whatever name it is asked for."""
    for module in LOADERS:
        monkeypatch.setattr(f"endoct.workbench.bench.{module}.load_task", lambda name: task)


def row(method: str, case: str, status: Status, **scores: float) -> MethodResult:
    return MethodResult(case, method, status, "", 1.0, 1.0, {}, scores)


def doubling_case(seed: int, index: int, ranges: Mapping[str, Range]) -> Case[float, float]:
    drawn = draw(seed, index, ranges)
    return Case(f"{seed}-{index}", float(drawn["size"]), 2 * float(drawn["size"]), drawn)


def _judge(case: Case[float, float], answer: float) -> dict[str, float]:
    return {"error": abs(answer - case.truth), "success": float(abs(answer - case.truth) < 0.1), "unknown": np.nan}


def _right(number: float) -> float:
    return 2 * number


def _absent(number: float) -> float:
    return float(import_module("a_library_that_is_not_installed").double(number))


def _ignorant(number: float) -> float:
    raise Declined("too hard") if number > 0.5 else Declined("nothing to say", {"success": 1.0})


DOUBLING: AnyTask = Task(
    "doubling",
    "method(number: float) -> float",
    doubling_case,
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
