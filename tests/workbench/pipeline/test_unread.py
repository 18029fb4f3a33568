"""Files that nothing reads: counted, and the first ones listed with why."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.workbench.pipeline.unread import MOST_LISTED, Unread, accompanies, texts_in


def test_all_are_counted_and_the_first_ones_listed(tmp_path: Path) -> None:
    unread = Unread()
    for k in range(MOST_LISTED + 2):
        (tmp_path / f"{k}.txt").write_text("no frames")
        unread.add(f"a/{k}.txt", tmp_path / f"{k}.txt", "so it is" if k % 2 else "")
    listed = unread.to_json()
    assert listed["count"] == MOST_LISTED + 2
    assert [each["name"] for each in listed["files"]] == [f"a/{k}.txt" for k in range(MOST_LISTED)]
    assert listed["files"][1]["why"] == "so it is"
    assert listed["files"][0]["why"].startswith("9 bytes; expected PNG")
    unread.add("more", tmp_path)
    assert listed["count"] == MOST_LISTED + 2, "a list that was given stays"


def test_why_nothing_reads_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.docx").write_bytes(b"PK\3\4")
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((4, 4), np.uint8))
    unread = Unread()
    for name in ("a.docx", "b.png"):
        unread.add(name, tmp_path / name)
    why = [each["why"] for each in unread.to_json()["files"]]
    assert why[1] == "an image, and no recording by itself"
    assert why[0] != why[1]


@pytest.mark.parametrize(
    ("name", "does"),
    [
        *[(name, True) for name in ("a.toml", "A.TOML", "Chirp.dat", "chirp.data", "OffsetErrors.dat", "zarr.json")],
        *[(name, False) for name in ("toml", "chirps.dat", "zarr.jsn", "a.json", "a.toml.txt")],
    ],
)
def test_what_only_says_something_of_others(name: str, does: bool) -> None:
    assert accompanies(Path(name)) is does


def test_texts_at_any_depth_of_tables() -> None:
    assert texts_in({"a": "x", "b": {"c": {"d": "y"}, "n": 3}, "e": None}) == {"x", "y"}
    assert texts_in("z") == {"z"}
    assert texts_in(3) == set()
