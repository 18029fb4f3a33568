"""The tables that a run of the bench prints, and what there is to know when reading them."""

from collections.abc import Sequence

from rich.table import Table

from endoct.workbench.bench.results.summary import Difference, Share, Spread, Summary, score_names, summarise
from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.task import DOUBTED, AnyTask

MOST_COLUMNS = 4
"""Scores in the table of results; the CSV has all."""
MOST_DIFFERENCES = 3
"""Scores in the table of differences."""
MOST_REASONS = 3


def table(rows: Sequence[Row], task: AnyTask) -> Table:
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


def footnotes(rows: Sequence[Row], task: AnyTask) -> list[str]:
    """Return what there is to know when reading the table: what the scores are, and why methods failed."""
    summaries = summarise(rows, [*task.scores], task.by)
    lines = ["median (quartiles) over the cases that have the score; success over all cases; s: median seconds a case"]
    if any(summary.doubted for summary in summaries):
        lines.append("doubted: of the cases it answered, those in which it called its own answer doubtful")
    lines += [f"{name}: {what}" for name, what in task.scores.items() if any(name in s.scores for s in summaries)]
    return lines + [f"{_name(s)}: {reason}" for s in summaries for reason in _first_reasons(s)]


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
        lines.add_row(method, *(_signed(one) for one in own), counts)
    return lines


def _name(summary: Summary) -> str:
    return summary.method if summary.word is None else f"{summary.word}, {summary.method}"


def _first_reasons(summary: Summary) -> list[str]:
    more = len(summary.reasons) - MOST_REASONS
    rest = [f"and {more} other reasons, see results.csv"] if more > 0 else []
    return [*summary.reasons[:MOST_REASONS], *rest]


def _share(share: Share | None) -> str:
    return f"{share.k}/{share.n} ({share.low:.0%}–{share.high:.0%})" if share else "–"


def _spread(spread: Spread | None) -> str:
    if spread is None:
        return "–"
    dash = " to " if spread.low < 0 else "–"
    return f"{spread.median:.3g} ({spread.low:.3g}{dash}{spread.high:.3g})"


def _signed(one: Difference | None) -> str:
    return f"{one.spread.median:+.3g} ({one.spread.low:+.3g} to {one.spread.high:+.3g})" if one else "–"
