"""The supplement of a study: many comparisons as a page that opens offline, with tables, plots and how it was made."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from endoct.base.files.contents import write_marked
from endoct.base.files.files import path_text, sha256_of
from endoct.fusion.files.store import COMPARISON_STORE, ComparisonOutline, read_outline
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.scoring.cells import areas_mm2
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED
from endoct.workbench.page.collection import LEVELS
from endoct.workbench.page.heading import Heading, Score, printed_page
from endoct.workbench.page.notes import read_note
from endoct.workbench.pipeline.summarising import FIRST, SECOND, Compared, TableRow, read_set
from endoct.workbench.report.figures.cohort import Cohort, draw_cohort
from endoct.workbench.report.html_templates import rendered_blocks
from endoct.workbench.report.sections import MADE, in_order, numbered
from endoct.workbench.report.verdict import Verdict, verdict_of
from endoct.workbench.report.wording import NOTHING, interval_text, share_text
from endoct.workbench.requests import SummariseRequest
from endoct.workbench.running.outputs import versions

PAGE = "report.html"
TITLES = {
    "results": "Every comparison",
    "scores": "Scores",
    "agreement": "How the two sides agree",
    "repeatability": "Repeatability",
    "raters": "Raters",
    "provenance": MADE,
}
PAIRED = "score", "pairs", "median_difference", "", "second_higher", "second_lower"
REPEATS = "score", "specimens", "comparisons", "within_sd", "repeatability", "icc"
REMARK = "The figures lie next to this page, as PNG and as SVG, in figures/."


def write_supplement(tables: Mapping[str, Sequence[TableRow]], request: SummariseRequest, folder: Path) -> None:
    """Write ``figures/`` and ``report.html`` on the comparisons of a request, of which the first set is drawn.

    ``tables`` are those of their summary. Raises :class:`EndoctError` where a comparison cannot be read.
    """
    first, second = (
        read_set([*map(Path, folders)], name, repeats=request.repeats)
        for folders, name in ((request.folders, FIRST), (request.against, SECOND))
    )
    compared = [*first, *second]
    (folder / "figures").mkdir()
    drawn = draw_cohort(_cohort(first), folder / "figures")
    for figure in drawn:
        (folder / "figures" / figure.rendered.file).write_bytes(figure.rendered.png)
    texts = rendered_blocks(
        "report/summary.html",
        results=[_result_row(comparison) for comparison in compared],
        summary=[_summary_row(row) for row in tables["summary"]],
        paired=[_row(row, *PAIRED) for row in tables["paired"]],
        repeats=[_row(row, *REPEATS) for row in tables["repeatability"]],
        how=f"Intervals hold {LEVEL * 100:.0f} %: {RESAMPLES} resamples over specimens, from the seed {SEED}.",
        line=_command(request),
        inputs=[_input_row(comparison) for comparison in compared],
    )
    page = printed_page(
        _heading(tables, first, Path(request.output or "").name), in_order(TITLES, numbered(drawn), texts), REMARK
    )
    write_marked(page, folder / PAGE)


def _command(request: SummariseRequest) -> str:
    against = ["--against", *request.against] if request.against else []
    repeats = ["--repeats"] if request.repeats else []
    return shlex.join(map(str, ["endoct", "summarise", *request.folders, *against, *repeats, "-o", request.output]))


def _cohort(compared: Sequence[Compared]) -> Cohort:
    """Return what is drawn of comparisons: of the two sides that most of them have."""
    names = Counter(comparison.result.sides for comparison in compared if comparison.result.aligned).most_common(1)
    sides = names[0][0] if names else compared[0].result.sides
    alike = [comparison for comparison in compared if comparison.result.sides == sides and comparison.result.aligned]
    cells = [
        areas_mm2(*sides, outline.cells) for comparison in alike if (outline := _outline(comparison.folder)) is not None
    ]
    by_specimen: dict[str, list[float]] = {}
    for comparison in alike:
        if comparison.result.jaccard is not None:
            by_specimen.setdefault(comparison.specimen, []).append(comparison.result.jaccard)
    return Cohort(
        sides,
        [comparison.result for comparison in alike],
        np.concatenate(cells) if cells else np.empty((0, 2)),
        {name: values for name, values in by_specimen.items() if len(values) > 1},
    )


def _outline(folder: Path) -> ComparisonOutline | None:
    """Return the cells of a comparison; None where only its result is left."""
    return read_outline(folder / COMPARISON_STORE) if (folder / COMPARISON_STORE).is_dir() else None


def _heading(tables: Mapping[str, Sequence[TableRow]], compared: Sequence[Compared], title: str) -> Heading:
    levels = Counter(verdict_of(comparison.result).level for comparison in compared)
    said = ", ".join(f"{levels[level]} {word}" for level, word in LEVELS.items() if levels[level])
    worst = next(level for level in reversed(LEVELS) if levels[level])
    of_first = {row["score"]: row for row in tables["summary"] if row["set"] == FIRST}
    scores = [
        Score(f"{words}, median of {row['specimens']}", _number(row["value"]), _interval(row))
        for name, words in (("jaccard", "Jaccard index"), ("dice", "Dice index"))
        if (row := of_first.get(name)) is not None
    ]
    return Heading(
        title=f"{title}: {len(compared)} comparisons",
        facts=(("sides", ", ".join(sorted({" and ".join(comparison.result.sides) for comparison in compared}))),),
        verdict=Verdict(worst, f"Of {len(compared)} comparisons: {said}."),
        doubts=(),
        scores=tuple(scores),
        notes=0,
        endoct=versions()["endoct"],
    )


def _result_row(comparison: Compared) -> list[str]:
    result = comparison.result
    interval = result.overlap.jaccard_interval if result.overlap else None
    return [
        path_text("/".join(comparison.folder.parts[-2:])),
        LEVELS[verdict_of(result).level],
        share_text(result.jaccard if result.aligned else None),
        interval_text(interval).removeprefix("95 % interval ") or NOTHING,
        share_text(result.dice if result.aligned else None),
        ", ".join(sorted({doubt.code for doubt in result.doubts})),
        read_note(comparison.folder),
    ]


def _summary_row(row: TableRow) -> list[str]:
    quartiles = f"{_number(row['quartile_1'])} to {_number(row['quartile_3'])}"
    return [*_row(row, "score", "set", "specimens", "value"), _interval(row), quartiles]


def _row(row: TableRow, *columns: str) -> list[str]:
    """Return columns of a row as texts; of "" the interval."""
    return [_number(row[column]) if column else _interval(row) for column in columns]


def _interval(row: TableRow) -> str:
    return NOTHING if row["low"] is None else f"{_number(row['low'])} to {_number(row['high'])}"


def _number(value: str | float | None) -> str:
    if value is None or isinstance(value, str):
        return value or NOTHING
    return f"{value:.3g}".replace("-", "−")


def _input_row(comparison: Compared) -> list[str]:
    stated = comparison.result.parameters.get("compare") or {}
    usual = CompareParameters().model_dump(mode="json")
    changed = [f"{name} = {value}" for name, value in stated.items() if name in usual and value != usual[name]]
    digest = sha256_of(comparison.folder / "result.json")
    return [
        path_text(comparison.folder),
        comparison.result.versions.get("endoct", NOTHING),
        ", ".join(changed) or NOTHING,
        digest,
    ]
