"""Frames at a place: where they lie, their pictures, and the recording read again for more of them."""

import base64
import io
import json
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from workbench_page import Served

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.modalities.contract import Picture
from endoct.stitching.store import read_outline
from endoct.workbench import unroll
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.recorded import Reader, path_of_recording, picture_json, recording_of, ring_of
from endoct.workbench.page.report import frozen_data
from endoct.workbench.page.shown import frames_part


@pytest.fixture(scope="module")
def endoscope(walls: Path) -> Path:
    """A panorama whose recording is at hand."""
    return walls / "endoscope" / "wall.zarr"


def read(reader: Reader) -> Reader:
    reader.start()
    for _ in range(6000):
        if reader.state != "reading":
            return reader
        time.sleep(0.02)
    return reader


def test_frames_lie_where_the_alignment_puts_them(comparison: Path):
    outline = read_outline(comparison / "panoramas" / "oct.zarr")
    where = Alignment(0.5, 10.0, z_scale=1.1, mirrored=True, z_reversed=True)
    part = frames_part("oct", outline, where, comparison / "pictures")
    assert part.z_mm == pytest.approx(10 - 1.1 * 0.2 * np.arange(15))
    assert part.pictured == (7,)
    placement = part.placement
    assert (placement.theta_shift_rad, placement.mirrored) == (0.5, True)
    assert (placement.z_shift_mm, placement.z_scale, placement.z_reversed) == (10.0, 1.1, True)
    by_name = {one.name: one for one in part.quality}
    assert by_name["signal"].usual == (12.0, None)
    assert by_name["bridged"].is_flag
    assert [k for k, value in enumerate(by_name["bridged"].values) if value] == [3, 8, 9]


def test_the_server_has_the_pictures_that_were_kept(served: Served):
    status, text, _ = served.get("/pictures/v/oct/7.json")
    assert status == 200
    raw, _ = json.loads(text)
    assert raw["title"] == "B-scan as recorded"
    assert raw["axis"] is None  # rotation is not θ
    assert raw["curves"]["outer face"][12] == [None, None]
    kind, data = raw["image"].split(",", 1)
    assert kind == "data:image/jpeg;base64"
    assert Image.open(io.BytesIO(base64.b64decode(data))).size == (100, 50)


@pytest.mark.parametrize("path", ["oct/8.json", "oct/-1.json", "oct/99999999.json", "nobody/7.json", "..%2foct/7.json"])
def test_pictures_that_are_not_there_are_refused(served: Served, path: str):
    assert served.get(f"/pictures/v/{path}")[0] == 404


def test_a_recording_that_is_not_there_is_not_read(served: Served):
    assert json.loads(served.get("/reading/oct", method="POST")[1])["state"] == "absent"
    assert served.get("/reading/nobody")[0] == 404
    assert served.get("/reading/oct", method="POST", Origin="http://evil.example")[0] == 403


def test_a_recording_is_read_again_for_every_frame(endoscope: Path):
    shown = open_shown(endoscope)
    (part,) = shown.description.frames
    assert part.pictured == (2, 6, 10)
    assert part.recording.endswith("endoscope")
    with pytest.raises(EndoctError, match="no picture"):
        shown.pictures("endoscope", 3)
    reader = shown.side("endoscope").reader
    assert reader is not None
    assert read(reader).state == "read", reader.said
    frame, strip = shown.pictures("endoscope", 3)
    assert (frame["axis"], strip["axis"]) == ("ring", "theta")
    with pytest.raises(EndoctError, match="no such frame"):
        shown.pictures("endoscope", 1000)


@pytest.mark.parametrize(
    ("inputs", "path"),
    [
        (["bore/scan.tif"], "bore/scan.tif"),
        (["bore/LICENSE", "bore/acquisition.toml", "bore/pullback.tif"], "bore"),
        (["bore/acquisition.toml", "bore/deep/a.png", "bore/deep/b.png"], "bore"),
        (["bore/*"], "bore"),
        (["bore/a.png", "/elsewhere/b.png"], None),
        ([], None),
    ],
)
def test_a_recording_is_the_file_or_the_folder_that_was_read(endoscope: Path, inputs: list[str], path: str | None):
    outline = read_outline(endoscope)
    made = replace(outline, provenance={**outline.provenance, "inputs": dict.fromkeys(inputs, "0" * 64)})
    assert path_of_recording(made) == (None if path is None else Path(path))


def test_the_offline_file_neither_offers_nor_names_the_recording(endoscope: Path):
    shown = open_shown(endoscope)
    data = frozen_data(shown)
    assert '"recording":""' in data
    assert str(endoscope.parent) not in data


def test_another_recording_in_its_place_is_not_read(endoscope: Path):
    recording = recording_of(read_outline(endoscope), endoscope)
    assert recording is not None
    reader = read(Reader(replace(recording, inputs=dict.fromkeys(recording.inputs, "0" * 64))))
    assert reader.state == "failed"
    assert "is not the recording that the panorama was made from" in reader.said


@pytest.mark.parametrize(
    ("place", "raised", "said"),
    [
        ("endoct.workbench.page.recorded.open_recording", MemoryError("8 GB"), "memory ran out"),
        ("threading.main_thread", None, "the program has ended"),
    ],
)
def test_reading_again_ends_where_it_cannot_go_on(
    endoscope: Path, monkeypatch: pytest.MonkeyPatch, place: str, raised: Exception | None, said: str
):
    def changed(*_: object, **__: object) -> Any:
        if raised is not None:
            raise raised
        return threading.Thread()  # one that is not alive

    recording = recording_of(read_outline(endoscope), endoscope)
    assert recording is not None
    monkeypatch.setattr(place, changed)
    reader = read(Reader(recording))
    assert reader.state == "failed"
    assert said in reader.said


def test_a_recording_where_nobody_may_look_is_none(endoscope: Path, monkeypatch: pytest.MonkeyPatch):
    def denied(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    outline = read_outline(endoscope)
    monkeypatch.setattr(Path, "exists", denied)
    assert recording_of(outline, endoscope) is None


def test_a_recording_is_found_from_another_folder(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It was named from the folder in which the output's folder lies, as people do, and `serve` runs elsewhere."""
    recorded = tmp_path / "study" / "bore" / "endoscope"
    shutil.copytree(short / "endoscope", recorded)
    (tmp_path / "study" / "results").mkdir()
    monkeypatch.chdir(tmp_path / "study")
    unroll(Path("bore/endoscope"), Path("results/endoscope.zarr"), progress=False)
    monkeypatch.chdir("/")
    shown = open_shown(tmp_path / "study" / "results" / "endoscope.zarr")
    assert shown.description.frames[0].recording == str(recorded)
    reader = shown.side("endoscope").reader
    assert reader is not None
    assert read(reader).state == "read", reader.said
    # another recording that lies there by now is none of this panorama's
    next(recorded.glob("*.png")).write_bytes(b"another")
    changed = open_shown(tmp_path / "study" / "results" / "endoscope.zarr").side("endoscope").reader
    assert changed is not None
    assert "is not the recording" in read(changed).said


def test_a_place_lies_on_the_ring_where_the_frame_shows_it(endoscope: Path):
    """The strip of a frame, unrolled by the plug-in, and the mark on the frame agree on which pixel shows a place."""
    outline = read_outline(endoscope)
    reader = read(Reader(recording_of(outline, endoscope)))  # type: ignore[arg-type]
    place = 5
    ring, (frame, strip) = ring_of(outline, place), reader.pictures(place)
    assert ring is not None
    samples = frame.image.mean(axis=2) if frame.image.ndim == 3 else frame.image.astype(float)
    theta_rad = np.linspace(*strip.x_extent, strip.image.shape[1])
    angle = theta_rad - ring["roll_rad"]
    along = []
    for share in np.linspace(0.4, 0.7, 9):
        x, y = (
            (1 - share) * (ring[f"inner_{axis}"] + ring["inner"] * turned(angle))
            + share * (ring[f"outer_{axis}"] + ring["outer"] * turned(angle))
            for axis, turned in (("x", np.cos), ("y", np.sin))
        )
        along.append(samples[np.rint(y).astype(int), np.rint(x).astype(int)])
    seen, unrolled = np.mean(along, axis=0), np.nanmean(strip.image, axis=0)
    turns = [np.corrcoef(np.roll(seen, k), unrolled)[0, 1] for k in range(seen.size)]
    best = (int(np.argmax(turns)) + seen.size // 2) % seen.size - seen.size // 2
    assert abs(best) <= seen.size / 60  # within 6°


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(0, 3)), min_size=1, max_size=3000))
def test_curves_stay_small(points: list[tuple[float, float]]):
    labels = {"x_label": "θ (rad)", "y_label": "z (mm)", "x_extent": (0.0, 6.2), "y_extent": (0.0, 2.5)}
    picture = Picture("a", "a", np.zeros((2, 2)), **labels, curves={"wall": np.array(points)})
    assert len(picture_json(picture, None)["curves"]["wall"]) <= 1000


@pytest.mark.parametrize("dtype", ["u1", "u2"])
def test_only_pictures_of_8_bits_are_shown_as_they_are(dtype: str):
    ramp = np.tile(np.linspace(100, 150, 64).astype(dtype), (64, 1))
    shown = picture_json(Picture("frame", "frame", ramp, "column (px)", "row (px)", (0, 63), (0, 63)), None)["image"]
    with Image.open(io.BytesIO(base64.b64decode(shown.split(",", 1)[1]))) as image:
        low, high = image.getextrema()
    assert (low < 10, high > 245) == (dtype == "u2", dtype == "u2")
