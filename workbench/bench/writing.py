"""What a run of the bench leaves behind: the table, ``results.csv``, ``bench.json``."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from endoct.stitching.errors import visible
from endoct.stitching.names import spreadsheet_text
from endoct.workbench.bench.keeping import asked
from endoct.workbench.bench.machine import machine
from endoct.workbench.bench.methods import load_task
from endoct.workbench.bench.runner import Plan, Row
from endoct.workbench.bench.summary import Share, Spread, Summary, score_names, summarise
from endoct.workbench.bench.task import DOUBTED, SUCCESS, Task
from endoct.workbench.pipeline.inputs import json_text

MOST_COLUMNS = 4
"""Scores shown on the console; the CSV has all."""


def write_csv(rows: Sequence[Row], task: Task, path: Path) -> None:
    """Write a line for each row: what was run, its status, its conditions and its scores; empty where there is none."""
    conditions = list(dict.fromkeys(name for row in rows for name in row.conditions))
    scores = [name for name in (SUCCESS, DOUBTED) if any(name in row.scores for row in rows)]
    scores += score_names(rows, [*task.scores])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        fixed = ["task", "case", "method", "status", "reason", "seconds", "cpu_seconds"]
        told = [*fixed, *(f"condition.{name}" for name in conditions), *(f"score.{name}" for name in scores)]
        writer.writerow(map(_cell, told))
        for row in rows:
            values = [task.name, row.case, row.method, row.status, row.reason, row.seconds, row.cpu_seconds]
            values += [row.conditions.get(name, "") for name in conditions]
            writer.writerow([*map(_cell, values), *(_cell(row.scores.get(name, "")) for name in scores)])


def _cell(value: object) -> str:
    """Return a number as it is; a text, of a stranger's method or of a folder's name, as no formula and as UTF-8."""
    if isinstance(value, str):
        return spreadsheet_text(visible(value))
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def facts(plan: Plan, rows: Sequence[Row], *, workers: int, seconds: float) -> dict[str, Any]:
    """Return what ``bench.json`` holds: what was run, on what, with what, and the summary."""
    task = load_task(plan.task)
    return asked(plan) | {
        "title": task.title,
        "scores": dict(task.scores),
        "summary": [asdict(summary) for summary in summarise(rows, [*task.scores])],
        "seconds": round(seconds, 1),
        "workers": workers,
        "machine": machine(),
    }


def write_json(told: Mapping[str, Any], path: Path) -> None:
    """Write ``bench.json``."""
    path.write_text(json_text(told) + "\n", encoding="utf-8")


def table(rows: Sequence[Row], task: Task) -> Table:
    """Return the table for the console, a line a method."""
    summaries = summarise(rows, [*task.scores])
    shown = score_names(rows, [*task.scores])[:MOST_COLUMNS]
    succeeds = any(summary.success is not None for summary in summaries)
    doubts = any(DOUBTED in row.scores for row in rows)
    counted = ["ok", *(["doubted"] if doubts else []), "declined", "failed"]
    made = Table("method", *(["success (95 %)"] if succeeds else []), *shown, *counted, "s", box=None)
    made.columns[0].no_wrap = True
    for column in made.columns[1:]:
        column.justify, column.overflow = "right", "fold"
    for summary in summaries:
        success = [_share(summary.success)] if succeeds else []
        values = [_spread(summary.scores.get(name)) for name in shown]
        counts = [str(getattr(summary, name)) for name in counted]
        made.add_row(summary.method, *success, *values, *counts, f"{summary.seconds.median:.2g}")
    return made


def footnotes(rows: Sequence[Row], task: Task) -> list[str]:
    """Return what there is to know when reading the table: what the scores are, and why methods failed."""
    summaries = summarise(rows, [*task.scores])
    lines = ["median (quartiles) over the cases that have the score; success over all cases; s: median seconds a case"]
    if any(summary.doubted for summary in summaries):
        lines.append("doubted: of the cases it answered, those whose answer it said not to rely on")
    lines += [f"{name}: {what}" for name, what in task.scores.items() if any(name in s.scores for s in summaries)]
    return lines + [f"{s.method}: {reason}" for s in summaries for reason in _few(s)]


def _few(summary: Summary, most: int = 3) -> list[str]:
    more = len(summary.reasons) - most
    return [*summary.reasons[:most], *([f"and {more} other reasons, see results.csv"] if more > 0 else [])]


def _share(share: Share | None) -> str:
    return f"{share.k}/{share.n} ({share.low:.0%}–{share.high:.0%})" if share else "–"


def _spread(spread: Spread | None) -> str:
    if spread is None:
        return "–"
    dash = " to " if spread.low < 0 else "–"
    return f"{spread.median:.3g} ({spread.low:.3g}{dash}{spread.high:.3g})"
