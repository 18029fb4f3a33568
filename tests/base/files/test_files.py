"""Files that are read: regular ones, of the size they should have, that stay as they are."""

import os
from pathlib import Path

import pytest

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import (
    VARIABLE,
    check_array_size,
    check_unchanged,
    inside,
    open_regular,
    plain_name,
    read_small,
    read_start,
    spreadsheet_text,
    state_of,
)


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"content")
    os.mkfifo(tmp_path / "pipe")
    with open_regular(tmp_path / "file") as file:
        assert file.read() == b"content"
    for name, kind in (("pipe", "a pipe"), (".", "a folder"), ("/dev/zero", "a device")):
        with pytest.raises(EndoctError, match=f"{kind}; expected a regular file"), open_regular(tmp_path / name):
            pytest.fail("opened")
        assert read_start(tmp_path / name, 4) == b""
    for name in ("nowhere", "a\0b"):
        with pytest.raises(EndoctError, match="cannot be read"), open_regular(tmp_path / name):
            pytest.fail("opened")
    assert read_start(tmp_path / "file", 4) == b"cont"


def test_what_should_be_small_is_not_read_when_large(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    assert read_small(tmp_path / "file", 5) == b"12345"
    with pytest.raises(EndoctError, match="too large"):
        read_small(tmp_path / "file", 4)


def test_a_change_while_reading_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in "ab":
        (tmp_path / "in" / name).write_text("1")
    before = state_of(tmp_path / "in")
    check_unchanged(tmp_path / "in", before)
    (tmp_path / "other").write_text("1")
    (tmp_path / "other").replace(tmp_path / "in" / "b")
    with pytest.raises(EndoctError, match="was changed while it was read"):
        check_unchanged(tmp_path / "in", before)
    before = state_of(tmp_path / "in")
    (tmp_path / "in" / "c").write_text("")
    with pytest.raises(EndoctError, match="was changed while it was read"):
        check_unchanged(tmp_path / "in", before)


@pytest.mark.parametrize(
    "name", ["../x", "/x", "a/b", "", ".", "..", ".hidden", "a\0", "a\nb", "é", 3, None, "a" * 101]
)
def test_names_that_lead_elsewhere_are_refused(name: object) -> None:
    with pytest.raises(EndoctError, match="the name of a plug-in cannot be used"):
        plain_name(name, "a plug-in")


@pytest.mark.parametrize("name", ["oct", "oct-1", "endoscope_2", "a.b", "0001"])
def test_plain_names_pass(name: str) -> None:
    assert plain_name(name, "a plug-in") == name


def test_paths_stay_inside(tmp_path: Path) -> None:
    assert inside(tmp_path, "a/b.json", "a record") == tmp_path / "a" / "b.json"
    for bad in ("../x", "/x", "a/../../x", "", "a//b", "a/./b", 3, "a\0b"):
        with pytest.raises(EndoctError, match="a record names a place outside"):
            inside(tmp_path, bad, "a record")


def test_no_cell_of_a_table_is_a_formula() -> None:
    assert [spreadsheet_text(text) for text in ("=1+1", "@x", "-x", "+x", "x=1", "")] == [
        "'=1+1", "'@x", "'-x", "'+x", "x=1", "",
    ]  # fmt: skip


def test_too_large_an_array_is_refused_unless_it_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    check_array_size((10_000, 10_000), 4, "x")
    with pytest.raises(EndoctError, match=f"x asks for too much memory.*4 GB.*{VARIABLE}"):
        check_array_size((100_000, 10_000), 4, "x")
    monkeypatch.setenv(VARIABLE, "5")
    check_array_size((100_000, 10_000), 4, "x")
    monkeypatch.setenv(VARIABLE, "much")
    with pytest.raises(EndoctError, match=f"{VARIABLE} is no size"):
        check_array_size((1,), 1, "x")


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (KeyError("x"), "KeyError: 'x'"),
        (ValueError("no\n number"), "no number"),
        (OSError(28, "No space"), "No space"),
        (RecursionError("deep"), "nested too deeply"),
        (ZeroDivisionError(), "ZeroDivisionError"),
    ],
)
def test_whatever_a_library_raises_is_one_line(raised: Exception, said: str) -> None:
    with pytest.raises(EndoctError) as caught, refusing("the file is broken", remedy="copy it again"):
        raise raised
    assert str(caught.value) == f"the file is broken; found {said}; copy it again"
    assert caught.value.__cause__ is raised


def test_a_message_steers_no_terminal() -> None:
    assert str(EndoctError("a\x1b[2Jb", found="\udcff\u202e é θ")) == "a\\x1b[2Jb; found \\udcff\\u202e é θ"
