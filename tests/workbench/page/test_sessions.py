"""Landmarks over the server: judged as on the command line, saved into one file, and anything else is refused."""

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from workbench_page import PAIR, Served, application, post, written

from endoct.base.files.contents import NAME as LIST_NAME
from endoct.base.files.contents import seal
from endoct.fusion.files.session import Note, Session, read_session, session_from
from endoct.fusion.geometry.alignment import Place
from endoct.workbench import verify
from endoct.workbench.page.opening import open_shown

NOTE = {"side": "b", "place": {"theta_rad": 6.2, "z_mm": 0.7}, "text": "glare <b>"}
CHECK = {**PAIR, "a": {"theta_rad": 0.1, "z_mm": 0.7}, "b": {"theta_rad": 6.2, "z_mm": 0.7}, "role": "check"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path / "specimen-8")


def test_pairs_are_judged_as_shown_and_as_corrected(served: Served):
    status, text = post(served, "/landmarks.json", {"pairs": [PAIR, CHECK]})
    assert status == 200
    judged = json.loads(text)
    radius_mm = 1.25
    now = judged["present"]["each"]
    assert now[0]["around_mm"] == pytest.approx(0.1 * radius_mm)
    assert now[0]["along_mm"] == pytest.approx(-0.1)
    over_seam_mm = (6.2 - 0.1 - 2 * np.pi) * radius_mm
    assert now[1]["around_mm"] == pytest.approx(over_seam_mm)
    assert judged["present"]["check"]["median_mm"] == pytest.approx(abs(over_seam_mm))
    by_hand = judged["by_hand"]
    assert by_hand["pairs"][0]["after"]["distance_mm"] == pytest.approx(0, abs=1e-9)
    assert by_hand["check"]["median_mm"] == pytest.approx(np.hypot(over_seam_mm - 0.125, 0.1))
    assert by_hand["moved"]["along_mm"] == pytest.approx(0.1)
    assert judged["said"] == []


def test_a_session_is_saved_loaded_and_saved_again(folder: Path):
    with application(folder) as served:
        before = json.loads(served.get("/session.json")[1])
        assert (before["pairs"], before["saved"], before["refused"]) == ([], None, "")
        assert f"--session {folder}/session.json" in before["command"]
        status, text = post(served, "/session.json", {"pairs": [PAIR], "based_on": None})
        assert status == 200
        assert read_session(folder / "session.json").pairs[0].name == "rim"
        again = json.loads(served.get("/session.json")[1])
        assert again["pairs"] == [PAIR]
        assert again["saved"] == json.loads(text)["saved"]
        assert post(served, "/session.json", {"pairs": [PAIR, CHECK], "based_on": again["saved"]})[0] == 200
        assert len(read_session(folder / "session.json").pairs) == 2
        assert again["notes"] == []
        noted = {"pairs": [PAIR], "notes": [NOTE], "based_on": json.loads(served.get("/session.json")[1])["saved"]}
        assert post(served, "/session.json", noted)[0] == 200
        assert json.loads(served.get("/session.json")[1])["notes"] == [NOTE]
        # another window that had read it before does not undo that
        status, text = post(served, "/session.json", {"pairs": [], "based_on": again["saved"]})
        assert status == 409
        assert "was changed meanwhile" in text
        assert read_session(folder / "session.json").notes[0].text == NOTE["text"]
    assert sorted(path.name for path in folder.iterdir() if path.name.startswith((".", "session"))) == ["session.json"]


def test_a_part_of_another_output_takes_no_landmarks(folder: Path, tmp_path: Path):
    part = tmp_path / "pose" / "predicted" / "oct"
    shutil.copytree(folder, part)
    (part / LIST_NAME).unlink(missing_ok=True)
    seal(tmp_path / "pose", "pose")
    with application(part) as served:
        assert "a part of pose" in json.loads(served.get("/session.json")[1])["refused"]
        status, text = post(served, "/session.json", {"pairs": [PAIR], "based_on": None})
    assert status == 409
    assert "copy this folder" in text
    assert verify(tmp_path / "pose", progress=False)[0].intact


@pytest.mark.parametrize("text", ["my notes", "{}", '{"format": "endoct-session-9"}'])
def test_what_is_no_session_of_ours_is_never_overwritten(folder: Path, text: str):
    (folder / "session.json").write_text(text)
    with application(folder) as served:
        assert json.loads(served.get("/session.json")[1])["refused"]
        for based_on in (None, "0" * 64):
            assert post(served, "/session.json", {"pairs": [PAIR], "based_on": based_on})[0] == 409
    assert (folder / "session.json").read_text() == text


def test_a_session_of_another_comparison_is_neither_loaded_nor_overwritten(folder: Path):
    shown = open_shown(folder)
    assert shown.session is not None
    a, b = shown.session.identities
    content = Session((a, replace(b, recording="0" * 64))).to_bytes()
    (folder / "session.json").write_bytes(content)
    with application(folder) as served:
        state = json.loads(served.get("/session.json")[1])
        assert "belongs to another comparison" in state["refused"]
        assert "another recording of oct" in state["refused"]
        assert post(served, "/session.json", {"pairs": [], "based_on": None})[0] == 409
    assert (folder / "session.json").read_bytes() == content


def test_a_link_is_not_followed(folder: Path, tmp_path: Path):
    target = tmp_path / "target.json"
    for existing in (False, True):
        if existing:
            target.write_text("precious")
        (folder / "session.json").symlink_to(target)
        with application(folder) as served:
            assert "is a link" in json.loads(served.get("/session.json")[1])["refused"]
            assert post(served, "/session.json", {"pairs": [PAIR], "based_on": None})[0] == 409
        (folder / "session.json").unlink()
    assert target.read_text() == "precious"


@pytest.mark.parametrize("path", ["/session.json", "/landmarks.json"])
@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": None}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Host": "evil.example", "Origin": "http://evil.example"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content-Type": None}, 415),
    ],
)
def test_what_another_page_sends_is_refused(folder: Path, path: str, headers: dict[str, str | None], expected: int):
    with application(folder) as served:
        assert post(served, path, {"pairs": [PAIR], "based_on": None}, **headers)[0] == expected
    assert not (folder / "session.json").exists()


@pytest.mark.parametrize("path", ["/session.json", "/landmarks.json"])
@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"[]", b"5", b"\xff", b"[" * 100_000, {}, {"pairs": 5}, {"pairs": [5]}, {"pairs": [{}]},
        {"pairs": [{**PAIR, "a": {"theta_rad": float("nan"), "z_mm": 0.0}}]},
        {"pairs": [{**PAIR, "a": {"theta_rad": 7.0, "z_mm": 0.0}}]},
        {"pairs": [{**PAIR, "b": {"theta_rad": 1.0, "z_mm": 1e300}}]},
        {"pairs": [{**PAIR, "b": {"theta_rad": "1", "z_mm": 0.0}}]},
        {"pairs": [{**PAIR, "name": "\ud800"}]},
        {"pairs": [{**PAIR, "role": "admin"}]},
        {"pairs": [{**PAIR, "sigma_mm": 0}]},
        {"pairs": [PAIR], "path": "/etc/passwd"},
        {"pairs": [PAIR] * 1001},
    ],
)  # fmt: skip
def test_nonsense_is_refused_in_one_line(folder: Path, path: str, body: Any):
    with application(folder) as served:
        status, said = post(served, path, body)
    assert status == 409
    assert "\n" not in said
    assert len(said) < 1000
    assert not (folder / "session.json").exists()


def test_a_session_that_could_not_be_read_again_is_not_written(folder: Path):
    # sent in one line it is less than a file may have, written in many it is more
    sent = {"pairs": [PAIR] * 700, "notes": [{**NOTE, "text": "\U0001f9b4" * 200}] * 1000}
    with application(folder) as served:
        status, said = post(
            served, "/session.json", json.dumps(sent, ensure_ascii=False, separators=(",", ":")).encode()
        )
    assert (status, "1000000 bytes at most" in said) == (409, True)
    assert not (folder / "session.json").exists()


def test_a_huge_body_is_refused(folder: Path):
    with application(folder) as served:
        for path in ("/session.json", "/landmarks.json"):
            with suppress(BrokenPipeError, ConnectionResetError):  # it need not have read all of it to refuse
                assert post(served, path, b" " * 5_000_000)[0] == 413
        assert served.get("/description.json")[0] == 200
    assert not (folder / "session.json").exists()


def test_the_frozen_page_can_make_the_same_file(folder: Path):
    shown = open_shown(folder)
    assert shown.session is not None
    (folder / "session.json").write_bytes(
        Session(shown.session.identities, (), (Note(**{**NOTE, "place": Place(6.2, 0.7)}),)).to_bytes()
    )
    state = shown.session.state(offline=True)
    assert state["notes"] == [NOTE]
    assert str(folder.parent) not in json.dumps(state)  # it is true wherever the folder is moved to
    assert "-o ../specimen-8-by-hand --session session.json" in state["command"]
    made = {"format": "endoct-session-1", "sides": state["sides"], "pairs": [PAIR]}
    assert session_from(json.dumps(made).encode(), "here").sides == shown.session.identities
