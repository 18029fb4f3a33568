"""The results of a run as tables: printed, and written to ``results.csv``, ``differences.csv`` and ``bench.json``."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from math import isnan
from pathlib import Path

import pandas as pd
from rich.table import Table

from endoct.base.errors import visible
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.bench.checkpoint import Facts, machine, plan_facts
from endoct.workbench.bench.results.score_summary import (
    COLUMNS,
    CONDITION,
    SCORE,
    Difference,
    Share,
    Spread,
    columns_of,
    frame_of,
    score_names,
    summarise,
)
from endoct.workbench.bench.runner import BenchPlan, MethodResult
from endoct.workbench.bench.task import DOUBTED, SUCCESS, AnyTask, load_task
from endoct.workbench.running.outputs import json_text

MOST_COLUMNS = 5
"""Scores in the table of results; the CSV has all."""
MOST_DIFFERENCES = 3
"""Scores in the table of differences."""
MOST_REASONS = 3


def table(rows: Sequence[MethodResult], task: AnyTask) -> Table:
    """Return the table for the console, a line a method, or a line a word and method that answered anything."""
    summaries = summarise(rows, [*task.scores], task.by)
    if task.by is not None:
        summaries = [summary for summary in summaries if summary.declined < summary.cases]
    scores = score_names(rows, [*task.scores])[:MOST_COLUMNS]
    judged = any(summary.success is not None for summary in summaries)
    doubts = any(DOUBTED in row.scores for row in rows)
    counted = ["ok", *(["doubted"] if doubts else []), "declined", "failed"]
    named = ["method"] if task.by is None else [task.by, "method"]
    lines = Table(*named, *(["success (95 %)"] if judged else []), *scores, *counted, "s", box=None)
    for column in lines.columns[: len(named)]:
        column.no_wrap = True
    for column in lines.columns[len(named) :]:
        column.justify, column.overflow = "right", "fold"
    for summary in summaries:
        success = [_share(summary.success)] if judged else []
        values = [_spread(summary.scores.get(name)) for name in scores]
        counts = [str(getattr(summary, name)) for name in counted]
        word = [] if summary.word is None else [summary.word]
        lines.add_row(*word, summary.method, *success, *values, *counts, f"{summary.seconds.median:.2g}")
    return lines


def footnotes(rows: Sequence[MethodResult], task: AnyTask) -> list[str]:
    """Return what there is to know when reading the table: what the scores are, and why methods failed."""
    summaries = summarise(rows, [*task.scores], task.by)
    lines = ["median (quartiles) over the cases that have the score; success over all cases; s: median seconds a case"]
    if any(summary.doubted for summary in summaries):
        lines.append("doubted: of the cases it answered, those in which it called its own answer doubtful")
    lines += [f"{name}: {what}" for name, what in task.scores.items() if any(name in s.scores for s in summaries)]
    for summary in summaries:
        name = summary.method if summary.word is None else f"{summary.word}, {summary.method}"
        more = len(summary.reasons) - MOST_REASONS
        rest = [f"and {more} other reasons, see results.csv"] if more > 0 else []
        lines += [f"{name}: {reason}" for reason in (*summary.reasons[:MOST_REASONS], *rest)]
    return lines


def difference_table(differing: Sequence[Difference], reference: str) -> Table:
    """Return the table for the console: median and quartiles of the first scores' differences, a line a method."""
    scores = list(dict.fromkeys(one.score for one in differing))[:MOST_DIFFERENCES]
    lines = Table(f"less {reference}", *scores, "higher/lower/cases", box=None)
    for column in lines.columns[1:]:
        column.justify = "right"
    known = {(one.method, one.score): one for one in differing}
    for method in dict.fromkeys(one.method for one in differing):
        own = [known.get((method, score)) for score in scores]
        first = own[0]
        counts = f"{first.higher}/{first.lower}/{first.spread.n}" if first else "–"
        lines.add_row(method, *("–" if one is None else _spread(one.spread, "+") for one in own), counts)
    return lines


def _share(share: Share | None) -> str:
    return f"{share.k}/{share.n} ({share.low:.0%}–{share.high:.0%})" if share else "–"


def _spread(spread: Spread | None, sign: str = "") -> str:
    if spread is None:
        return "–"
    dash = " to " if sign or spread.low < 0 else "–"
    return f"{spread.median:{sign}.3g} ({spread.low:{sign}.3g}{dash}{spread.high:{sign}.3g})"


def write_csv(rows: Sequence[MethodResult], task: AnyTask, path: Path) -> None:
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


def bench_facts(plan: BenchPlan, rows: Sequence[MethodResult], *, workers: int, seconds: float) -> Facts:
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
