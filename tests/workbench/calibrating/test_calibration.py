"""endoct calibrate from end to end: a simulated tube, the file it gives, and recordings that are no tube's."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from matplotlib.figure import Figure
from printed_tube import TUBE

from endoct.base.errors import EndoctError
from endoct.modalities.tube.measurement import Measurement, Panel, Quantity
from endoct.synthetic.specimen import simulate
from endoct.workbench.calibrating.calibration import calibrate, write_figure
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


def test_the_figure_shows_points_and_lines_and_says_what_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = np.arange(9000.0)
    line = np.array([[2.0, 5.0], [1.0, 4.0], [3.0, 7.0]])
    panels = tuple(Panel(f"panel {k}", f"x {k}", f"y {k}", x, 2 * x + k, line if k == 1 else None) for k in range(4))
    measured = Measurement({}, (Quantity("a_mm", "length", 1.23456789, 0.0123, "mm"),), panels)
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    write_figure(measured, tmp_path / "figure.png")
    *shown, last = drawn[0].axes
    assert [each.get_title() for each in shown] == [f"panel {k}" for k in range(4)]
    assert [(each.get_xlabel(), each.get_ylabel()) for each in shown] == [(f"x {k}", f"y {k}") for k in range(4)]
    places = [each.get_subplotspec().rowspan.start * 3 + each.get_subplotspec().colspan.start for each in shown]
    assert places == [0, 1, 2, 3]
    for k, each in enumerate(shown):
        points = each.lines[0]
        assert np.array_equal(points.get_ydata(), 2 * points.get_xdata() + k)
        assert 4000 <= len(points.get_xdata()) <= 4500
        assert len(each.lines) == 1 + (k == 1)
    assert shown[1].lines[1].get_xydata().tolist() == [[1, 4], [2, 5], [3, 7]]
    assert last.texts[0].get_text() == "length: 1.23457 ± 0.012 mm"
