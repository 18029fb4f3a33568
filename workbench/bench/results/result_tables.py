"""The results of a run as tables: printed, and written to ``results.csv`` and ``bench.json``."""

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from endoct.base.errors import visible
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.bench.checkpoint import Facts, machine, plan_facts
from endoct.workbench.bench.results.score_summary import Difference, Share, Spread, score_names, summarise
from endoct.workbench.bench.runner import BenchPlan, MethodResult
from endoct.workbench.bench.task import SUCCESS, AnyTask, load_task

MOST_COLUMNS = 5
"""Scores in the table of results; the CSV has all."""
MOST_DIFFERENCES = 3
"""Scores in the table of differences."""
MOST_REASONS = 3
COLUMNS = "case", "method", "status", "reason", "seconds", "cpu_seconds"


def table(rows: Sequence[MethodResult], task: AnyTask) -> Table:
    """Return the table for the console, a line a method."""
    summaries = summarise(rows, [*task.scores])
    scores = score_names(rows, [*task.scores])[:MOST_COLUMNS]
    judged = any(summary.success is not None for summary in summaries)
    counted = "ok", "declined", "failed"
    lines = Table("method", *(["success (95 %)"] if judged else []), *scores, *counted, "s", box=None)
    lines.columns[0].no_wrap = True
    for column in lines.columns[1:]:
        column.justify, column.overflow = "right", "fold"
    for summary in summaries:
        success = [_share(summary.success)] if judged else []
        values = [_spread(summary.scores.get(name)) for name in scores]
        counts = [str(getattr(summary, name)) for name in counted]
        lines.add_row(summary.method, *success, *values, *counts, f"{summary.seconds.median:.2g}")
    return lines


def footnotes(rows: Sequence[MethodResult], task: AnyTask) -> list[str]:
    """Return what there is to know when reading the table: what the scores are, and why methods failed."""
    summaries = summarise(rows, [*task.scores])
    lines = ["median (quartiles) over the cases that have the score; success over all cases; s: median seconds a case"]
    lines += [f"{name}: {what}" for name, what in task.scores.items() if any(name in s.scores for s in summaries)]
    for summary in summaries:
        more = len(summary.reasons) - MOST_REASONS
        rest = [f"and {more} other reasons, see results.csv"] if more > 0 else []
        lines += [f"{summary.method}: {reason}" for reason in (*summary.reasons[:MOST_REASONS], *rest)]
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
    conditions = dict.fromkeys(name for row in rows for name in row.conditions)
    judged = [SUCCESS] if any(SUCCESS in row.scores for row in rows) else []
    scores = [*judged, *score_names(rows, [*task.scores])]
    titles = ["task", *COLUMNS, *(f"condition.{name}" for name in conditions), *(f"score.{name}" for name in scores)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(map(_cell, titles))
        for row in rows:
            of = [getattr(row, name) for name in COLUMNS]
            of += [row.conditions.get(name) for name in conditions] + [row.scores.get(name) for name in scores]
            writer.writerow(map(_cell, (task.name, *of)))


def _cell(value: str | float | None) -> str:
    """Return a number as it is; a text, of anybody's method or folder, so that it is no formula, and as UTF-8."""
    if value is None:
        return ""
    return spreadsheet_text(visible(value)) if isinstance(value, str) else f"{value:.9g}"


def bench_facts(plan: BenchPlan, rows: Sequence[MethodResult], *, workers: int, seconds: float) -> Facts:
    """Return what ``bench.json`` holds: what was run, on what, with what, and the summary."""
    task = load_task(plan.task)
    return plan_facts(plan) | {
        "title": task.title,
        "scores": dict(task.scores),
        "summary": [asdict(summary) for summary in summarise(rows, [*task.scores])],
        "seconds": round(seconds, 1),
        "workers": workers,
        "machine": machine(),
    }
