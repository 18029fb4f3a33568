"""The rows of a run as a table."""

from collections.abc import Sequence

import pandas as pd

from endoct.workbench.bench.runner import Row
from endoct.workbench.bench.task import DOUBTED, SUCCESS

CONDITION, SCORE = "condition.", "score."
"""Beginnings of the columns' names of conditions and scores."""
TIMES = ["seconds", "cpu_seconds"]
COLUMNS = ["case", "method", "status", "reason", *TIMES]


def frame_of(rows: Sequence[Row]) -> pd.DataFrame:
    """Return a line a row: :data:`COLUMNS`, ``condition.NAME`` and ``score.NAME``, None or NaN where there is none.

    Names and words stay Python objects: they may come from anybody's method or folder, and be no valid Unicode.
    """
    lines = [_line(row) for row in rows]
    names = list(dict.fromkeys([*COLUMNS, *(name for line in lines for name in line)]))
    values = [[line.get(name) for name in names] for line in lines]
    frame = pd.DataFrame(values, columns=pd.Index(names, dtype=object), dtype=object)
    numbers = [*TIMES, *(name for name in names if name.startswith(SCORE))]
    return frame.astype(dict.fromkeys(numbers, float))


def columns_of(frame: pd.DataFrame, beginning: str) -> list[str]:
    """Return the names of the columns that begin with :data:`CONDITION` or :data:`SCORE`, in order."""
    return [name for name in map(str, frame.columns) if name.startswith(beginning)]


def score_names(rows: Sequence[Row], listed: Sequence[str]) -> list[str]:
    """Return the names of the scores that rows have, ``listed`` first, ``success`` and ``doubted`` left out."""
    present = dict.fromkeys(name for row in rows for name in row.scores if name not in (SUCCESS, DOUBTED))
    return [name for name in listed if name in present] + [name for name in present if name not in listed]


def _line(row: Row) -> dict[str, float | str]:
    return {
        **{name: getattr(row, name) for name in COLUMNS},
        **{f"{CONDITION}{name}": value for name, value in row.conditions.items()},
        **{f"{SCORE}{name}": value for name, value in row.scores.items()},
    }
