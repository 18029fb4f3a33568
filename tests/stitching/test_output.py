"""Outputs appear whole or not at all."""

from pathlib import Path

import pytest

from endoct.stitching.errors import EndoctError
from endoct.stitching.output import new_output


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_and_a_folder_appear_at_the_end(tmp_path: Path) -> None:
    with new_output(tmp_path / "deep" / "file.txt") as scratch:
        scratch.write_text("whole")
        assert not (tmp_path / "deep" / "file.txt").exists()
    with new_output(tmp_path / "folder") as scratch:
        scratch.mkdir()
        (scratch / "inside").write_text("whole")
    assert (tmp_path / "deep" / "file.txt").read_text() == "whole"
    assert (tmp_path / "folder" / "inside").read_text() == "whole"
    assert names(tmp_path) == ["deep", "folder"]
    assert names(tmp_path / "deep") == ["file.txt"]


def test_an_existing_output_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(EndoctError, match=r"exists already.*--overwrite"), new_output(tmp_path / "out"):
        pytest.fail("the work began")
    assert (tmp_path / "out").read_text() == "mine"


def test_overwriting_replaces_a_folder_whole(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old").write_text("old")
    with new_output(tmp_path / "out", overwrite=True) as scratch:
        scratch.mkdir()
        (scratch / "new").write_text("new")
        assert names(tmp_path / "out") == ["old"]  # the old one stands until the new one is whole
    assert names(tmp_path / "out") == ["new"]
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, EndoctError, ValueError, SystemExit])
def test_nothing_is_left_behind(tmp_path: Path, interruption: type[BaseException]) -> None:
    (tmp_path / "out").write_text("old")

    def work() -> None:
        with new_output(tmp_path / "out", overwrite=True) as scratch:
            scratch.mkdir()
            (scratch / "half").write_text("half")
            raise interruption("stop")

    with pytest.raises(interruption):
        work()
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out").read_text() == "old"


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="No space left"), new_output(tmp_path / "out"):
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(EndoctError, match="cannot be written"), new_output(tmp_path / "file" / "out"):
        pytest.fail("the work began")
