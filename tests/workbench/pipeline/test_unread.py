"""Files that nothing reads: counted, and the first ones listed with why."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.modalities.registry import manifests
from endoct.workbench.pipeline import unread
from endoct.workbench.pipeline.unread import MOST_LISTED, Unread, accompanies, texts_in


def test_all_are_counted_and_the_first_ones_listed(tmp_path: Path) -> None:
    listing = Unread()
    for k in range(MOST_LISTED + 2):
        (tmp_path / f"{k}.txt").write_text("no frames")
        listing.add(f"a/{k}.txt", tmp_path / f"{k}.txt", "so it is" if k % 2 else "")
    listed = listing.to_json()
    assert listed["count"] == MOST_LISTED + 2
    assert [each["name"] for each in listed["files"]] == [f"a/{k}.txt" for k in range(MOST_LISTED)]
    assert listed["files"][1]["why"] == "so it is"
    assert listed["files"][0]["why"].startswith("9 bytes; expected PNG")
    listing.add("more", tmp_path)
    assert listed["count"] == MOST_LISTED + 2, "a list that was given stays"


def test_why_nothing_reads_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.docx").write_bytes(b"PK\3\4")
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((4, 4), np.uint8))
    listing = Unread()
    for name in ("a.docx", "b.png"):
        listing.add(name, tmp_path / name)
    why = [each["why"] for each in listing.to_json()["files"]]
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


def test_beyond_so_many_files_only_those_called_otherwise_than_frames_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 3 that are opened one holds frames; later ones of its suffix are frames, and others are not looked at."""
    names = ["1.scan", "2.junk", "3.junk", "4.scan", "5.junk", "6.toml", "7.tif", "8.cited"]
    for name in names:
        (tmp_path / name).write_text("x")
    (tmp_path / "9.folder").mkdir()
    asked: list[str] = []
    monkeypatch.setattr(unread, "MOST_ASKED", 3)
    monkeypatch.setattr(unread, "gives_frames", lambda file: asked.append(file.name) or file.suffix == ".scan")
    manifest = replace(manifests()["oct"], suffixes=frozenset({".tif"}))
    found = unread.unread_next_to(tmp_path, manifest, {"8.cited"}).to_json()
    assert asked == ["1.scan", "2.junk", "3.junk"]
    assert [each["name"] for each in found["files"]] == ["2.junk", "3.junk", "5.junk"]
    assert [each["why"] == "not looked at, as 3 others were" for each in found["files"]] == [False, False, True]
    monkeypatch.setattr(unread, "MOST_ASKED", 4)
    assert unread.unread_next_to(tmp_path, manifest, ()).count == 4
    assert asked[3:] == ["1.scan", "2.junk", "3.junk", "4.scan"]
