"""Every kind, held against all who ask what lies at a path; and the walk that looks for them."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random

import cv2
import numpy as np
import pytest
from mock_comparison import Kind, write_comparison
from workbench_page import written

from benchmarks.ct_faults.drawn import drawn, named_slices
from benchmarks.ct_faults.writing import write_series
from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.modalities.reading import images
from endoct.workbench import kinds, load, summarise
from endoct.workbench.desk.study import inputs_in
from endoct.workbench.exporting.source import open_for_export
from endoct.workbench.kinds import KINDS, PathKind, kind_at, output_at, places_in, reader
from endoct.workbench.page.collection import collection_html, entries_in
from endoct.workbench.page.opening import can_be_shown, open_shown
from endoct.workbench.page.presence import Origin
from endoct.workbench.pipeline.information import describe
from endoct.workbench.pipeline.unread import Unread
from endoct.workbench.running.outputs import DATA_SET, POSE, SUMMARY
from endoct.workbench.sides.sources import Source, open_source, side_of_comparison
from endoct.workbench.verifying import verify

PLAN = {"@schema": "https://raw.githubusercontent.com/slicer/markups-schema-v1.0.3.json#", "markups": []}


@pytest.fixture(scope="module")
def study(quick_specimen: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of every kind, each under its name."""
    top = tmp_path_factory.mktemp("study")
    written(top / "comparison")
    shutil.copytree(top / "comparison" / "panoramas" / "oct.zarr", top / "panorama")
    shutil.copytree(quick_specimen, top / "specimen", ignore=shutil.ignore_patterns("labels"))
    shutil.copytree(quick_specimen / "oct", top / "recording")
    shutil.copytree(quick_specimen / "oct", top / "specimen" / "truth" / "again")
    (top / DATA_SET).mkdir()
    (top / DATA_SET / "dataset.json").write_text(json.dumps({"count": 0, "arguments": {}, "versions": {}}))
    (top / POSE).mkdir()
    (top / POSE / "pose.json").write_text(json.dumps({"sides": ["oct"], "told": False, "reason": "why not"}))
    said = {"format": "endoct-output-1", "kind": POSE, "files": {}, "parts": {}}
    (top / POSE / "endoct-output.json").write_text(json.dumps(said))
    summarise([top / "comparison"], top / SUMMARY)
    write_series(top / "volume", named_slices(drawn(Random(1))))
    (top / "plan").write_text(json.dumps(PLAN))
    cv2.imwrite(str(top / "mask.png"), np.eye(8, dtype=np.uint8) * 255)
    (top / "mask.png").rename(top / "mask.PNG")
    return top


def _at(study: Path, kind: str) -> Path:
    return study / ("mask.PNG" if kind == "mask" else kind)


def _refused(ask: Callable[[Path], object], path: Path) -> bool:
    try:
        ask(path)
    except EndoctError:
        return True
    return False


@pytest.mark.parametrize("kind", KINDS)
def test_all_who_ask_agree_what_lies_at_a_path(study: Path, kind: str) -> None:
    path, row = _at(study, kind), KINDS[kind]
    assert kind_at(path) == kind
    assert output_at(path) == (None if kind in kinds.INPUTS else kind)
    for named in (row.described, row.loaded, row.listed, row.shown, row.pictured):
        assert not named or callable(reader(named))
    assert bool(row.listed) == bool(row.pictured)
    assert _refused(load, path) != bool(row.loaded)
    listed = {entry.name: entry for entry in entries_in(study)}
    assert (kind in listed) == bool(row.listed)
    assert not [name for name in listed if "/" in name]  # nothing is looked for inside what is listed
    if row.listed:
        assert (listed[kind].kind, listed[kind].fault) == (row.title, "")
        assert listed[kind].can_be_opened == bool(row.shown) == can_be_shown(path)
    assert _refused(open_for_export, path) == (kind not in ("comparison", "panorama", "specimen"))
    is_side = kind in ("panorama", "mask", "recording")
    assert _refused(lambda of: open_source(Source(of, None, {})), path) != is_side
    assert _refused(lambda of: side_of_comparison(Source(of, None, {})), path) == (kind == "comparison")


def said(path: Path) -> dict[str, object]:
    """Stand for what describes, lists and loads an album."""
    return {"what": f"an album of {path.name}"}


def shown(_: Origin) -> str:
    """Stand for what opens its page."""
    return "its page"


def test_a_new_kind_is_a_row_and_its_readers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trip").mkdir()
    (tmp_path / "trip" / "album.json").write_text("{}")
    seal(tmp_path / "trip", "album")
    by = dict.fromkeys(("described", "listed", "loaded", "pictured"), f"{__name__}:said")
    row = PathKind(
        "album", lambda path: (path / "album.json").is_file(), title="album", shown=f"{__name__}:shown", **by
    )
    before = entries_in(tmp_path)
    monkeypatch.setitem(kinds.KINDS, "album", row)
    (entry,) = entries_in(tmp_path)
    assert (before, entry.name, entry.kind, entry.what) == ((), "trip", "album", "an album of trip")
    assert entry.can_be_opened
    assert "<span>1 album</span>" in collection_html("all", (entry,), "v")
    assert describe(tmp_path / "trip") == load(tmp_path / "trip") == said(tmp_path / "trip")
    assert open_shown(tmp_path / "trip") == "its page"
    assert [(verdict.kind, verdict.intact) for verdict in verify(tmp_path, progress=False)] == [("album", True)]


def test_a_single_image_is_decoded_once(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[Path] = []
    read = images.read_single
    monkeypatch.setattr(images, "read_single", lambda path: (decoded.append(path), read(path))[1])
    assert kind_at(study / "mask.PNG") == "mask"
    assert decoded == [study / "mask.PNG"]


def test_a_sidecar_makes_a_recording_of_what_lies_next_to_it(study: Path, tmp_path: Path) -> None:
    shutil.copy(study / "plan", tmp_path / "plan")
    assert kind_at(tmp_path / "plan") == "plan"
    (tmp_path / "acquisition.toml").write_text("")
    assert kind_at(tmp_path / "plan") == "recording"


def test_a_folder_that_is_listed_lists_what_lies_in_it(study: Path) -> None:
    names = [entry.name for entry in entries_in(study / "comparison")]
    assert names == ["panoramas/endoscope.zarr", "panoramas/oct.zarr"]


def test_one_side_of_a_comparison_is_named_with_a_colon(study: Path) -> None:
    for folder, of in (("comparison", "comparison/panoramas/oct.zarr"), ("recording", "recording:oct")):
        source = Source(study / f"{folder}:oct", None, {})
        assert side_of_comparison(source).path == study / of
    with pytest.raises(EndoctError, match="has no such side; found ct; expected endoscope, oct"):
        side_of_comparison(Source(study / "comparison:ct", None, {}))


def test_a_comparison_without_a_wall_says_why_it_has_none(tmp_path: Path) -> None:
    write_comparison(tmp_path / "apart", Kind("endoscope", depth=False), Kind("oct"), aligned=False)
    write_comparison(tmp_path / "pair", Kind("oct-1"), Kind("oct-2"))
    for asked in (load, describe, open_for_export):
        with pytest.raises(EndoctError, match=r"apart has no wall of both sides; found The best place is only"):
            asked(tmp_path / "apart" / "wall.zarr")
        with pytest.raises(EndoctError, match=r"pair has no wall of both sides; expected two aligned sides, of which"):
            asked(tmp_path / "pair" / "wall.zarr")
    for elsewhere in ("apart/other.zarr", "nowhere/wall.zarr"):
        with pytest.raises(EndoctError, match="cannot be loaded; found no such file"):
            load(tmp_path / elsewhere)
    (tmp_path / "pair" / "wall.zarr").mkdir()
    assert output_at(tmp_path / "pair" / "wall.zarr") is None


def test_what_it_says_of_itself_is_its_kind(study: Path) -> None:
    said = {kind: describe(_at(study, kind))["kind"] for kind in ("comparison", "panorama", "volume", "recording")}
    assert said == {"comparison": "comparison", "panorama": "panorama", "volume": "CT", "recording": "recording"}
    with pytest.raises(EndoctError, match=r"plan"):
        describe(study / "plan")


def test_the_desk_lists_inputs_and_what_verify_knows_is_an_output(study: Path) -> None:
    found = {each.name: each.kind for each in inputs_in(study, Unread())}
    inside = {f"specimen/{side}": "recording" for side in ("endoscope", "oct")}
    assert found == {"recording": "recording", "volume": "volume", POSE: "pose", **inside}
    outputs = {verdict.path.name for verdict in verify(study, progress=False)}
    assert outputs == {kind for kind in KINDS if kind not in kinds.INPUTS}


def test_the_walk_leaves_out_what_is_hidden_linked_or_taken_out(study: Path, tmp_path: Path) -> None:
    for name in ("a/b/c/d/e/f", ".hidden"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "link").symlink_to(study)
    names = [place.path.relative_to(tmp_path).as_posix() for place in places_in(tmp_path)]
    assert names == [".", "a", "a/b", "a/b/c", "a/b/c/d", "a/b/c/d/e"]
    for place in places_in(tmp_path):
        assert place.path.name != "b"
        place.folders.clear()


def test_a_walk_has_one_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinds, "MOST_FOLDERS", 3)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    assert len(list(places_in(tmp_path))) == 3
    (tmp_path / "c").mkdir()
    with pytest.raises(EndoctError, match="too many folders to look through; expected 3 at most"):
        list(places_in(tmp_path))


def test_a_list_that_cannot_be_read_stops_no_walk(tmp_path: Path) -> None:
    (tmp_path / "endoct-output.json").write_text("{")
    assert [place.output for place in places_in(tmp_path)] == [None]
    with pytest.raises(EndoctError, match="is damaged"):
        output_at(tmp_path)


def test_a_folder_that_is_somebody_elses_stops_no_walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("locked", "open"):
        (tmp_path / name).mkdir()

    def asked(path: Path) -> str | None:
        if path.name == "locked":
            raise PermissionError(13, "Permission denied")
        return None

    monkeypatch.setattr(kinds, "output_at", asked)
    assert [place.path.name for place in places_in(tmp_path)] == [tmp_path.name, "locked", "open"]


def test_outlines_are_drawn_whatever_lies_beside_them(tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text('modality = "oct"\n')
    (tmp_path / "cells.csv").write_text("theta_deg,z_mm\n")
    assert kind_at(tmp_path / "cells.csv") == kinds.MASK
    assert kind_at(tmp_path) == kinds.RECORDING
