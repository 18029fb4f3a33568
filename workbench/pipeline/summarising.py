"""Many comparisons to one summary: a tidy table, medians, paired differences, repeatability."""

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text, spreadsheet_text
from endoct.fusion.files.result_file import EXPECTED, read_result
from endoct.fusion.result import Bounded, Result
from endoct.fusion.scoring.budget import PARTS
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED, Interval, interval_of, repeatability
from endoct.workbench.running.outputs import json_text

FIRST, SECOND = "first", "second"
TableRow = dict[str, str | float | None]
"""A line of a table, by column."""
Value = tuple[float | None, Interval]
"""A score and its interval, each None where it is not known."""
SCORES: Mapping[str, tuple[str, str]] = {
    "jaccard": ("overlap.jaccard", "overlap.jaccard_interval"),
    "dice": ("overlap.dice", "overlap.dice_interval"),
    "jaccard_own_rows": ("scores.own_rows.jaccard", "scores.own_rows.jaccard_interval"),
    "dice_own_rows": ("scores.own_rows.dice", "scores.own_rows.dice_interval"),
    "jaccard_by_li": ("scores.by_li.grid.jaccard", "scores.by_li.grid.jaccard_interval"),
    "dice_by_li": ("scores.by_li.grid.dice", "scores.by_li.grid.dice_interval"),
    "jaccard_by_li_own_rows": ("scores.by_li.own_rows.jaccard", "scores.by_li.own_rows.jaccard_interval"),
    "dice_by_li_own_rows": ("scores.by_li.own_rows.dice", "scores.by_li.own_rows.dice_interval"),
    "boundary_mean_mm": ("scores.boundary.mean_mm", "scores.boundary.mean_interval_mm"),
    "boundary_p95_mm": ("scores.boundary.p95_mm", ""),
    "boundary_within_share": ("scores.boundary.within_share", "scores.boundary.within_interval"),
    "cell_precision": ("scores.cells.precision", "scores.cells.precision_interval"),
    "cell_recall": ("scores.cells.recall", "scores.cells.recall_interval"),
    "cell_quality": ("scores.cells.quality", "scores.cells.quality_interval"),
    "area_bias_mm2": ("scores.area_mm2.bias", "scores.area_mm2.bias_interval"),
    "depth_bias_mm": ("scores.depth_mm.bias", "scores.depth_mm.bias_interval"),
    **{f"lost_to_{cause}": (f"budget.parts.{cause}.share", f"budget.parts.{cause}.interval") for cause in PARTS},
    **{f"expected_{of}": (f"bounds.{of}.expected", f"bounds.{of}") for of in ("light", "depth", "wall", "area_mm2")},
    "confidence": ("alignment.confidence", ""),
    "valid_fraction": ("valid_fraction", ""),
    "overlap_mm": ("overlap_mm", ""),
}
"""Scores by name: where a result has the value and its interval, "" where there is none."""


def score_of(result: Result, name: str) -> Value:
    """Return a score of a result."""
    value, interval = (_value_at(result, path) if path else None for path in SCORES[name])
    if isinstance(interval, Bounded):
        interval = None if interval.low is None or interval.high is None else (interval.low, interval.high)
    return value, interval


def _value_at(part: Any, path: str) -> Any:
    for name in path.split("."):
        part = None if part is None else getattr(part, name)
    return part


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
            if not any(Path(path).is_relative_to(folder) for folder in drawn)
        )


def summarise(folders: Sequence[Path], against: Sequence[Path], *, repeats: bool) -> dict[str, list[TableRow]]:
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
    rows = [row for comparison in (*first, *second) for row in _rows(comparison)]
    return {
        "scores": rows,
        "summary": list(_summary(rows)),
        "paired": list(_paired(first, second)) if second else [],
        "repeatability": list(_repeatability(rows)) if repeats else [],
    }


def write_summary(tables: Mapping[str, Sequence[TableRow]], folder: Path) -> None:
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


def _rows(compared: Compared) -> Iterator[TableRow]:
    values: dict[str, Value] = {"aligned": (float(compared.result.aligned), None)}
    values |= {name: score_of(compared.result, name) for name in SCORES}
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


def _by_specimen(rows: Sequence[TableRow]) -> dict[tuple[str, str], dict[str, list[float]]]:
    """Return by (set, score) and specimen the values that are known."""
    values: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        specimens = values.setdefault((str(row["set"]), str(row["score"])), {})
        if isinstance(row["value"], float):
            specimens.setdefault(str(row["specimen"]), []).append(row["value"])
    return values


def _summary(rows: Sequence[TableRow]) -> Iterator[TableRow]:
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


def _paired(first: Sequence[Compared], second: Sequence[Compared]) -> Iterator[TableRow]:
    pairs = list(_pairs(first, second))
    if not pairs:
        raise EndoctError(
            "no comparison of the one set has its like in the other",
            found=f"{first[0].folder.name} and {second[0].folder.name}",
            expected="the same recordings, or folders of the same names",
        )
    for name in SCORES:
        values = [(score_of(a.result, name)[0], score_of(b.result, name)[0]) for a, b in pairs]
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
    for comparison in first:
        partner = by_inputs.get(comparison.inputs) or by_name.get(comparison.folder.name)
        if partner is not None:
            yield comparison, partner


def _repeatability(rows: Sequence[TableRow]) -> Iterator[TableRow]:
    for (set_, name), specimens in _by_specimen(rows).items():
        found = None if name == "aligned" else repeatability(list(specimens.values()))
        if found is not None:
            yield {"set": set_, "score": name, **found}
