"""`endoct pose --plan-only`: exit statuses, what is said and written, the same in both conventions."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pose_case import PoseCase, text

import endoct.fusion.pose.outlook as rehearsals
from endoct.base.errors import EndoctError
from endoct.workbench import pose_outlook, verify

Command = Callable[..., tuple[int, list[str], str]]


@pytest.fixture(autouse=True)
def one_rehearsal(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of each instrument is enough to see what is done with it."""
    monkeypatch.setattr(rehearsals, "REHEARSALS", 1)


def plan_of(case: PoseCase) -> list[str]:
    return [f"--entry={text(case.plan.entry_mm)}", f"--target={text(case.plan.target_mm)}"]


def test_a_good_pattern_is_0_and_says_how_well(command: Command, files: Path, case: PoseCase, tmp_path: Path) -> None:
    out = tmp_path / "out"
    status, errors, printed = command("--plan-only", "--ct", files / "ct.nrrd", *plan_of(case), "-o", out)
    assert (status, errors) == (0, [])
    assert printed.startswith("could be told well, because 1 of 1 rehearsals by depth were told")
    assert len(printed.splitlines()) >= 2
    said = json.loads((out / "outlook.json").read_text(encoding="utf-8"))
    assert said["level"] == "well"
    assert said["instruments"]["depth"]["largest_error_mm"] < 0.4
    assert said["wall"]["cells"] > 2
    assert {path.name for path in out.iterdir()} == {
        "outlook.json", "report.html", "figures", "plan.mrk.json", "endoct-output.json",
    }  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "The bore could be told well." in page
    assert page.count('<img src="data:image/') == 1
    assert verify(out)


@pytest.mark.slow
def test_ras_and_lps_and_a_second_time_are_the_same(case: PoseCase, files: Path, tmp_path: Path) -> None:
    plan: dict[str, Any] = {"entry_mm": case.plan.entry_mm, "target_mm": case.plan.target_mm, "progress": False}
    one = pose_outlook(files / "ct.nrrd", **plan).to_json()
    again = pose_outlook(files / "ct.nrrd", **plan).to_json()
    assert {**one, "seconds": None} == {**again, "seconds": None}
    turned = case.write_ct(tmp_path / "turned.nii.gz", turned=True)
    entry, target = ((-x, -y, z) for x, y, z in (case.plan.entry_mm, case.plan.target_mm))
    other = pose_outlook(turned, entry_mm=entry, target_mm=target, progress=False).to_json()
    assert (one["coordinates"], other["coordinates"]) == ("lps", "ras")
    assert (one["level"], one["wall"]["cells"]) == (other["level"], other["wall"]["cells"])
    for name in ("depth", "cells"):
        (a,), (b,) = one["instruments"][name]["rehearsals"], other["instruments"][name]["rehearsals"]
        assert a["error_mm"] == pytest.approx(b["error_mm"], abs=5e-3)


def test_solid_bone_is_3(command: Command, case: PoseCase, tmp_path: Path) -> None:
    solid = PoseCase(case.seed, case.plan, case.to_lps)
    solid.__dict__["air"] = np.zeros_like(case.air)
    solid.air[:2] = 1  # outside of the bone, far from the plan
    ct = solid.write_ct(tmp_path / "solid.nrrd")
    status, errors, printed = command("--plan-only", "--ct", ct, *plan_of(case), "-o", tmp_path / "o", "--json")
    assert (status, errors) == (3, [])
    said = json.loads(printed)
    assert said["level"] == "hardly"
    assert (said["wall"]["cells"], said["wall"]["likeness"]) == (0, None)
    assert (tmp_path / "o" / "report.html").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{camera}", "--plan-only", "--ct", "{ct}", "{plan}"], "with --plan-only there is no recording; found a side"),
        (["--plan-only", "--ct", "{ct}", "{plan}", "--labels", "{ct}"], "found --labels"),
        (["--ct", "{ct}", "{plan}"], "name a recording, or ask before there is one with --plan-only"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--seen", "5"], "found --seen"),
        (["--plan-only", "--ct", "{ct}", "{plan}", "--seen", "50"], "so much of the bore cannot be seen"),
        (["--plan-only", "--ct", "{ct}", "{plan}", "--radius", "0"], "there is no such bore"),
        (["--plan-only", "--ct", "{ct}", "{plan}", "--radius", "5.1"], "found a radius of 5.1 mm; expected 0.3 to 5"),
        (["--plan-only", "--ct", "{ct}"], "not said where the bore was planned"),
    ],
)
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    command: Command, files: Path, case: PoseCase, tmp_path: Path, words: list[str], message: str
) -> None:
    paths = {"camera": files / "camera.zarr", "ct": files / "ct.nrrd"}
    said = [part for word in words for part in (plan_of(case) if word == "{plan}" else [word.format(**paths)])]
    status, errors, _ = command(*said, "-o", tmp_path / "out")
    assert (status, len(errors)) == (1, 1)
    assert message in errors[0]
    assert not (tmp_path / "out").exists()


def test_an_existing_output_is_kept(case: PoseCase, files: Path) -> None:
    with pytest.raises(EndoctError, match="is or contains the input"):
        pose_outlook(
            files / "ct.nrrd", files, entry_mm=case.plan.entry_mm, target_mm=case.plan.target_mm, progress=False
        )
