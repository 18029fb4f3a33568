"""Many comparisons to one summary."""

import csv
import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import Bounded, Budget, BudgetPart, BudgetParts, Overlap, PairScores, Result, StoredAlignment
from endoct.workbench import cli, summarise
from endoct.workbench.pipeline.summarising import score_of


def write(folder: Path, jaccard: float | None, digest: str = "", **changed: Any) -> Path:
    folder.mkdir(parents=True)
    inputs = {str(folder / "x"): digest} if digest else {}
    (folder / "result.json").write_text(json.dumps(stored(jaccard) | {"inputs": inputs} | changed))
    return folder


def stored(jaccard: float | None) -> dict[str, Any]:
    """Return what a ``result.json`` holds, not aligned where there is no Jaccard index."""
    part = BudgetPart(share=0.1, interval=(0.05, 0.2))
    result = Result(
        sides=("endoscope", "oct"),
        aligned=jaccard is not None,
        alignment=None if jaccard is None else StoredAlignment.of(Alignment(0.1, 0.2, confidence=0.5)),
        jaccard=jaccard,
        dice=None,
        scores=None if jaccard is None else PairScores(grid=Overlap(jaccard_interval=(jaccard - 0.1, jaccard + 0.1))),
        budget=Budget(
            one_minus_jaccard=0.4,
            parts=BudgetParts(alignment=part, sampling=part, visibility=part, segmentation=part),
            alignment_known=True,
            not_visible={},
            not_covered={},
        ),
        valid_fraction=1.0,
    )
    return result.to_json()


def test_the_codes_of_doubts_are_a_column(tmp_path: Path) -> None:
    doubts = [
        Doubt(code, "Odd.", side).to_json() for code, side in (("wall-odd", "oct"), ("forced", None), ("wall-odd", "a"))
    ]
    folders = [write(tmp_path / "s0", 0.5, doubts=doubts), write(tmp_path / "s1", 0.6)]
    found = rows(summarise(folders, tmp_path / "out"), "scores", "jaccard")
    assert [row["doubts"] for row in found] == ["forced wall-odd", ""]


def test_the_indices_by_lis_threshold_are_rows_of_their_own(tmp_path: Path) -> None:
    overlaps = {
        name: {"jaccard": jaccard, "dice": jaccard + 0.1, "jaccard_interval": [jaccard - 0.1, jaccard + 0.1]}
        for name, jaccard in (("grid", 0.3), ("own_rows", 0.4))
    }
    overlaps["own_rows"] |= {"rows_of": "oct", "dice_interval": [0.45, 0.55]}
    scores = {"grid": {}, "by_li": {**overlaps, "threshold": {"oct": 0.03}}}
    tables = summarise([write(tmp_path / "with", 0.5, scores=scores), write(tmp_path / "older", 0.6)])
    expected = {
        "jaccard_by_li": (0.3, 0.2, 0.4),
        "dice_by_li": (0.4, None, None),
        "jaccard_by_li_own_rows": (0.4, 0.3, 0.5),
        "dice_by_li_own_rows": (0.5, 0.45, 0.55),
    }
    for name, row in expected.items():
        known, not_known = ([each[key] for key in ("value", "low", "high")] for each in rows(tables, "scores", name))
        assert known == pytest.approx(row)
        assert not_known == [None, None, None]


def test_every_score_has_its_own_interval(tmp_path: Path) -> None:
    def of(name: str, value: float, interval: str) -> dict[str, Any]:
        return {name: value, interval: [value - 0.25, value + 0.25]}

    counts = {"of_reference": 3, "of_other": 4}
    limits = {"pairs": 3, "low": 0.0, "high": 0.0, "sd": 0.0}
    scores = {
        "grid": of("jaccard", 0.5, "jaccard_interval") | of("dice", 0.75, "dice_interval"),
        "boundary": of("mean_mm", 1.0, "mean_interval_mm")
        | of("within_share", 1.25, "within_interval")
        | {"p95_mm": 1.5, "tolerance_mm": 0.1},
        "cells": counts
        | of("precision", 1.75, "precision_interval")
        | of("recall", 2.0, "recall_interval")
        | of("quality", 2.25, "quality_interval"),
        "area_mm2": limits | of("bias", 2.5, "bias_interval"),
        "depth_mm": limits | of("bias", 2.75, "bias_interval"),
    }
    tables = summarise([write(tmp_path / "with", 0.5, scores=scores)])
    with_interval = {
        "jaccard": 0.5, "dice": 0.75, "boundary_mean_mm": 1.0, "boundary_within_share": 1.25, "cell_precision": 1.75,
        "cell_recall": 2.0, "cell_quality": 2.25, "area_bias_mm2": 2.5, "depth_bias_mm": 2.75,
    }  # fmt: skip
    for name, value in with_interval.items():
        (row,) = rows(tables, "scores", name)
        assert (row["value"], row["low"], row["high"]) == (value, value - 0.25, value + 0.25), name
    bounds = SimpleNamespace(
        light=Bounded(of="oct", expected=0.9, low=0.8, high=0.95), depth=Bounded(of="oct", expected=0.7, low=0.6)
    )
    result = cast("Result", SimpleNamespace(bounds=bounds))
    assert score_of(result, "expected_light") == (0.9, (0.8, 0.95))
    assert score_of(result, "expected_depth") == (0.7, None)
    (p95,) = rows(tables, "scores", "boundary_p95_mm")
    assert (p95["value"], p95["low"]) == (1.5, None)


def rows(tables: dict[str, list[dict[str, Any]]], name: str, score: str) -> list[dict[str, Any]]:
    return [row for row in tables[name] if row["score"] == score]


def test_a_tidy_table_and_medians(tmp_path: Path) -> None:
    values = [0.5, 0.6, 0.7, 0.8, 0.9, None]
    tables = summarise([write(tmp_path / f"s{k}", v) for k, v in enumerate(values)], tmp_path / "out")
    with (tmp_path / "out" / "scores.csv").open() as file:
        stored = [row for row in csv.DictReader(file) if row["score"] == "jaccard"]
    assert [row["value"] for row in stored] == ["0.5", "0.6", "0.7", "0.8", "0.9", ""]
    assert float(stored[0]["low"]) == pytest.approx(0.4)
    (of_jaccard,) = rows(tables, "summary", "jaccard")
    assert of_jaccard["specimens"] == 5
    assert of_jaccard["value"] == pytest.approx(0.7)
    assert 0.5 <= of_jaccard["low"] < 0.7 < of_jaccard["high"] <= 0.9
    (aligned,) = rows(tables, "summary", "aligned")
    assert aligned["value"] == pytest.approx(5 / 6)
    assert rows(tables, "summary", "lost_to_sampling")[0]["specimens"] == 6
    assert tables["paired"] == tables["repeatability"] == []
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"scores.csv", "summary.csv", "summary.json"}


def test_pairs_by_recording_whatever_the_folder_is_called(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = rng.uniform(0.4, 0.8, 12)
    first = [write(tmp_path / "a" / f"{k}", v, f"d{k}") for k, v in enumerate(values)]
    second = [write(tmp_path / "b" / f"other{11 - k}", v + 0.05, f"d{k}") for k, v in enumerate(values)]
    (paired,) = rows(summarise(first, against=second[::-1]), "paired", "jaccard")
    assert paired["pairs"] == paired["second_higher"] == 12
    assert paired["median_difference"] == pytest.approx(0.05)
    assert (paired["low"], paired["high"]) == pytest.approx((0.05, 0.05))


def test_masks_given_as_truth_part_no_pairs(tmp_path: Path) -> None:
    inputs = {"bore/oct/pullback.tif": "d0", "bore/truth/*": "t0", "drawn/anna_1.png": "t1"}
    truth = {"bore/truth": {}, "drawn/anna_1.png": {}}
    first = write(tmp_path / "judged", 0.5, inputs=inputs, truth=truth)
    second = write(tmp_path / "plain", 0.4, inputs={"bore/oct/pullback.tif": "d0"})
    (paired,) = rows(summarise([first], against=[second]), "paired", "jaccard")
    assert paired["pairs"] == 1


def test_pairs_by_name_where_digests_do_not_tell(tmp_path: Path) -> None:
    first = [write(tmp_path / "a" / str(k), 0.5) for k in range(3)]
    second = [write(tmp_path / "b" / str(k), 0.4) for k in (1, 2, 7)]
    (paired,) = rows(summarise(first, against=second), "paired", "jaccard")
    assert (paired["pairs"], paired["second_lower"]) == (2, 2)
    with pytest.raises(EndoctError, match="has its like in the other"):
        summarise(first, against=second[2:])


def test_repeats_are_of_the_folder_they_lie_in(tmp_path: Path) -> None:
    folders = [write(tmp_path / s / r, j) for s, r, j in (("s1", "a", 0.5), ("s1", "b", 0.6), ("s2", "a", 0.9))]
    tables = summarise(folders, repeats=True)
    (found,) = rows(tables, "repeatability", "jaccard")
    assert (found["specimens"], found["comparisons"]) == (2, 3)
    assert found["within_sd"] == pytest.approx(0.1 / np.sqrt(2))
    assert rows(tables, "summary", "jaccard")[0]["value"] == pytest.approx(np.median([0.55, 0.9]))


def test_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [write(tmp_path / f"s{k}", 0.5 + 0.01 * k) for k in range(6)]
    monkeypatch.setattr(sys, "argv", ["endoct", "summarise", *map(str, folders), "-o", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert leave.value.code == 0
    assert "jaccard" in capsys.readouterr().out
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert leave.value.code == 1
    assert "exists" in capsys.readouterr().err


def test_what_is_no_comparison(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    for content in (None, "[]", "{", "{}"):
        if content is not None:
            (tmp_path / "x" / "result.json").write_text(content)
        with pytest.raises(EndoctError, match="is no comparison"):
            summarise([tmp_path / "x"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "x" / "result.json").unlink()
    os.mkfifo(tmp_path / "x" / "result.json")
    with pytest.raises(EndoctError, match="a pipe"):
        summarise([tmp_path / "x"])
    with pytest.raises(EndoctError, match="nothing to summarise"):
        summarise([])


def _damaged() -> dict[str, str]:
    """Return texts of a ``result.json`` that is no result, by what is wrong with them."""
    sound = stored(0.5) | {"inputs": {"x": "d"}}
    put = {
        "aligned that is a word": {"aligned": "yes"},
        "aligned that is null": {"aligned": None},
        "a score that is a text": {"jaccard": "0.5"},
        "a score that is a formula": {"jaccard": "=1+1"},
        "a score that is a truth value": {"dice": True},
        "a score that is an object": {"dice": {}},
        "a score that is a list": {"valid_fraction": [1]},
        "a score that is not finite": {"jaccard": float("nan")},
        "a score beyond all": {"jaccard": float("-inf")},
        "a score whose square is beyond all": {"jaccard": 1e300},
        "a score of 400 digits": {"jaccard": 10**400},
        "scores that are a list": {"scores": [1]},
        "scores that are a number": {"scores": 7},
        "scores of rows that are a text": {"scores": {"own_rows": "x"}},
        "a budget that is a text": {"budget": {"parts": "x"}},
        "an interval that is a number": {"scores": {"grid": {"jaccard_interval": 1}}},
        "an interval that is an object": {"scores": {"grid": {"jaccard_interval": {"0": 1}}}},
        "an interval of one": {"scores": {"grid": {"jaccard_interval": [1]}}},
        "an interval of texts": {"scores": {"grid": {"jaccard_interval": ["a", "b"]}}},
        "an empty interval": {"scores": {"grid": {"jaccard_interval": []}}},
        "an alignment that is a text": {"alignment": "x"},
        "inputs that are a list": {"inputs": ["d"]},
        "digests that are lists": {"inputs": {"x": ["d"]}},
        "digests that are numbers": {"inputs": {"x": 1}},
        "truth that is a list": {"truth": [1]},
        "truth that is a number": {"truth": 3},
    }
    return {
        "nesting": "[" * 100_000 + "]" * 100_000,
        "nesting of objects": '{"aligned":' * 100_000,
        "a number of 5000 digits": json.dumps(sound).replace('"jaccard": 0.5', '"jaccard": ' + "1" * 5000),
        "no text": "\x00\x01",
        "a number": "1",
        **{what: json.dumps(sound | changed) for what, changed in put.items()},
    }


@pytest.mark.parametrize("what", _damaged())
def test_a_damaged_result_is_told_in_one_line(tmp_path: Path, what: str) -> None:
    sound = write(tmp_path / "sound", 0.5, "d")
    damaged = write(tmp_path / "damaged", 0.5, "d")
    (damaged / "result.json").write_text(_damaged()[what])
    for first, second in (([sound, damaged], []), ([sound], [damaged])):
        with pytest.raises(EndoctError, match=r"damaged is no comparison; found [^\n]+$") as told:
            summarise(first, against=second)
        assert len(str(told.value)) < 700


def test_a_result_that_is_no_result_by_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.fusion.files.result_file.MOST_BYTES", 1000)
    damaged = write(tmp_path / "damaged", 0.5, more="x" * 2000)
    with pytest.raises(EndoctError, match=r"damaged is no comparison; found more than 0\.001 MB"):
        summarise([damaged])


def test_what_was_not_scored_may_be_missing_or_null(tmp_path: Path) -> None:
    null = {"scores": {"own_rows": {"rows_of": "oct", "jaccard": None}}, "budget": None, "truth": None}
    tables = summarise([write(tmp_path / "a", 0.5, **null), write(tmp_path / "b", None, scores=None)])
    assert rows(tables, "summary", "jaccard")[0]["specimens"] == 1
