"""What a folder holds: recordings by their content, their pairs, and nothing of what endoct wrote."""

import os
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

import cv2
import numpy as np
import pytest

from benchmarks.ct_faults.drawn import drawn, named_slices
from benchmarks.ct_faults.writing import write_series
from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.modalities.recognition import recognise
from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.state import State
from endoct.workbench.desk.study import Input, Study, inputs_in
from endoct.workbench.pipeline.information import picture_of
from endoct.workbench.pipeline.unread import Unread


def looked_through(folder: Path) -> Study:
    study = Study(folder)
    study.look()
    for _ in range(1200):
        if not study.to_json()["looking"]:
            return study
        time.sleep(0.1)
    pytest.fail("it never ends")


def test_a_result_names_recordings_from_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    study = Study(tmp_path)
    names = ("oct", "bore-1/oct", "bore-1/endoscope")
    given = {name: Input(name, study.folder / name, "recording") for name in names}
    monkeypatch.setattr(study, "inputs", lambda: list(given.values()))
    result = study.folder / "bore-1" / "result"
    for files, expected in (
        (["oct/*"], ["oct"]),  # the page's commands run in the folder that is open, whatever else has that name
        (["endoscope/a.png"], ["bore-1/endoscope"]),
        ([f"{study.folder.name}/bore-1/oct/*", "elsewhere/endoscope/*"], ["bore-1/oct"]),
        ([str(study.folder / "bore-1" / "oct" / "*")], ["bore-1/oct"]),
        (["other/oct/*"], []),
    ):
        assert [each.name for each in study.named_by(files, result)] == expected
    assert study.input_of("oct", result) == given["oct"]
    assert study.input_of("endoscope", result) == given["bore-1/endoscope"]
    assert study.input_of("other", result) is None


def test_recordings_are_found_with_what_they_lack(study: Path):
    (study / "bore-1" / "oct" / "acquisition.toml").unlink()
    (study / "notes.txt").write_text("not a recording")
    (study / "photo.png").write_bytes(b"no picture either")
    (study / "empty").mkdir()
    (study / "away").symlink_to("/")
    found = {each.name: each for each in looked_through(study).inputs()}
    assert set(found) == {"bore-1/endoscope", "bore-1/oct"}
    assert found["bore-1/endoscope"].modality == "endoscope"
    assert set(found["bore-1/oct"].facts["missing"]) >= {"axial_pixel_mm", "bore_diameter_mm"}


def test_a_pair_is_one_of_each_alone_in_a_folder(study: Path):
    shutil.copytree(study / "bore-1", study / "bore-2")
    shutil.copytree(study / "bore-1", study / "bore-3")
    shutil.copytree(study / "bore-3" / "oct", study / "bore-3" / "oct-again")
    pairs = [(a.name, b.name) for a, b in looked_through(study).pairs()]
    assert pairs == [("bore-1/endoscope", "bore-1/oct"), ("bore-2/endoscope", "bore-2/oct")]


def test_a_broken_recording_says_why(study: Path):
    (study / "bore-1" / "oct" / "acquisition.toml").write_text("modality = oct")
    fault = next(each.fault for each in looked_through(study).inputs() if each.name == "bore-1/oct")
    assert "not valid TOML" in fault


def test_single_files_are_known_by_their_content(study: Path):
    loose = study / "loose"
    loose.mkdir()
    for name in ("first.dat", "second.dat"):
        shutil.copy(study / "bore-1" / "oct" / "pullback.tif", loose / name)
    (loose / "notes.dat").write_text("not a recording")
    names = sorted(each.name for each in inputs_in(study, Unread()))
    assert names == ["bore-1/endoscope", "bore-1/oct", "loose/first.dat", "loose/second.dat"]


def test_what_endoct_wrote_is_no_input(study: Path, quick_specimen: Path):
    shutil.copytree(quick_specimen, study / "specimen")
    names = [each.name for each in inputs_in(study, Unread())]
    assert sorted(names) == ["bore-1/endoscope", "bore-1/oct", "specimen/endoscope", "specimen/oct"]


def test_the_folder_itself_may_be_the_recording(study: Path):
    assert [each.name for each in inputs_in(study / "bore-1" / "oct", Unread())] == ["."]
    assert Study(study / "bore-1" / "oct").input(".").modality == "oct"


def test_a_recording_is_found_by_its_name_before_the_folder_is_looked_through(study: Path):
    found = Study(study)
    assert found.input("bore-1/oct").modality == "oct"
    (study / "link").symlink_to(study.parent)
    for name in ("../my study/bore-1/oct", "bore-1", "/etc", "link/state", ""):
        with pytest.raises(EndoctError):
            found.input(name)


def test_what_a_changed_sidecar_says_is_seen(study: Path):
    found = looked_through(study)
    sidecar = study / "bore-1" / "oct" / "acquisition.toml"
    kept = [line for line in sidecar.read_text().splitlines() if not line.startswith("bore_diameter_mm")]
    sidecar.write_text("\n".join(kept))
    assert "bore_diameter_mm" in found.renew("bore-1/oct").facts["missing"]
    assert "bore_diameter_mm" in found.input("bore-1/oct").facts["missing"]


def test_a_recording_has_a_picture(study: Path):
    assert picture_of(recognise(study / "bore-1" / "endoscope")).startswith(b"\x89PNG")


def test_the_state_is_its_users_alone(tmp_path: Path):
    state = State(tmp_path / "state")
    token = state.token
    assert token == State(tmp_path / "state").token
    assert len(token) == 32
    for folder in (tmp_path, tmp_path / "state"):
        state.remember(folder)
    assert [each.folder for each in state.recent()] == [tmp_path / "state", tmp_path]
    page = state.address_file("http://127.0.0.1:1/x/")
    assert "http://127.0.0.1:1/x/" in page.read_text()
    for path in (tmp_path / "state").iterdir():
        assert path.stat().st_mode & 0o077 == 0
    (tmp_path / "state" / "recent.json").write_text("no JSON")
    (tmp_path / "state" / "token").write_text("short")
    assert state.recent() == []
    assert len(State(tmp_path / "state").token) == 32


def test_a_folder_that_cannot_be_seen_now_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    state, folders = State(tmp_path / "state"), [tmp_path / "away", tmp_path / "here"]
    for folder in folders:
        folder.mkdir()
        state.remember(folder)

    def is_seen(path: Path) -> bool:
        if path == folders[0]:
            raise PermissionError(13, "Permission denied", str(path))
        return True

    with monkeypatch.context() as hidden:
        hidden.setattr(Path, "is_dir", is_seen)
        assert [each.folder for each in state.recent()] == [folders[1]]
        state.remember(folders[1])
    assert [each.folder for each in state.recent()] == [folders[1], folders[0]]


def test_no_folder_is_looked_through_once_the_program_has_ended(study: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("threading.main_thread", threading.Thread)  # one that is not alive
    found = looked_through(study)
    assert (found.inputs(), "the program has ended" in found.to_json()["fault"]) == ((), True)


def test_what_is_odd_in_a_folder_hides_nothing_else(study: Path):
    (study / "itself").symlink_to(study / "itself")
    (study / "elsewhere.tif").symlink_to("/etc/hostname")
    os.mkdir(os.fsencode(study) + b"/d\xe9")  # noqa: PTH102 - no text names it
    found = looked_through(study)
    assert [each.name for each in found.inputs()] == ["bore-1/endoscope", "bore-1/oct"]
    assert found.to_json()["fault"] == ""
    listed = Desk(State(study / "state"), {}).listed(str(study))
    assert listed["names"] == ["bore-1", "state"]


def test_a_folder_is_remembered_by_several_at_once(tmp_path: Path):
    state = State(tmp_path / "state")
    desk = Desk(state, {})
    folders = [tmp_path / f"study-{k}" for k in range(8)]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(desk.open, folders))
    assert {each.folder for each in state.recent()} == set(folders)
    assert not [path for path in (tmp_path / "state").iterdir() if path.name.startswith(".")]


def test_files_that_nothing_reads_are_listed_with_their_reason(study: Path):
    (study / "notes.txt").write_text("not a recording")
    (study / "photo.png").write_bytes(b"no picture either")
    (study / "film.wmv").write_bytes(bytes.fromhex("3026b2758e66cf11") + bytes(40))
    (study / "bore-1" / "endoscope" / "setup.docx").write_bytes(b"PK")
    cv2.imwrite(str(study / "anna_1.png"), np.eye(8, dtype=np.uint8) * 255)  # a mask is for commands to name
    (study / "calibration.toml").write_text("")
    seal(study / "bore-1", "specimen")  # the list that is written with a specimen
    found = looked_through(study).to_json()
    assert found["unread"]["count"] == 3
    why = {each["name"]: each["why"] for each in found["unread"]["files"]}
    assert why["film.wmv"] == "a Windows Media video (ASF, WMV), which is not read"
    assert why["notes.txt"] == "15 bytes; expected PNG, JPEG, BMP or TIFF"
    assert set(why) == {"film.wmv", "notes.txt", "photo.png"}
    endoscope = next(each for each in found["inputs"] if each["name"] == "bore-1/endoscope")
    assert [each["name"] for each in endoscope["facts"]["unread"]["files"]] == ["setup.docx"]


def test_of_many_files_the_first_are_listed(study: Path, monkeypatch: pytest.MonkeyPatch):
    for k in range(30):
        (study / f"{k:02d}.xyz").write_bytes(b"abc")
    unread = looked_through(study).to_json()["unread"]
    assert (unread["count"], [each["name"] for each in unread["files"]]) == (30, [f"{k:02d}.xyz" for k in range(20)])
    monkeypatch.setattr("endoct.workbench.desk.study.MOST_ASKED", 3)
    unread = looked_through(study).to_json()["unread"]
    assert [each["why"].partition(":")[0] for each in unread["files"][2:4]] == [
        "3 bytes; expected PNG, JPEG, BMP or TIFF",
        "not looked at",
    ]
    monkeypatch.setattr("endoct.workbench.desk.study.MOST_IN_FOLDER", 29)
    found = looked_through(study).to_json()
    assert found["unread"]["count"] == 30
    assert found["unread"]["files"][0]["why"] == "not looked at: 30 files lie in its folder, and no acquisition.toml"
    assert len(found["inputs"]) == 2  # in the folders below


def test_a_folder_of_ct_slices_is_one_volume(tmp_path: Path):
    write_series(tmp_path / "ct", named_slices(drawn(Random(1))))
    unread = Unread()
    assert [(each.name, each.kind) for each in inputs_in(tmp_path, unread)] == [("ct", "volume")]
    assert unread.count == 0
