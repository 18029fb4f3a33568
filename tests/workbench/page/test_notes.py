"""A note on a result: written, changed, taken away, and refused."""

from pathlib import Path

import pytest

from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.workbench import verify
from endoct.workbench.page.notes import MOST_CHARACTERS, NAME, read_note, write_note


def test_a_note_is_written_changed_and_taken_away(tmp_path: Path):
    assert read_note(tmp_path) == ""
    assert write_note(tmp_path, "  dark at z = 3,\r\n\tas it was wet  \n", "") == "dark at z = 3,\n\tas it was wet"
    assert read_note(tmp_path) == "dark at z = 3,\n\tas it was wet"
    assert write_note(tmp_path, "wet", read_note(tmp_path)) == "wet"
    assert write_note(tmp_path, " ", "wet") == ""
    assert not list(tmp_path.iterdir())


def test_a_note_is_the_users_own(tmp_path: Path):
    seal(tmp_path, "comparison")
    write_note(tmp_path, "wet", "")
    assert verify(tmp_path)[0].intact


@pytest.mark.parametrize("text", [None, 3, ["a"], "a\x1b[2J", "a\0", "\ud800", "x" * (MOST_CHARACTERS + 1)])
def test_what_is_no_text_is_refused(text: object, tmp_path: Path):
    with pytest.raises(EndoctError, match="cannot be saved"):
        write_note(tmp_path, text, "")
    assert not list(tmp_path.iterdir())


def test_a_note_of_somebody_else_is_kept(tmp_path: Path):
    write_note(tmp_path, "theirs", "")
    with pytest.raises(EndoctError, match="changed meanwhile"):
        write_note(tmp_path, "mine", "")
    (tmp_path / NAME).write_bytes(b"\xff\xfe")
    with pytest.raises(EndoctError, match="is no note"):
        write_note(tmp_path, "mine", "")
    (tmp_path / NAME).unlink()
    (tmp_path / NAME).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(EndoctError, match="is no note"):
        write_note(tmp_path, "mine", "")
    assert not (tmp_path / "elsewhere").exists()


def test_of_two_windows_that_save_at_once_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_note(tmp_path, "before", "")

    def meanwhile(folder: Path) -> None:
        monkeypatch.undo()
        write_note(folder, "theirs", "before")

    monkeypatch.setattr("endoct.workbench.page.notes.whole_of", meanwhile)
    with pytest.raises(EndoctError):
        write_note(tmp_path, "mine", "before")
    assert read_note(tmp_path) == "theirs"


def test_a_part_of_an_output_is_left_alone(tmp_path: Path):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "file").write_text("x")
    seal(tmp_path, "comparison")
    with pytest.raises(EndoctError, match="is a part of"):
        write_note(tmp_path / "part", "mine", "")
