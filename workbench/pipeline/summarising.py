"""Many comparisons to one summary: a tidy table, medians, paired differences, repeatability."""

import csv
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text, spreadsheet_text
from endoct.fusion.files.result_file import EXPECTED, read_result
from endoct.fusion.result import Bounded, PairScores, Result
from endoct.fusion.scoring.budget import PARTS
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED, Interval, interval_of, repeatability
from endoct.workbench.running.outputs import json_text

FIRST, SECOND = "first", "second"
Row = dict[str, str | float | None]
"""A line of a table, by column."""
Value = tuple[float | None, Interval]
"""A score and its interval, each None where it is not known."""
Score = Callable[[Result], Value]
P = TypeVar("P")


def _of(part: Callable[[Result], P | None], value: Callable[[P], Value]) -> Score:
    def score(result: Result) -> Value:
        found = part(result)
        return (None, None) if found is None else value(found)

    return score


def _of_scores(part: Callable[[PairScores], P | None], value: Callable[[P], Value]) -> Score:
    return _of(lambda result: part(result.scores) if result.scores else None, value)


def _expected(figure: str) -> Score:
    def value(result: Result) -> Value:
        of: Bounded | None = getattr(result.bounds, figure, None)
        if of is None:
            return None, None
        return of.expected, None if of.low is None or of.high is None else (of.low, of.high)

    return value


def _lost_to(cause: str) -> Score:
    def value(result: Result) -> Value:
        if result.budget is None:
            return None, None
        part = result.budget.parts.by_cause()[cause]
        return part.share, part.interval

    return value


SCORES: Mapping[str, Score] = {
    "jaccard": _of(lambda result: result.overlap, lambda on_grid: (on_grid.jaccard, on_grid.jaccard_interval)),
    "dice": _of(lambda result: result.overlap, lambda on_grid: (on_grid.dice, on_grid.dice_interval)),
    "jaccard_own_rows": _of_scores(lambda scores: scores.own_rows, lambda rows: (rows.jaccard, rows.jaccard_interval)),
    "dice_own_rows": _of_scores(lambda scores: scores.own_rows, lambda rows: (rows.dice, rows.dice_interval)),
    "jaccard_by_li": _of_scores(lambda scores: scores.by_li, lambda of: (of.grid.jaccard, of.grid.jaccard_interval)),
    "dice_by_li": _of_scores(lambda scores: scores.by_li, lambda of: (of.grid.dice, of.grid.dice_interval)),
    "jaccard_by_li_own_rows": _of_scores(
        lambda scores: scores.by_li, lambda of: (of.own_rows.jaccard, of.own_rows.jaccard_interval)
    ),
    "dice_by_li_own_rows": _of_scores(
        lambda scores: scores.by_li, lambda of: (of.own_rows.dice, of.own_rows.dice_interval)
    ),
    "boundary_mean_mm": _of_scores(lambda scores: scores.boundary, lambda of: (of.mean_mm, of.mean_interval_mm)),
    "boundary_p95_mm": _of_scores(lambda scores: scores.boundary, lambda of: (of.p95_mm, None)),
    "boundary_within_share": _of_scores(
        lambda scores: scores.boundary, lambda of: (of.within_share, of.within_interval)
    ),
    "cell_precision": _of_scores(lambda scores: scores.cells, lambda of: (of.precision, of.precision_interval)),
    "cell_recall": _of_scores(lambda scores: scores.cells, lambda of: (of.recall, of.recall_interval)),
    "cell_quality": _of_scores(lambda scores: scores.cells, lambda of: (of.quality, of.quality_interval)),
    "area_bias_mm2": _of_scores(lambda scores: scores.area_mm2, lambda of: (of.bias, of.bias_interval)),
    "depth_bias_mm": _of_scores(lambda scores: scores.depth_mm, lambda of: (of.bias, of.bias_interval)),
    **{f"lost_to_{cause}": _lost_to(cause) for cause in PARTS},
    **{f"expected_{figure}": _expected(figure) for figure in ("light", "depth", "wall", "area_mm2")},
    "confidence": _of(lambda result: result.alignment, lambda alignment: (alignment.confidence, None)),
    "valid_fraction": lambda result: (result.valid_fraction, None),
    "overlap_mm": lambda result: (result.overlap_mm, None),
}
"""Scores by name, as functions of a result."""


@dataclass(frozen=True)
class Compared:
    """One comparison: the folder it lies in, the set it belongs to, its specimen, and its result."""

    folder: Path
    set: str
    specimen: str
    result: Result

    @property
    def inputs(self) -> frozenset[str]:
        """Digests of the two sides. Masks given as truth are no part of what was compared."""
        drawn = tuple(map(Path, self.result.truth or ()))
        return frozenset(
            digest
            for path, digest in self.result.inputs.items()
            if not any(Path(path).is_relative_to(one) for one in drawn)
        )


def summarise(folders: Sequence[Path], against: Sequence[Path], *, repeats: bool) -> dict[str, list[Row]]:
    """Return the tables of a summary by name, each a list of rows.

    ``folders`` are comparisons of the first set, ``against`` those of the second. Each of the first is paired with one
    of the second by the digests of its inputs, or else by the folder's name. With ``repeats``, comparisons in one
    folder are of one specimen; else each is of its own.

    ``scores``: a row a comparison and score, with its interval over cells and the codes of the comparison's doubts.
    ``summary``: a row a set and score: n, median (of aligned: mean) and its interval, quartiles, over specimens (their
    means where there are repeats). ``paired``: second set less first. ``repeatability``: within specimens. The last two
    are empty where there are no pairs and no repeats.

    Raises :class:`EndoctError` where a folder is no comparison, or no two can be paired.
    """
    if not folders:
        raise EndoctError("there is nothing to summarise", expected="folders written by `endoct compare`")
    first, second = (read_set(*of, repeats=repeats) for of in ((folders, FIRST), (against, SECOND)))
    rows = [row for one in (*first, *second) for row in _rows(one)]
    return {
        "scores": rows,
        "summary": list(_summary(rows)),
        "paired": list(_paired(first, second)) if second else [],
        "repeatability": list(_repeatability(rows)) if repeats else [],
    }


def write_summary(tables: Mapping[str, Sequence[Row]], folder: Path) -> None:
    """Write every table that has rows as CSV into ``folder``, and all of them as ``summary.json``."""
    folder.mkdir()
    for name, rows in tables.items():
        if rows:
            with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                for row in rows:
                    writer.writerow({k: spreadsheet_text(v) if isinstance(v, str) else v for k, v in row.items()})
    bootstrap = {"resamples": RESAMPLES, "seed": SEED, "level": LEVEL, "over": "specimens"}
    text = json_text({**tables, "bootstrap": bootstrap} if "scores" in tables else dict(tables))
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def read_set(folders: Sequence[Path], name: str, *, repeats: bool) -> list[Compared]:
    """Return the comparisons in ``folders`` as the set ``name``.

    A specimen is named by its folder, with those above it as far as they differ: two that are called alike stay two.
    Raises :class:`EndoctError` where a folder is no comparison.
    """
    results = [_result_in(folder) for folder in folders]
    whole = [folder.resolve() for folder in folders]
    places = [folder.parent if repeats else folder for folder in whole]
    above = os.path.commonpath([place.parent for place in places]) if places else ""
    specimens = [path_text(place.relative_to(above).as_posix()) for place in places]
    return [Compared(*of) for of in zip(whole, [name] * len(whole), specimens, results, strict=True)]


def _result_in(folder: Path) -> Result:
    try:
        return read_result(folder)
    except EndoctError as error:
        raise EndoctError(f"{folder} is no comparison", found=error.found or error.what, expected=EXPECTED) from error


def _rows(compared: Compared) -> Iterator[Row]:
    values: dict[str, Value] = {"aligned": (float(compared.result.aligned), None)}
    values |= {name: score(compared.result) for name, score in SCORES.items()}
    for name, (value, interval) in values.items():
        yield {
            "set": compared.set,
            "comparison": path_text(compared.folder),
            "specimen": compared.specimen,
            "score": name,
            "value": value,
            "low": interval[0] if interval else None,
            "high": interval[1] if interval else None,
            "doubts": " ".join(sorted({doubt.code for doubt in compared.result.doubts})),
        }


def _by_specimen(rows: Sequence[Row]) -> dict[tuple[str, str], dict[str, list[float]]]:
    """Return by (set, score) and specimen the values that are known."""
    found: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        specimens = found.setdefault((str(row["set"]), str(row["score"])), {})
        if isinstance(row["value"], float):
            specimens.setdefault(str(row["specimen"]), []).append(row["value"])
    return found


def _summary(rows: Sequence[Row]) -> Iterator[Row]:
    for (set_, name), specimens in _by_specimen(rows).items():
        values = np.array([np.mean(of_one) for of_one in specimens.values()])
        if not values.size:
            continue
        statistic = np.mean if name == "aligned" else np.median
        interval = interval_of(values, statistic) or (None, None)
        yield {
            "set": set_,
            "score": name,
            "specimens": int(values.size),
            "statistic": "mean" if name == "aligned" else "median",
            "value": float(statistic(values)),
            "low": interval[0],
            "high": interval[1],
            "quartile_1": float(np.quantile(values, 0.25)),
            "quartile_3": float(np.quantile(values, 0.75)),
        }


def _paired(first: Sequence[Compared], second: Sequence[Compared]) -> Iterator[Row]:
    pairs = list(_pairs(first, second))
    if not pairs:
        raise EndoctError(
            "no comparison of the one set has its like in the other",
            found=f"{first[0].folder.name} and {second[0].folder.name}",
            expected="the same recordings, or folders of the same names",
        )
    for name, score in SCORES.items():
        values = [(score(one.result)[0], score(two.result)[0]) for one, two in pairs]
        differs = np.array([two - one for one, two in values if one is not None and two is not None], dtype=np.float64)
        if not differs.size:
            continue
        interval = interval_of(differs) or (None, None)
        yield {
            "score": name,
            "pairs": int(differs.size),
            "median_difference": float(np.median(differs)),
            "low": interval[0],
            "high": interval[1],
            "second_higher": int((differs > 0).sum()),
            "second_lower": int((differs < 0).sum()),
        }


def _pairs(first: Sequence[Compared], second: Sequence[Compared]) -> Iterator[tuple[Compared, Compared]]:
    by_inputs = {two.inputs: two for two in second if two.inputs}
    by_name = {two.folder.name: two for two in second}
    if len(by_inputs) < len(second):  # several of one recording: the names say which is meant
        by_inputs = {}
    for one in first:
        two = by_inputs.get(one.inputs) or by_name.get(one.folder.name)
        if two is not None:
            yield one, two


def _repeatability(rows: Sequence[Row]) -> Iterator[Row]:
    for (set_, name), specimens in _by_specimen(rows).items():
        found = None if name == "aligned" else repeatability(list(specimens.values()))
        if found is not None:
            yield {"set": set_, "score": name, **found}
