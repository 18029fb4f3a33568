"""A session on the command line: corrected and said so, refused for other recordings, and kept when outputs change."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from bore_pairs import make_pair

from endoct.base.errors import EndoctError
from endoct.fusion.files.result_file import read_result
from endoct.fusion.files.session import Note, Session, identity_of
from endoct.fusion.geometry.alignment import LandmarkPair, Place
from endoct.stitching.store import save_panorama
from endoct.workbench import cli, compare
from endoct.workbench.page.opening import open_shown
from endoct.workbench.verifying import verify

PAIR = make_pair(2, theta_shift_rad=1.0)
OFF_RAD = 0.1


def placed(theta_rad: float, z_mm: float, role: str) -> LandmarkPair:
    """Return a pair whose end on A lies ``OFF_RAD`` too far around."""
    turned = float(PAIR.truth.theta_to_a(theta_rad)) + OFF_RAD
    return LandmarkPair(Place(turned % 6.2831853, float(PAIR.truth.z_to_a(z_mm))), Place(theta_rad, z_mm), role)


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("sides")
    for name, panorama in (("a", PAIR.a), ("b", PAIR.b)):
        save_panorama(panorama, folder / f"{name}.zarr")
    return folder / "a.zarr", folder / "b.zarr"


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = tmp_path / "session.json"
    pairs = [placed(1.0, 1.0, "correct"), placed(3.0, 4.0, "correct"), placed(5.0, 2.0, "check")]
    identities = identity_of("camera", PAIR.a), identity_of("ranger", PAIR.b)
    path.write_bytes(Session(identities, tuple(pairs), (Note("b", Place(1.0, 1.0), "wet here"),)).to_bytes())
    return path


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    return int(leave.value.code or 0)


def test_a_session_corrects_and_every_place_says_so(
    sides: tuple[Path, Path], session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    output = tmp_path / "result"
    command = ("compare", *sides, "-o", output, "--session", session, "--set", "n_theta=512")
    assert run(monkeypatch, *command) == 0
    assert "DOUBT: The alignment was corrected by hand, by 2 landmark pairs" in capsys.readouterr().out
    result = read_result(output)
    assert str(session) in result.inputs
    assert result.by_hand is not None
    assert result.by_hand.corrected
    assert result.by_hand.moved is not None
    assert result.by_hand.moved.turn_rad == pytest.approx(OFF_RAD, abs=0.02)
    assert result.by_hand.check is not None
    assert result.by_hand.check.max_mm < 0.02
    assert result.alignment is not None
    assert result.alignment.confidence == 0
    assert json.loads(json.dumps(result.to_json())) == result.to_json()
    report = (output / "report.html").read_text(encoding="utf-8")
    assert "Corrected by 2 landmark pairs" in report
    shown = open_shown(output)
    assert shown.heading.verdict.headline.startswith(
        "Corrected by 2 landmark pairs; 1 pair that had no part in it lies 0.0"
    )
    assert shown.heading.verdict.level == "doubted"
    # what corrected it is there to go on from, and starts from the automatic alignment again
    assert shown.session is not None
    state = shown.session.state()
    assert len(state["pairs"]) == 3
    assert state["judged"]["by_hand"]["moved"]["turn_rad"] == pytest.approx(result.by_hand.moved.turn_rad)
    assert state["command"].endswith(f"--session {output}/session.json --set n_theta=512")
    # and its notes, which are then the user's: what was changed of them is not replaced
    assert [note["text"] for note in state["notes"]] == ["wet here"]
    assert all(verdict.intact for verdict in verify(output))
    request.getfixturevalue("without_report")  # it was looked at
    assert run(monkeypatch, *command, "--overwrite", "--strict") == 3
    (output / "session.json").write_bytes(session.read_bytes().replace(b"wet", b"dry"))
    assert run(monkeypatch, *command, "--overwrite") == 1


@pytest.mark.usefixtures("without_report")
def test_what_was_placed_by_hand_is_kept(
    sides: tuple[Path, Path], session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "result"
    compare(*sides, output, settings={"n_theta": 512}, progress=False)
    placed_file = output / "session.json"
    placed_file.write_bytes(session.read_bytes())
    verdicts = list(verify(output))
    assert verdicts
    assert all(verdict.intact for verdict in verdicts)
    for command in (
        ("compare", *sides, "-o", output, "--overwrite"),
        ("compare", *sides, "-o", output, "--overwrite", "--session", placed_file),
    ):
        assert run(monkeypatch, *command) == 1
        assert placed_file.read_bytes() == session.read_bytes()
    placed_file.write_text("notes")
    assert not all(verdict.intact for verdict in verify(output))


def test_a_session_of_other_recordings_is_refused_and_nothing_is_written(
    sides: tuple[Path, Path], session: Path, tmp_path: Path
) -> None:
    output = tmp_path / "result"
    with pytest.raises(EndoctError, match="name camera first"):
        compare(sides[1], sides[0], output, session=session, progress=False)
    other = replace(PAIR.b, intensity=PAIR.b.intensity[::-1])
    with pytest.raises(EndoctError, match="another recording of ranger"):
        compare(sides[0], other, output, session=session, progress=False)
    session.write_text("{}")
    with pytest.raises(EndoctError, match="no session file"):
        compare(*sides, output, session=session, progress=False)
    with pytest.raises(EndoctError, match="cannot be read"):
        compare(*sides, output, session=tmp_path / "missing.json", progress=False)
    assert not output.exists()
