"""A plan as markups of 3D Slicer: which point is the entry, in which convention, in every version's way of writing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.ct.stored import SIGNS
from endoct.modalities.ct.trajectory import Trajectory, read_line, write_line

PLAN = Trajectory((31.5, -20.25, 14.0), (12.0, -4.5, 21.75))


def markups(path: Path, system: str, **markup: Any) -> Path:
    points = [
        {"id": "1", "label": "F-1", "position": np.multiply(SIGNS[system.lower()], PLAN.entry_mm).tolist()},
        {"id": "2", "label": "F-2", "position": np.multiply(SIGNS[system.lower()], PLAN.target_mm).tolist()},
    ]
    usual = {"type": "Line", "coordinateSystem": system, "controlPoints": points}
    path.write_text(json.dumps({"markups": [usual | markup]}), encoding="utf-8")
    return path


def test_a_line_comes_back(tmp_path: Path) -> None:
    write_line(PLAN, "plan", tmp_path / "plan.mrk.json")
    assert read_line(tmp_path / "plan.mrk.json") == (PLAN, "lps")


def labelled(path: Path, first: str, second: str) -> Path:
    markups(path, "LPS", type="Fiducial")
    document = json.loads(path.read_text(encoding="utf-8"))
    for point, label in zip(document["markups"][0]["controlPoints"], (first, second), strict=True):
        point["label"] = label
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Target", " entry"), ("Target point", "Entry point"), ("T", "E"), ("T-1", "E-1"), ("target_2", "entry_1"),
        ("TargetPoint", "EntryPoint"), ("TARGET", "ENTRY"), ("TP", "EP"), ("target1", "entry2"), ("end", "start"),
    ],
)  # fmt: skip
def test_labels_decide_which_point_is_which(tmp_path: Path, first: str, second: str) -> None:
    turned = read_line(labelled(tmp_path / "a.mrk.json", first, second))[0]
    straight = read_line(labelled(tmp_path / "b.mrk.json", second, first))[0]
    assert (turned.entry_mm, turned.target_mm) == (PLAN.target_mm, PLAN.entry_mm)
    assert straight == PLAN
    assert turned.note == straight.note == ""


@pytest.mark.parametrize(("first", "second"), [("T", "F-2"), ("F-1", "entry"), ("entry to target", "entry")])
def test_one_label_says_what_the_other_point_is(tmp_path: Path, first: str, second: str) -> None:
    turned = read_line(labelled(tmp_path / "a.mrk.json", first, second))[0]
    straight = read_line(labelled(tmp_path / "b.mrk.json", second, first))[0]
    assert (turned.entry_mm, straight.entry_mm) == (PLAN.target_mm, PLAN.entry_mm)
    assert "one label alone" in turned.note
    assert "one label alone" in straight.note


@pytest.mark.parametrize(
    "labels", [("F-1", "F-2"), ("", ""), ("Endoscope 1", "Tool 2"), ("entry-target-1", "entry-target-2")]
)
def test_without_labels_the_order_counts_and_is_said(tmp_path: Path, labels: tuple[str, str]) -> None:
    path = labelled(tmp_path / "plan.mrk.json", *labels)
    line = read_line(path)[0]
    assert line == PLAN
    assert line.note.startswith("No label in plan.mrk.json says which point is the entry")


@pytest.mark.parametrize("labels", [("T", "Target"), ("entry-1", "entry-2")])
def test_two_points_of_one_name_are_refused(tmp_path: Path, labels: tuple[str, str]) -> None:
    with pytest.raises(EndoctError, match=r"both points of .* by their labels"):
        read_line(labelled(tmp_path / "plan.mrk.json", *labels))


@pytest.mark.parametrize(
    ("markup", "message"),
    [
        ({"coordinateSystem": "IJK"}, "RAS or LPS"),
        ({"coordinateSystem": None}, "RAS or LPS"),
        ({"coordinateSystem": ["LPS"]}, "RAS or LPS"),
        ({"type": "Plane"}, "holds no trajectory"),
        ({"controlPoints": []}, "holds no trajectory"),
        ({"controlPoints": 3}, "expected a list"),
        ({"controlPoints": [{"position": [1, 2, 3]}, {"position": [1, 2]}]}, "has no place"),
        ({"controlPoints": [{"position": [1, 2, 3]}, {"position": [1, 2, float("nan")]}]}, "has no place"),
        ({"controlPoints": [{"position": [1, 2, 3]}, {"position": [1, 2, "x"]}]}, "has no place"),
        ({"controlPoints": [{"position": [1, 2, 3]}, {"position": [1, 2, 3]}]}, "the same place"),
        ({"coordinateUnits": ["mm", "mm", "s"]}, "not in mm"),
    ],
)
def test_what_is_no_line_is_refused(tmp_path: Path, markup: dict[str, Any], message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        read_line(markups(tmp_path / "plan.mrk.json", "LPS", **markup))


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"markups": 1}', '{"markups": []}', '{"markups": [1]}'])
def test_what_are_no_markups_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "plan.mrk.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(EndoctError):
        read_line(path)


def test_a_list_of_slicer_4_whose_points_are_turned_is_read(tmp_path: Path) -> None:
    path = fcsv(tmp_path / "plan.fcsv", "LPS")
    path.write_text(path.read_text(encoding="utf-8").replace(",0,0,0,1,1,1,0,", ",90,0,0.6,0.8,1,1,0,"))
    assert np.allclose(read_line(path)[0].entry_mm, PLAN.entry_mm)


def test_a_missing_number_shows_in_the_columns_of_switches(tmp_path: Path) -> None:
    path = fcsv(tmp_path / "plan.fcsv", "LPS", entry="1,2")
    path.write_text(path.read_text(encoding="utf-8").replace(",0,0,0,1,1,1,0,", ",1,0,0,0,1,1,0,"))
    with pytest.raises(EndoctError, match="has no place"):
        read_line(path)


FCSV = """# Markups fiducial file version = {version}
# CoordinateSystem = {system}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,{entry},0,0,0,1,1,1,0,{first},,{more}
2,{target},0,0,0,1,1,1,0,"F, 2",,{more}
"""


def fcsv(path: Path, system: str, **fields: str) -> Path:
    signs = SIGNS["ras" if system in ("RAS", "0") else "lps"]
    ends = [",".join(map(repr, np.multiply(signs, end).tolist())) for end in (PLAN.entry_mm, PLAN.target_mm)]
    usual = {"version": "4.11", "entry": ends[0], "target": ends[1], "first": "F-1", "more": "", "system": system}
    path.write_text(FCSV.format(**(usual | fields)), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("version", "system", "more"),
    [("4.4", "0", ""), ("4.10", "1", ""), ("4.11", "LPS", ""), ("5.4", "RAS", ",2,0"), ("5.0", "LPS", ",2")],
)
def test_a_list_of_any_slicer_is_the_same_plan(tmp_path: Path, version: str, system: str, more: str) -> None:
    path = fcsv(tmp_path / "plan.fcsv", system, version=version, more=more)
    line, convention = read_line(path)
    assert convention == ("ras" if system in ("RAS", "0") else "lps")
    assert np.allclose([line.entry_mm, line.target_mm], [PLAN.entry_mm, PLAN.target_mm])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read_line(path) == (line, convention)
    turned = fcsv(tmp_path / "plan.fcsv", system, first="target").read_text(encoding="utf-8")
    path.write_text(turned.replace('"F, 2"', "entry"), encoding="utf-8")
    assert np.allclose(read_line(path)[0].entry_mm, PLAN.target_mm)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"system": "2"}, "RAS or LPS"),
        ({"system": ""}, "RAS or LPS"),
        ({"entry": "1,2"}, "has no place"),
        ({"entry": "1,2,nan"}, "has no place"),
        ({"version": "5.4", "more": ",0,2"}, "the entry of .* is not placed"),
        ({"version": "5.4", "more": ",3,0"}, "the entry of .* is not placed"),
        ({"entry": "1,5,2,3"}, "has no place"),
        ({"entry": "1,2,3,4"}, "has no place"),
        ({"target": "1,2,3,0,0,0,1,1,1,0,F\n3,4,5,6"}, "3 points"),
    ],
)
def test_a_list_that_says_no_line_is_refused(tmp_path: Path, fields: dict[str, str], message: str) -> None:
    with pytest.raises(EndoctError, match=message):
        read_line(fcsv(tmp_path / "plan.fcsv", **({"system": "LPS"} | fields)))


@pytest.mark.parametrize("status", ["undefined", "preview", "missing", ""])
def test_a_point_that_nobody_placed_is_no_plan(tmp_path: Path, status: str) -> None:
    path = markups(tmp_path / "plan.mrk.json", "LPS")
    document = json.loads(path.read_text(encoding="utf-8"))
    document["markups"][0]["controlPoints"][1] |= {"position": [0, 0, 0], "positionStatus": status}
    path.write_text("\ufeff" + json.dumps(document), encoding="utf-8")
    with pytest.raises(EndoctError, match=r"the target of .* is not placed"):
        read_line(path)


def test_what_is_neither_is_said_to_be_neither(tmp_path: Path) -> None:
    (tmp_path / "plan.txt").write_text("1 2 3\n")
    with pytest.raises(EndoctError, match=r"is no JSON, and no \.fcsv"):
        read_line(tmp_path / "plan.txt")
