"""Writes ``results.csv``, ``differences.csv`` and ``bench.json``."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from math import isnan
from pathlib import Path

import pandas as pd

from endoct.base.errors import visible
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.bench.checkpoint import Facts, machine, plan_facts
from endoct.workbench.bench.results.summary import (
    COLUMNS,
    CONDITION,
    SCORE,
    Difference,
    columns_of,
    frame_of,
    score_names,
    summarise,
)
from endoct.workbench.bench.runner import Plan, Row
from endoct.workbench.bench.task import DOUBTED, SUCCESS, AnyTask, load_task
from endoct.workbench.pipeline.inputs import json_text


def write_csv(rows: Sequence[Row], task: AnyTask, path: Path) -> None:
    """Write a line for each row: what was run, its status, its conditions and its scores; empty where there is none."""
    frame = frame_of(rows)
    frame["task"] = task.name
    conditions = columns_of(frame, CONDITION)
    scores = [f"{SCORE}{name}" for name in (SUCCESS, DOUBTED, *score_names(rows, [*task.scores]))]
    _write(frame[["task", *COLUMNS, *conditions, *(name for name in scores if name in frame)]], path, digits=9)


def write_differences(differing: Sequence[Difference], reference: str, path: Path) -> None:
    """Write a line a method and score: median and quartiles of the difference, and how many cases went which way."""
    lines = [
        {
            "method": one.method,
            "against": reference,
            "score": one.score,
            "cases": one.spread.n,
            "median": one.spread.median,
            "quartile_1": one.spread.low,
            "quartile_3": one.spread.high,
            "lower": one.lower,
            "higher": one.higher,
        }
        for one in differing
    ]
    _write(pd.DataFrame(lines, dtype=object), path, digits=6)


def _write(frame: pd.DataFrame, path: Path, *, digits: int) -> None:
    cells = frame.astype(object).map(partial(_cell, digits=digits))
    cells.columns = pd.Index([_cell(name) for name in frame.columns], dtype=object)
    cells.to_csv(path, index=False, encoding="utf-8", lineterminator="\r\n")


def _cell(value: object, digits: int = 9) -> str:
    """Return a number as it is; a text, of anybody's method or folder, so that it is no formula, and as UTF-8."""
    if isinstance(value, str):
        return spreadsheet_text(visible(value))
    if isinstance(value, float):
        return "" if isnan(value) else f"{value:.{digits}g}"
    return "" if value is None else str(value)


def bench_facts(plan: Plan, rows: Sequence[Row], *, workers: int, seconds: float) -> Facts:
    """Return what ``bench.json`` holds: what was run, on what, with what, and the summary."""
    task = load_task(plan.task)
    return plan_facts(plan) | {
        "title": task.title,
        "scores": dict(task.scores),
        "summary": [asdict(summary) for summary in summarise(rows, [*task.scores], task.by)],
        "seconds": round(seconds, 1),
        "workers": workers,
        "machine": machine(),
    }


def write_json(facts: Facts, path: Path) -> None:
    """Write ``bench.json``."""
    path.write_text(json_text(facts) + "\n", encoding="utf-8")
