"""endoct calibrate from end to end: a simulated tube, the file it gives, and recordings that are no tube's."""

import json
import math
import tomllib
from pathlib import Path

import pytest
import tomlkit
from printed_tube import TUBE

from endoct.base.errors import EndoctError
from endoct.synthetic.specimen import simulate
from endoct.workbench.calibrating.calibration import calibrate
from endoct.workbench.cli import main


@pytest.fixture
def tube_file(tmp_path: Path) -> Path:
    path = tmp_path / "tube.toml"
    path.write_text(tomlkit.dumps(TUBE.model_dump(mode="json")))
    return path


def stated_bore(recording: Path, tmp_path: Path, tube_file: Path) -> Path:
    """The tube's file with the bore that a recording's sidecar states."""
    stated = tomllib.loads((recording / "acquisition.toml").read_text())["bore_diameter_mm"]
    path = tmp_path / "same-bore.toml"
    path.write_text(tomlkit.dumps({**tomllib.loads(tube_file.read_text()), "bore_diameter_mm": stated}))
    return path


@pytest.mark.parametrize("modality", ["oct", "endoscope"])
def test_a_bore_is_no_tube(modality: str, quick_specimen: Path, tmp_path: Path, tube_file: Path) -> None:
    output, recording = tmp_path / "calibration.toml", quick_specimen / modality
    with pytest.raises(EndoctError, match=r"marks of the tube are not seen|which way the tube lies"):
        calibrate(modality, recording, target=stated_bore(recording, tmp_path, tube_file), output=output)
    assert not output.exists()
    assert not output.with_suffix(".png").exists()


def test_another_diameter_is_refused_in_one_line(
    quick_specimen: Path,
    tmp_path: Path,
    tube_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wide = tmp_path / "wide.toml"
    wide.write_text(tomlkit.dumps({**tomllib.loads(tube_file.read_text()), "bore_diameter_mm": 3.0}))
    output = tmp_path / "calibration.toml"
    command = ["endoct", "calibrate", "oct", str(quick_specimen / "oct"), "--target", str(wide), "-o", str(output)]
    monkeypatch.setattr("sys.argv", command)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "not that of the tube" in lines[0]
    assert not output.exists()


@pytest.mark.slow
def test_a_simulated_tube_is_measured(tmp_path: Path) -> None:
    specimen = tmp_path / "specimen"
    simulate(specimen, preset="tube", seed=30)
    truth = json.loads((specimen / "truth/sample.json").read_text())
    for modality in ("oct", "endoscope"):
        output = tmp_path / f"{modality}.toml"
        measured = calibrate(modality, specimen / modality, target=specimen / "tube.toml", output=output)
        written = tomllib.loads(output.read_text())
        assert output.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
        assert written["standard_errors"].keys() <= written.keys()
        assert written["travel"] == truth[modality]["travel"]
        by_name = {each.name: each for each in measured.quantities}
        name, true = {
            "oct": ("axial_pixel_mm", truth["oct"]["axial_pixel_mm"]),
            "endoscope": ("visible_length_mm", truth["endoscope"]["visible_length_mm"]),
        }[modality]
        assert abs(by_name[name].value - true) < 3.5 * by_name[name].sigma
        assert by_name[name].sigma < 0.03 * true
        # the file is one that sidecars can cite
        sidecar = specimen / modality / "acquisition.toml"
        keys = {k: v for k, v in tomllib.loads(sidecar.read_text()).items() if k not in written}
        sidecar.write_text(tomlkit.dumps(keys | {"calibration": "calibration.toml"}))
        (specimen / modality / "calibration.toml").write_text(output.read_text())
        again = calibrate(
            modality, specimen / modality, target=specimen / "tube.toml", output=tmp_path / f"{modality}2.toml"
        )
        of_again = {each.name: each for each in again.quantities}[name]
        assert math.isclose(of_again.value, by_name[name].value, abs_tol=by_name[name].sigma)
