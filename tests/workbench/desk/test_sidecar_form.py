"""A sidecar as a form: every key with its meaning, and only what was changed is written."""

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import tifffile
import tomlkit

from endoct.base.errors import EndoctError
from endoct.workbench.desk.desk_app import MOST_THREADS
from endoct.workbench.desk.sidecar_form import MOST_AT_ONCE, Previewer, sidecar_form

MINE = """# written by hand
bore_diameter_mm = 2.5   # the drill's
modality = "endoscope"

# measured with calipers
feed_pitch_mm = 0.2
visible_length_mm = 0.786229
outer_rim = "ahead"
"""


@pytest.fixture
def endoscope(study: Path) -> Path:
    return study / "bore-1" / "endoscope"


def test_only_what_was_changed_is_written(endoscope: Path):
    sidecar = endoscope / "acquisition.toml"
    sidecar.write_text(MINE)
    form = sidecar_form(endoscope)
    form.save({"bore_diameter_mm": "2.55", "travel": "in", "visible_length_mm": ""}, form.digest)
    expected = MINE.replace("2.5 ", "2.55 ").replace("visible_length_mm = 0.786229\n", "")
    assert sidecar.read_text() == expected + 'travel = "in"\n'


def test_positions_of_many_frames_are_shown_and_saved_number_by_number(
    endoscope: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*_: object) -> None:
        raise AssertionError("minutes for many numbers")

    monkeypatch.setattr(tomlkit.items.Array, "append", slow)
    monkeypatch.setattr(tomlkit.items.Array, "insert", slow)
    places = [0.2 * k for k in range(4000)]
    sidecar = endoscope / "acquisition.toml"
    sidecar.write_text(f"{MINE}positions_mm = {places}\n")
    form = sidecar_form(endoscope)
    (shown,) = (field["value"] for field in form.to_json()["fields"] if field["key"] == "positions_mm")
    assert shown == str(places)
    form.save({"positions_mm": str(places[::-1]), "theta_origin_rad": "0.5"}, form.digest)
    assert sidecar.read_text() == f"{MINE}positions_mm = {places[::-1]}\ntheta_origin_rad = 0.5\n"


def test_a_form_says_what_is_needed_and_what_one_will_do(endoscope: Path):
    (endoscope / "acquisition.toml").unlink()
    form = sidecar_form(endoscope)
    assert form.digest is None
    assert list(form.missing({})) == [
        "bore_diameter_mm",
        next(key for key in form.missing({}) if key.startswith("one of")),
    ]
    assert list(form.missing({"bore_diameter_mm": "2.55"})) == [list(form.missing({}))[1]]
    assert form.missing({"bore_diameter_mm": "2.55", "feed_pitch_mm": "0.2"}) == {}
    fields = {field["key"]: field for field in form.to_json()["fields"]}
    assert (fields["bore_diameter_mm"]["unit"], fields["bore_diameter_mm"]["required"]) == ("mm", True)
    assert (fields["bore_diameter_mm"]["low"], fields["bore_diameter_mm"]["high"]) == (0.1, 100)
    assert fields["travel"]["choices"] == ["in", "out", "unknown"]
    assert fields["feed_pitch_mm"]["one_of"]
    form.save({"bore_diameter_mm": "2.55", "feed_pitch_mm": "0.2"}, None)
    assert sidecar_form(endoscope).missing({}) == {}


def test_what_was_changed_meanwhile_stays(endoscope: Path):
    form = sidecar_form(endoscope)
    (endoscope / "acquisition.toml").write_text(MINE)
    with pytest.raises(EndoctError, match="was changed meanwhile"):
        form.save({"bore_diameter_mm": "2.6"}, form.digest)
    assert (endoscope / "acquisition.toml").read_text() == MINE
    (endoscope / "acquisition.toml").unlink()
    with pytest.raises(EndoctError, match="was changed meanwhile"):
        form.save({"bore_diameter_mm": "2.6"}, form.digest)
    assert not (endoscope / "acquisition.toml").exists()


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ({"bore_diameter_mm": "wide"}, "'bore_diameter_mm' cannot be used"),
        ({"bore_diameter_mm": "2,55"}, "'bore_diameter_mm' cannot be used"),
        ({"bore_diameter_mm": "-1"}, "expected 0.1 to 100 mm"),
        ({"bore_diameter_mm": "2.5\nmodality = 'oct'"}, "'bore_diameter_mm' cannot be used"),
        ({"travel": "sideways"}, "'travel'"),
        ({"colour": "red"}, "is no key of 'endoscope'"),
        ({"bore_diameter_mm": 2}, "is no key of 'endoscope', or has no value"),
    ],
)
def test_what_cannot_be_used_is_refused_and_nothing_is_written(endoscope: Path, texts: dict[str, object], said: str):
    before = (endoscope / "acquisition.toml").read_bytes()
    form = sidecar_form(endoscope)
    with pytest.raises(EndoctError, match=said):
        form.save(texts, form.digest)
    assert (endoscope / "acquisition.toml").read_bytes() == before


def test_a_frame_is_drawn_as_the_form_has_it(study: Path):
    previewer = Previewer()
    try:
        oct_path = study / "bore-1" / "oct"
        drawn = previewer.preview(oct_path, None, {}, 0.5)
        assert (drawn["missing"], drawn["fault"], drawn["frame"], drawn["frames"]) == ({}, "", 6, 13)
        assert {"wall", "outer face of the capillary"} <= set(drawn["pictures"][0]["curves"])
        wrong = previewer.preview(oct_path, None, {"axial_pixel_mm": "0.1"}, 0.0)
        assert "capillary" in wrong["fault"]
        assert [picture["title"] for picture in wrong["pictures"]] == ["as its file holds it"]
        last = previewer.preview(study / "bore-1" / "endoscope", None, {}, 1.0)
        assert (last["frame"], set(last["pictures"][0]["curves"])) == (12, {"inner rim", "outer rim"})
        with pytest.raises(EndoctError, match="cannot be used"):
            previewer.preview(oct_path, None, {"axial_pixel_mm": "x"}, 0.5)
        (oct_path / "acquisition.toml").unlink()
        bare = previewer.preview(oct_path, "oct", {}, 0.5)
        assert "axial_pixel_mm" in bare["missing"]
        assert [picture["x_label"] for picture in bare["pictures"]] == ["column"]  # stretched to be seen
        (study / "bore-1" / "endoscope" / "acquisition.toml").unlink()
        frame = previewer.preview(study / "bore-1" / "endoscope", "endoscope", {}, 0.5)["pictures"][0]
        assert (frame["x_label"], frame["y_label"]) == ("column (px)", "row (px)")  # keeps its shape
    finally:
        previewer.close()


class Slow:
    """A process that answers when it is told to."""

    def __init__(self) -> None:
        self.answers = Future[dict[str, str]]()
        self.calls = 0

    @contextmanager
    def lent(self) -> Iterator["Slow"]:
        """Take the place of :func:`worker_process`."""
        yield self

    def call(self, *_: object) -> Future[dict[str, str]]:
        """Return the same answer to all."""
        self.calls += 1
        return self.answers


def test_previews_leave_threads_for_other_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    slow = Slow()
    monkeypatch.setattr("endoct.workbench.desk.sidecar_form.worker_process", slow.lent)
    assert 2 <= MOST_AT_ONCE <= MOST_THREADS // 2
    previewer = Previewer()
    with ThreadPoolExecutor(MOST_AT_ONCE) as pool:
        asked = [pool.submit(previewer.preview, tmp_path, None, {}, 0.5) for _ in range(MOST_AT_ONCE)]
        while previewer._room._value:  # all of them are under way
            time.sleep(0.01)
        with pytest.raises(EndoctError, match="other frames are being drawn"):
            previewer.preview(tmp_path, None, {}, 0.5)
        slow.answers.set_result({"fault": ""})
        assert [each.result() for each in asked] == [{"fault": ""}] * MOST_AT_ONCE
    assert previewer.preview(tmp_path, None, {}, 0.5) == {"fault": ""}
    previewer.close()


def test_where_memory_ran_out_the_next_preview_has_a_new_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    full, then = Slow(), Slow()
    full.answers.set_exception(MemoryError())
    then.answers.set_result({"fault": ""})
    processes = iter([full, then])
    monkeypatch.setattr("endoct.workbench.desk.sidecar_form.worker_process", lambda: next(processes).lent())
    previewer = Previewer()
    with pytest.raises(MemoryError):
        previewer.preview(tmp_path, None, {}, 0.5)
    assert previewer.preview(tmp_path, None, {}, 0.5) == {"fault": ""}
    assert (full.calls, then.calls) == (1, 1)
    previewer.close()


def test_nothing_wrong_is_saved_while_something_is_missing(endoscope: Path):
    (endoscope / "acquisition.toml").unlink()
    form = sidecar_form(endoscope)
    for texts in ({"bore_diameter_mm": "0"}, {"bore_diameter_mm": '"wide"'}, {"visible_length_mm": "-3"}):
        with pytest.raises(EndoctError, match="cannot be used"):
            form.save(texts, None)
    assert not (endoscope / "acquisition.toml").exists()
    form.save({"bore_diameter_mm": "2.5"}, None)
    assert "bore_diameter_mm = 2.5" in (endoscope / "acquisition.toml").read_text()


def test_a_key_of_the_cited_calibration_is_kept_in_one_place(endoscope: Path):
    sidecar = endoscope / "acquisition.toml"
    sidecar.write_text(MINE.replace("visible_length_mm", "# ") + 'calibration = "mine.toml"\n')
    (endoscope / "mine.toml").write_text("visible_length_mm = 0.786\n")
    form = sidecar_form(endoscope)
    assert form.acquisition({}).model_dump()["visible_length_mm"] == 0.786
    before = sidecar.read_bytes()
    with pytest.raises(EndoctError, match=r"stands in both .* and mine\.toml"):
        form.save({"visible_length_mm": "0.8"}, form.digest)
    assert sidecar.read_bytes() == before
    without = {"calibration": "", "visible_length_mm": "0.8"}  # a draft that cites nothing reads nothing
    assert form.acquisition(without).model_dump()["visible_length_mm"] == 0.8
    form.save(without, form.digest)
    assert sidecar_form(endoscope).missing({}) == {}


def test_one_sidecar_is_not_made_that_of_another_recording(tmp_path: Path):
    for name in ("one", "two"):
        tifffile.imwrite(tmp_path / f"{name}.tif", np.zeros((3, 20, 30), np.uint8), photometric="minisblack")
    form = sidecar_form(tmp_path / "one.tif", "endoscope")
    form.save({"bore_diameter_mm": "2.5"}, None)
    before = (tmp_path / "acquisition.toml").read_bytes()
    other = sidecar_form(tmp_path / "two.tif", "oct")
    with pytest.raises(EndoctError, match="a folder of its own"):
        other.save({"axial_pixel_mm": "0.005"}, other.digest)
    assert (tmp_path / "acquisition.toml").read_bytes() == before


def test_a_table_is_one_line_and_stays_as_it_is(endoscope: Path):
    sidecar = endoscope / "acquisition.toml"
    table = "standard_errors = { bore_diameter_mm = 0.1, feed_pitch_mm = 0.01 }\r\n"
    sidecar.write_bytes((MINE.replace("\n", "\r\n") + table).encode())
    form = sidecar_form(endoscope)
    text = next(field["value"] for field in form.to_json()["fields"] if field["key"] == "standard_errors")
    assert text == "{bore_diameter_mm = 0.1, feed_pitch_mm = 0.01}"
    assert form.drafted({"standard_errors": text})["standard_errors"] == form.recognised.own["standard_errors"]
    form.save({"travel": "in"}, form.digest)
    saved = sidecar.read_bytes().decode()
    assert table in saved
    assert "\n" not in saved.replace("\r\n", "") or saved.count("\n") - saved.count("\r\n") == 1  # of the new key
