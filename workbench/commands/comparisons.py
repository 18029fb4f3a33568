"""Commands that compare two sides, report a comparison and summarise many."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional

from endoct.workbench.commands.console import (
    TextConsole,
    command_stages,
    print_begun,
    print_json,
    print_line,
    print_result,
)
from endoct.workbench.requests import UNSET, CompareRequest, Output, SummariseRequest
from endoct.workbench.running.refusals import DONE

if TYPE_CHECKING:
    from endoct.workbench.pipeline.summarising import TableRow

_IN_FILES_ONLY = ("statistic", "quartile_1", "quartile_3")
"""Columns of a summary that are left out of what is printed."""
_WIDEST = 120
"""Characters that the widest of the tables takes; where a line is shorter it wraps, so that nothing is cut off."""


@dataclass(frozen=True, eq=False)
class Compare(CompareRequest):
    """Compare two sides of one bore: recordings, panoramas, or mask images drawn by hand.

    Args:
        force: accept the best alignment even where it does not stand out; that is a doubt
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        json: print the result as JSON
    """

    output: Output = field()
    _: KW_ONLY
    force: bool = False
    strict: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Compare, print the result, and return the exit status."""
        from endoct.workbench import api
        from endoct.workbench.settings import parse

        settings = parse(self.settings) | ({"force": True} if self.force else {})
        api.compare(replace(self, settings=settings, progress=command_stages(self.json)))
        return print_result(Path(self.output), as_json=self.json, strict=self.strict)


def report(folder: Positional[Path]) -> int:
    """Write the report of a comparison, or of an unrolled recording, again.

    Args:
        folder: a folder written by `endoct compare`, or a panorama written by `endoct unroll`
    """
    from endoct.workbench.page.report import write_report
    from endoct.workbench.running.scheduler import scheduler

    with command_stages(False).stage("report"), scheduler() as second:
        path = write_report(folder, second)
    print_line(f"report: {path}")
    return DONE


def serve(folder: Positional[Path], host: str = "127.0.0.1", port: Annotated[int | None, UNSET] = None) -> int:
    """Show a comparison, a panorama, or a folder of these on a page in the browser, until interrupted (Ctrl+C).

    Args:
        folder: a folder written by `endoct compare`, a panorama written by `endoct unroll`, or a folder that holds some
        host: address to listen on; others than this machine reach it only where this is another than 127.0.0.1
        port: port to listen on; else 8765, or where that is taken any that is free
    """
    print_begun(f"opening {folder}; the address follows")
    from endoct.workbench.page.serving import serve as serve_page

    serve_page(folder, host, port, lambda address: print_line(f"{address} shows {folder}; Ctrl+C ends it"))
    return DONE


@dataclass(frozen=True, eq=False)
class Summarise(SummariseRequest):
    """Summarise many comparisons: a tidy table, medians over specimens with intervals, differences, repeatability.

    Or many poses: a row each, and how far the two sides agree over all of them.

    Args:
        json: print the summary as JSON
    """

    output: Output = field()
    _: KW_ONLY
    json: bool = False

    def __call__(self) -> int:
        """Summarise, print the tables, and return the exit status."""
        from endoct.workbench import api

        tables = api.summarise(self)
        if self.json:
            print_json(tables)
            return DONE
        for name in ("summary", "paired", "repeatability"):
            if rows := [{k: v for k, v in row.items() if k not in _IN_FILES_ONLY} for row in tables.get(name, ())]:
                _print_table(name, rows)
        _print_poses(tables.get("poses", ()), tables.get("agreement", ()))
        print_line(f"summary: {self.output}")
        return DONE


def _print_table(name: str, rows: "Sequence[TableRow]") -> None:
    table = Table(title=name, title_justify="left", box=None)
    for column in rows[0]:
        table.add_column(column, no_wrap=True)
    for row in rows:
        table.add_row(*("–" if v is None else f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()))
    console = TextConsole()
    console.width = max(console.width, _WIDEST)
    console.print(table, crop=False)


def _print_poses(poses: Sequence["TableRow"], agreement: Sequence["TableRow"]) -> None:
    for row in poses:
        value, low, high = (_text(row.get(f"offset_at_target_mm{end}")) for end in ("", "_low", "_high"))
        said = f"{value} ({low} to {high}) mm off its plan at the target" if row["told"] else "not told"
        print_line(f"{row['pose']}: {said}")
    for row in agreement:
        bias, low, high = (_text(row[name]) for name in ("bias_mm", "low_mm", "high_mm"))
        test = f"{'' if row['equivalent'] else 'not shown to be '}equivalent within ±{row['bound_mm']} mm"
        limits = f"limits of agreement {low} to {high} mm ({row['bores']} bores)"
        print_line(f"{row['sides']}, {row['place']}, {row['direction']}: bias {bias} mm, {limits}, {test}")


def _text(value: str | float | None) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)
