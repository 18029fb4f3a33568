"""Poses in a table: a row each, and the two sides' agreement over those that were told."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.pose.paired import limits_of_agreement
from endoct.workbench import summarise
from endoct.workbench.cli import main
from endoct.workbench.pipeline.summarising_poses import EQUIVALENT_MM

APART_MM = (0.10, -0.05, 0.02, 0.07, 0.01)


def estimate(value: float) -> dict[str, float]:
    return {"value": value, "low": value - 0.1, "high": value + 0.1}


def a_pose(folder: Path, apart_mm: float | None, *, told: bool = True) -> Path:
    """Write what `endoct pose` says of a bore whose two sides lie ``apart_mm`` along x."""
    at = {"distance_mm": estimate(0.5)}
    off = {"distance_mm": estimate(abs(apart_mm or 0)), "across_mm": [apart_mm, 0.0]}
    nerve = {"name": "facial nerve", "distance_mm": estimate(0.9), "margin_mm": 0.8}
    pose = {
        **{"at_entry": at, "at_target": at, "beyond_target": at, "angle_deg": estimate(1.0), "structures": [nerve]},
        "by_side": {"oct": {"last_row": {"depth_mm": estimate(28.0)}}},
    }
    said: dict[str, Any] = {
        "sides": ["oct"] if apart_mm is None else ["oct", "endoscope"],
        "told": told,
        "reason": None if told else "no pose stands out",
        "doubt_codes": [] if apart_mm is not None else ["handedness-open", "wide-ellipse"],
        "pose": pose if told else None,
        "difference": None
        if apart_mm is None
        else {"of": ["oct", "endoscope"], "at_entry": off, "at_target": off, "angle_deg": estimate(0.2)},
    }
    folder.mkdir()
    (folder / "pose.json").write_text(json.dumps(said), encoding="utf-8")
    return folder


def test_a_row_a_pose_and_the_agreement_of_those_that_were_told(tmp_path: Path) -> None:
    folders = [a_pose(tmp_path / f"bore-{number}", apart) for number, apart in enumerate(APART_MM)]
    folders += [a_pose(tmp_path / "untold", 9.0, told=False), a_pose(tmp_path / "alone", None)]
    tables = summarise(folders, tmp_path / "out")
    rows = {Path(str(row["pose"])).name: row for row in tables["poses"]}
    assert len(rows) == len(folders)
    assert (rows["untold"]["told"], rows["untold"]["reason"]) == (0.0, "no pose stands out")
    assert rows["untold"]["offset_at_target_mm"] is None
    assert (rows["alone"]["doubts"], rows["bore-0"]["doubts"]) == ("handedness-open wide-ellipse", "")
    assert rows["alone"]["difference_at_target_mm"] is None
    assert rows["bore-0"]["facial_nerve_margin_mm"] == 0.8
    assert rows["bore-1"]["difference_at_target_x_mm"] == APART_MM[1]
    along_x = next(row for row in tables["agreement"] if (row["place"], row["direction"]) == ("at_target", "x"))
    expected = limits_of_agreement(np.array(APART_MM))
    assert (along_x["bores"], along_x["bias_mm"]) == (len(APART_MM), expected.bias)
    assert (along_x["low_mm"], along_x["low_mm_high"]) == (expected.low, expected.low_interval[1])
    assert (along_x["bound_mm"], along_x["equivalent"]) == (EQUIVALENT_MM, 1.0)
    with (tmp_path / "out" / "poses.csv").open(encoding="utf-8") as file:
        assert [row["pose"] for row in csv.DictReader(file)] == [str(folder) for folder in folders]
    assert set(json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))) == {"poses", "agreement"}


def test_two_bores_agree_on_nothing_yet(tmp_path: Path) -> None:
    tables = summarise([a_pose(tmp_path / "a", 0.1), a_pose(tmp_path / "b", 0.2)])
    assert tables["agreement"] == []


def test_poses_are_summarised_with_poses_only(tmp_path: Path) -> None:
    pose, other, broken = a_pose(tmp_path / "pose", 0.1), tmp_path / "other", tmp_path / "broken"
    other.mkdir()
    broken.mkdir()
    (broken / "pose.json").write_text('{"told": true, "sides": []}', encoding="utf-8")
    with pytest.raises(EndoctError, match=r"with poses only.*other without pose\.json"):
        summarise([pose, other])
    with pytest.raises(EndoctError, match="broken is no pose"):
        summarise([pose, broken])
    with pytest.raises(EndoctError, match="one by one"):
        summarise([pose], repeats=True)


def test_the_command_says_a_line_a_pose(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [a_pose(Path(f"bore-{number}"), apart) for number, apart in enumerate(APART_MM)]
    a_pose(Path("untold"), None, told=False)
    monkeypatch.setattr("sys.argv", ["endoct", "summarise", *map(str, folders), "untold", "-o", "out"])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr().out
    assert ended.value.code == 0
    assert "bore-0: 0.50 (0.40 to 0.60) mm off its plan at the target" in printed
    assert "untold: not told" in printed
    assert "oct less endoscope, at_target, x: bias 0.03 mm" in printed
    assert "(5 bores), equivalent within ±0.3 mm" in printed
