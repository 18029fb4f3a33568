"""What is known of a recording at the door: by whom each key is stated, and how often files are asked."""

import shutil
from pathlib import Path

import pytest

from endoct.base.errors import EndoctError
from endoct.modalities import recognition, registry
from endoct.modalities.acquisition import read_toml
from endoct.modalities.reading.format import Stated
from endoct.modalities.recognition import CONTRADICTED, STATED, recognise


@pytest.fixture
def pullback(small_specimen: Path, tmp_path: Path) -> Path:
    """A pullback whose sidecar cites a calibration, and says nothing of the plug-in."""
    folder = tmp_path / "oct"
    shutil.copytree(small_specimen / "oct", folder)
    lines = (folder / "acquisition.toml").read_text().splitlines()
    cited = [line for line in lines if line.startswith("axial_pixel_mm")]
    own = [line for line in lines if line not in cited and not line.startswith("modality")]
    (folder / "mine.toml").write_text("\n".join(cited))
    (folder / "acquisition.toml").write_text("\n".join([*own, 'calibration = "mine.toml"']))
    return folder


def test_every_key_has_the_source_that_states_it(pullback: Path) -> None:
    recognised = recognise(pullback)
    assert recognised.manifest.name == "oct"
    assert set(recognised.cited) == {"axial_pixel_mm"}
    assert recognised.own == read_toml(pullback / "acquisition.toml")
    assert recognised.keys["axial_pixel_mm"] == recognised.cited["axial_pixel_mm"]
    assert recognised.keys["modality"] == "oct"
    assert recognised.missing == {}
    assert recognised.format == "TIFF"
    assert recognised.acquisition({"bore_diameter_mm": 1.8}).bore_diameter_mm == 1.8


def test_what_a_sidecar_says_wins_over_what_files_state(pullback: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stated = Stated({"axial_pixel_mm": 9.0, "bore_diameter_mm": 9.0, "theta_origin_rad": 0.5}, "its header")
    monkeypatch.setattr(recognition, "stated_keys", lambda *_: stated)
    recognised = recognise(pullback)
    assert recognised.keys["axial_pixel_mm"] == recognised.cited["axial_pixel_mm"] < 1
    assert recognised.keys["bore_diameter_mm"] == recognised.own["bore_diameter_mm"] < 9
    assert recognised.keys["theta_origin_rad"] == 0.5


def test_how_sure_it_is_depends_on_who_said_it(pullback: Path, small_specimen: Path) -> None:
    assert recognise(pullback).certainty == "likely"
    assert not recognise(pullback).says_modality
    assert recognise(small_specimen / "oct").certainty == STATED
    assert recognise(pullback, "oct").certainty == STATED
    assert recognise(pullback, "endoscope").certainty == CONTRADICTED


def test_files_and_sidecar_are_asked_once(pullback: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def counted(name: str, of: object) -> None:
        function = getattr(of, name)
        monkeypatch.setattr(of, name, lambda *given: (asked.append(name), function(*given))[1])

    counted("sniffed", registry)
    counted("sniffed", recognition)
    counted("read_toml", recognition)
    recognised = recognise(pullback)
    assert recognised.certainty == "likely"
    assert recognised.needs == ()
    assert len(recognised.open()) > 1
    assert asked.count("sniffed") == len(registry.manifests())
    assert asked.count("read_toml") == 1


def test_a_path_that_nothing_reads_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="does not exist"):
        recognise(tmp_path / "none")
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(EndoctError, match="no modality reads"):
        recognise(tmp_path / "notes.txt")
