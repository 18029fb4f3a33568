"""Which plug-in reads a path, and what is said where none or several do."""

import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest

from endoct.base.errors import EndoctError
from endoct.modalities import registry
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Manifest, Sniff
from endoct.modalities.recognition import open_recording, recognise


class Reader:
    """A modality that claims folders holding a file of its name, as sure as the file says."""

    def __init__(self, name: str) -> None:
        self.name = name

    def sniff(self, path: Path) -> Sniff:
        claims = (path / self.name).exists()
        reason = f"{'a' if claims else 'no'} file {self.name}"
        if claims and (path / self.name).read_text() == "unsure":
            return Sniff(claims, reason, "unsure")
        return Sniff(claims, reason)

    def open(self, path: Path, acquisition: Acquisition) -> SimpleNamespace:
        return SimpleNamespace(path=path, acquisition=acquisition)


LIDAR, SONAR = Reader("lidar"), Reader("sonar")


def manifest(name: str) -> Manifest:
    return Manifest(
        name=name,
        title=name.title(),
        suffixes=(f".{name}",),
        acquisition=Acquisition,
        provides=frozenset({"depth"}),
        frame_dim="sweep",
        implementation=f"{__name__}:{name.upper()}",
    )


LIDAR_MANIFEST, SONAR_MANIFEST = manifest("lidar"), manifest("sonar")
MISNAMED = manifest("other")


def install(monkeypatch: pytest.MonkeyPatch, **entries: str) -> None:
    """Make the named attributes of this module the only installed plug-ins."""
    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__) or SimpleNamespace(**globals()))
    points = [EntryPoint(name, f"{__name__}:{value}", registry.GROUP) for name, value in entries.items()]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)


@pytest.fixture(autouse=True)
def _two_plug_ins(monkeypatch: pytest.MonkeyPatch):
    install(monkeypatch, sonar="SONAR_MANIFEST", lidar="LIDAR_MANIFEST")
    registry.manifests.cache_clear()
    yield
    registry.manifests.cache_clear()


def test_every_plug_in_is_found_by_name() -> None:
    assert registry.manifests() == {"lidar": LIDAR_MANIFEST, "sonar": SONAR_MANIFEST}


def test_content_decides_where_nobody_says(tmp_path: Path) -> None:
    (tmp_path / "sonar").touch()
    assert recognise(tmp_path).manifest is SONAR_MANIFEST


def test_the_sidecar_beats_the_content_and_the_user_beats_both(tmp_path: Path) -> None:
    (tmp_path / "sonar").touch()
    (tmp_path / "acquisition.toml").write_text('modality = "lidar"\n')
    assert recognise(tmp_path).manifest is LIDAR_MANIFEST
    assert recognise(tmp_path, "sonar").manifest is SONAR_MANIFEST


def test_two_that_claim_one_path_are_both_named(tmp_path: Path) -> None:
    (tmp_path / "sonar").touch()
    (tmp_path / "lidar").touch()
    with pytest.raises(EndoctError, match=r"could be lidar or sonar.*modality='NAME'"):
        recognise(tmp_path)


def test_of_two_that_claim_one_path_the_surer_reads_it(tmp_path: Path) -> None:
    (tmp_path / "sonar").touch()
    (tmp_path / "lidar").write_text("unsure")
    assert recognise(tmp_path).manifest is SONAR_MANIFEST
    (tmp_path / "sonar").write_text("unsure")
    with pytest.raises(EndoctError, match="could be lidar or sonar"):
        recognise(tmp_path)


def test_none_gives_every_reason(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"no modality reads .*lidar: no file lidar, sonar: no file sonar"):
        recognise(tmp_path)


def test_unknown_names_and_missing_paths(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="unknown modality 'radar'; expected one of lidar, sonar"):
        recognise(tmp_path, "radar")
    with pytest.raises(EndoctError, match="does not exist"):
        recognise(tmp_path / "missing")


def test_opening_needs_a_sidecar_and_overrides_replace_its_keys(tmp_path: Path) -> None:
    (tmp_path / "sonar").touch()
    with pytest.raises(EndoctError, match=r"has no acquisition.toml.*--write-sidecar"):
        open_recording(tmp_path)
    assert open_recording(tmp_path, overrides={"bore_diameter_mm": 1.8})[1].acquisition.bore_diameter_mm == 1.8
    (tmp_path / "acquisition.toml").write_text("bore_diameter_mm = 2.5\n")
    for wrong in ("abc", -1.0):
        with pytest.raises(EndoctError, match=r"^'bore_diameter_mm' in the settings cannot be used"):
            open_recording(tmp_path, overrides={"bore_diameter_mm": wrong})
    found, stream = open_recording(tmp_path, overrides={"bore_diameter_mm": 1.8})
    assert found is SONAR_MANIFEST
    assert stream.acquisition == Acquisition(modality="sonar", bore_diameter_mm=1.8)
    (tmp_path / "acquisition.toml").write_text("bore_diameter_mm = 'abc'\n")
    with pytest.raises(EndoctError, match=r"^'bore_diameter_mm' in \S+/acquisition.toml cannot be used"):
        open_recording(tmp_path)


def test_a_command_to_type_has_its_path_in_quotes(tmp_path: Path) -> None:
    folder = tmp_path / "left ear"
    folder.mkdir()
    (folder / "sonar").touch()
    with pytest.raises(EndoctError) as refused:
        open_recording(folder)
    assert f"`endoct info '{folder}' --write-sidecar`" in str(refused.value)


@pytest.mark.parametrize("value", ["NOTHING", "LIDAR", "MISNAMED"])
def test_a_broken_plug_in_is_named(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, lidar=value)
    with pytest.raises(EndoctError, match=r"'lidar'.*remove"):
        registry.manifests()


def test_an_implementation_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = Manifest(**{**vars(LIDAR_MANIFEST), "implementation": "no_such_module:LIDAR"})
    with pytest.raises(EndoctError, match="'lidar' cannot be loaded; found No module named 'no_such_module'"):
        broken.load()


def test_the_registry_imports_neither_torch_nor_opencv() -> None:
    script = "import sys; from endoct.modalities.registry import manifests; print(sorted(manifests()))"
    script += "; print(sorted({'torch', 'cv2', 'scipy', 'skimage', 'matplotlib', 'xarray'} & sys.modules.keys()))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    names, heavy = run.stdout.splitlines()
    assert names == "['endoscope', 'oct', 'unrolled']"
    assert heavy == "[]"


def test_a_modality_that_is_no_text_is_said(tmp_path: Path) -> None:
    (tmp_path / "acquisition.toml").write_text('modality = ["oct"]\n')
    with pytest.raises(EndoctError, match="is no name"):
        recognise(tmp_path)
