"""Many comparisons to one summary: a tidy table, medians, paired differences, repeatability."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from endoct.fusion.files.result_file import EXPECTED, stored_result
from endoct.fusion.scoring.intervals import LEVEL, RESAMPLES, SEED, interval_of
from endoct.fusion.scoring.repeatability import repeatability
from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.names import spreadsheet_text
from endoct.workbench.pipeline.inputs import json_text, path_text

SCORES: Mapping[str, tuple[str, ...]] = {
    "jaccard": ("jaccard",),
    "dice": ("dice",),
    "jaccard_own_rows": ("scores", "own_rows", "jaccard"),
    "dice_own_rows": ("scores", "own_rows", "dice"),
    "boundary_mean_mm": ("scores", "boundary", "mean_mm"),
    "boundary_p95_mm": ("scores", "boundary", "p95_mm"),
    "boundary_within_share": ("scores", "boundary", "within_share"),
    "cell_precision": ("scores", "cells", "precision"),
    "cell_recall": ("scores", "cells", "recall"),
    "cell_quality": ("scores", "cells", "quality"),
    "area_bias_mm2": ("scores", "area_mm2", "bias"),
    "depth_bias_mm": ("scores", "depth_mm", "bias"),
    "lost_to_alignment": ("budget", "parts", "alignment", "share"),
    "lost_to_sampling": ("budget", "parts", "sampling", "share"),
    "lost_to_visibility": ("budget", "parts", "visibility", "share"),
    "lost_to_segmentation": ("budget", "parts", "segmentation", "share"),
    "confidence": ("alignment", "confidence"),
    "valid_fraction": ("valid_fraction",),
    "overlap_mm": ("overlap_mm",),
}
"""Scores by name, and where ``result.json`` holds them."""
_INTERVALS: Mapping[str, tuple[str, ...]] = {
    "jaccard": ("scores", "grid", "jaccard_interval"),
    "dice": ("scores", "grid", "dice_interval"),
    "jaccard_own_rows": ("scores", "own_rows", "jaccard_interval"),
    "dice_own_rows": ("scores", "own_rows", "dice_interval"),
    "boundary_mean_mm": ("scores", "boundary", "mean_interval_mm"),
    "boundary_within_share": ("scores", "boundary", "within_interval"),
    "cell_precision": ("scores", "cells", "precision_interval"),
    "cell_recall": ("scores", "cells", "recall_interval"),
    "cell_quality": ("scores", "cells", "quality_interval"),
    "area_bias_mm2": ("scores", "area_mm2", "bias_interval"),
    "depth_bias_mm": ("scores", "depth_mm", "bias_interval"),
    **{
        f"lost_to_{part}": ("budget", "parts", part, "interval")
        for part in ("alignment", "sampling", "visibility", "segmentation")
    },
}

Row = dict[str, Any]

LARGEST_SCORE = 1e12


@dataclass(frozen=True)
class Told:
    """One comparison: the folder it lies in, the set it belongs to, its specimen, and its ``result.json``."""

    folder: Path
    set: str
    specimen: str
    result: Mapping[str, Any]

    @property
    def inputs(self) -> frozenset[str]:
        """Digests of the two sides. Masks given as truth are no part of what was compared."""
        drawn = tuple(map(Path, _object(self.result, "truth")))
        return frozenset(
            digest
            for path, digest in _object(self.result, "inputs").items()
            if not any(Path(path).is_relative_to(one) for one in drawn)
        )


def summarise(folders: Sequence[Path], against: Sequence[Path], *, repeats: bool) -> dict[str, list[Row]]:
    """Return the tables of a summary by name, each a list of rows.

    ``folders`` are comparisons of the first set, ``against`` of the second, with which each of the first is paired by
    the digests of its inputs, or else by the folder's name. With ``repeats``, comparisons in one folder are of one
    specimen; else each is of its own.

    ``scores``: a row a comparison and score, with its interval over cells. ``summary``: a row a set and score: n,
    median (of aligned: mean) and its interval, quartiles, over specimens (their means where there are repeats).
    ``paired``: second set less first. ``repeatability``: within specimens. The last two are empty where there is
    nothing to tell.

    Raises :class:`EndoctError` where a folder is no comparison, or no two can be paired.
    """
    if not folders:
        raise EndoctError("there is nothing to summarise", expected="folders written by `endoct compare`")
    told = [_read(folder, "first", repeats) for folder in folders]
    other = [_read(folder, "second", repeats) for folder in against]
    rows = [row for one in (*told, *other) for row in _rows(one)]
    return {
        "scores": rows,
        "summary": list(_summary(rows)),
        "paired": list(_paired(told, other)) if other else [],
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
    text = json_text({**tables, "bootstrap": bootstrap})
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def _read(folder: Path, set_: str, repeats: bool) -> Told:
    """Read a comparison; whatever in it is not what it should be is told here, before anything is reckoned with it."""
    result = stored_result(folder)
    with refusing(f"{folder} is no comparison", expected=EXPECTED):
        if "aligned" not in result:
            raise ValueError("no result")
        folder = folder.resolve()
        told = Told(folder, set_, path_text((folder.parent if repeats else folder).name), result)
        _values(result)
        if not all(isinstance(digest, str) for digest in _object(result, "inputs").values()):
            raise ValueError("'inputs' are no digests")
        _object(result, "truth")
    return told


def _rows(told: Told) -> Iterator[Row]:
    for name, (value, interval) in _values(told.result).items():
        yield {
            "set": told.set,
            "comparison": path_text(told.folder),
            "specimen": told.specimen,
            "score": name,
            "value": value,
            "low": interval[0] if interval else None,
            "high": interval[1] if interval else None,
        }


def _values(result: Mapping[str, Any]) -> dict[str, tuple[float | None, tuple[float, float] | None]]:
    """Return value and interval of "aligned" and of every score; None for what is not there.

    Raises ``ValueError`` where something else stands in its place.
    """
    found: dict[str, tuple[float | None, tuple[float, float] | None]] = {}
    for name, path in (("aligned", ("aligned",)), *SCORES.items()):
        interval = _at(result, _INTERVALS[name]) if name in _INTERVALS else None
        if interval is not None and (not isinstance(interval, list) or len(interval) != 2):
            raise ValueError(f"the interval of '{name}' is no two numbers")
        value = _at(result, path)
        if isinstance(value, bool) != (name == "aligned"):
            raise ValueError(f"'{name}' is no {'truth value' if name == 'aligned' else 'number'}")
        numbers = None if interval is None else (_number(name, interval[0]), _number(name, interval[1]))
        found[name] = None if value is None else _number(name, value), numbers
    return found


def _number(name: str, value: object) -> float:
    if not isinstance(value, int | float) or not abs(value) <= LARGEST_SCORE:
        raise ValueError(f"'{name}' is no number")
    return float(value)


def _at(result: Mapping[str, Any], path: Sequence[str]) -> Any:
    """Return what stands at ``path``, None where nothing does. Raises ``ValueError`` where the way there is none."""
    found: Any = result
    for key in path:
        if found is None:
            return None
        if not isinstance(found, Mapping):
            raise ValueError(f"what should hold '{key}' is no object")
        found = found.get(key)
    return found


def _object(result: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return the object ``result[key]``, an empty one where there is none."""
    found = result.get(key)
    if found is None:
        return {}
    if not isinstance(found, Mapping):
        raise ValueError(f"'{key}' is no object")
    return found


def _summary(rows: Sequence[Row]) -> Iterator[Row]:
    for set_, name in dict.fromkeys((row["set"], row["score"]) for row in rows):
        specimens: dict[str, list[float]] = {}
        for row in rows:
            if (row["set"], row["score"]) == (set_, name) and row["value"] is not None:
                specimens.setdefault(row["specimen"], []).append(row["value"])
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


def _paired(first: Sequence[Told], second: Sequence[Told]) -> Iterator[Row]:
    pairs = list(_pairs(first, second))
    if not pairs:
        raise EndoctError(
            "no comparison of the one set has its like in the other",
            found=f"{first[0].folder.name} and {second[0].folder.name}",
            expected="the same recordings, or folders of the same names",
        )
    for name, path in SCORES.items():
        values = [(_at(one.result, path), _at(two.result, path)) for one, two in pairs]
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


def _pairs(first: Sequence[Told], second: Sequence[Told]) -> Iterator[tuple[Told, Told]]:
    by_inputs = {two.inputs: two for two in second if two.inputs}
    by_name = {two.folder.name: two for two in second}
    if len(by_inputs) < len(second):  # several of one recording: only names tell which is meant
        by_inputs = {}
    for one in first:
        two = by_inputs.get(one.inputs) or by_name.get(one.folder.name)
        if two is not None:
            yield one, two


def _repeatability(rows: Sequence[Row]) -> Iterator[Row]:
    for set_, name in dict.fromkeys((row["set"], row["score"]) for row in rows):
        specimens: dict[str, list[float]] = {}
        for row in rows:
            if (row["set"], row["score"]) == (set_, name) and row["value"] is not None and name != "aligned":
                specimens.setdefault(row["specimen"], []).append(row["value"])
        found = repeatability(list(specimens.values()))
        if found is not None:
            yield {"set": set_, "score": name, **found}
