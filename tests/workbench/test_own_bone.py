"""From a volume of the user's to both recordings and back: options, replaying, and one line for what cannot be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk
from bone_volumes import CELL, CELL_RADIUS_MM, ENTRY, ORIGIN, RAS, SIZE, TARGET, VOXEL_MM, block, point, stated, tilted
from scipy import ndimage
from tolerances import CT_PLACE_MM

from benchmarks.ct_faults.writing import enhanced, save, write_series
from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.patient import Bone, bone_around
from endoct.workbench import simulate
from endoct.workbench.cli import main
from endoct.workbench.settings import parse_place


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "endoct-output.json"
    }


def text(place: tuple[float, float, float]) -> str:
    return ",".join(f"{value!r}" for value in place)


def test_a_bore_in_a_volume_is_replayed_to_the_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    volume = block(tmp_path / "block.nii.gz")
    entry, target = text(point(RAS * ENTRY)), text(point(RAS * TARGET))
    words = ["simulate", "-o", str(tmp_path / "one"), "--preset", "learning", "--seed", "3", "--bone", str(volume)]
    monkeypatch.setattr("sys.argv", ["endoct", *words, f"--entry={entry}", f"--target={target}", "--detail", "0.004"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    simulate(tmp_path / "two", replay=tmp_path / "one/truth/sample.json", progress=False)
    assert files(tmp_path / "one") == files(tmp_path / "two")
    world = json.loads((tmp_path / "one/truth/recording.json").read_text(encoding="utf-8"))["world"]
    assert world["coordinates"] == "ras"
    assert world["entry_mm"] == pytest.approx(point(RAS * ENTRY))
    assert world["target_mm"] == pytest.approx(point(RAS * TARGET))
    stated = json.loads((tmp_path / "one/truth/sample.json").read_text(encoding="utf-8"))["bore"]["volume"]
    assert (stated["bone_hu"], stated["bone_label"], stated["detail_mm"]) == (300.0, None, 0.004)


def test_what_is_doubted_of_a_bone_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    series = tilted(tmp_path / "series", 12.0)
    words = ["simulate", "-o", str(tmp_path / "out"), "--preset", "learning", "--seed", "3", "--bone", str(series)]
    monkeypatch.setattr(
        "sys.argv", ["endoct", *words, f"--entry={text(point(ENTRY))}", f"--target={text(point(TARGET))}"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "note: The gantry was tilted by 12.0°" in capsys.readouterr().out


def slices_of_block(folder: Path) -> list[dict[str, Any]]:
    """Return the block's slices as they are written into DICOM files."""
    voxels = sitk.GetArrayFromImage(sitk.ReadImage(str(block(folder / "as-nrrd.nrrd"))))
    return [
        {
            "name": f"{k}.dcm", "values": voxels[k], "InstanceNumber": k + 1, "PixelSpacing": [VOXEL_MM] * 2,
            "ImagePositionPatient": [ORIGIN[0], ORIGIN[1], float(ORIGIN[2] + k * VOXEL_MM)],
            "ImageOrientationPatient": [1, 0, 0, 0, 1, 0], "RescaleSlope": 1, "RescaleIntercept": 0,
        }
        for k in range(SIZE)
    ]  # fmt: skip


@pytest.mark.parametrize("kind", ["scout", "inverted", "enhanced", "nii.gz"])
def test_a_bore_runs_through_the_same_bone_in_every_container(kind: str, tmp_path: Path) -> None:
    slices = slices_of_block(tmp_path)
    if kind == "scout":
        scout = {"name": "scout", "ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]}
        slices.append(slices[3] | scout | {"ImageOrientationPatient": [1, 0, 0, 0, 0, -1]})
    elif kind == "inverted":
        slices = [one | {"PhotometricInterpretation": "MONOCHROME1"} for one in slices]
    if kind in ("series", "scout", "inverted"):
        path = write_series(tmp_path / "series", slices)
    elif kind == "enhanced":
        path = tmp_path / "ct.dcm"
        save(enhanced(slices), path)
    else:
        path = block(tmp_path / f"ct.{kind}")
    # the voxels around a bore may be one more or less, by rounding
    expected, found = (air_near_cell(bone_around(stated(one), 3.0)) for one in (tmp_path / "as-nrrd.nrrd", path))
    np.testing.assert_allclose(found, expected, atol=CT_PLACE_MM)


def air_near_cell(bone: Bone) -> Coordinates:
    """Return the distance to the wall of the cell at places within it, where it is that of the nearest surface."""
    aside = np.random.default_rng(0).normal(size=(200, 3))
    places = CELL + (CELL_RADIUS_MM - 0.1) * aside / np.linalg.norm(aside, axis=1, keepdims=True)
    return ndimage.map_coordinates(bone.distance_mm, bone.lattice.index_of(places).T, order=1)


def test_a_series_with_a_gap_is_no_bone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slices = slices_of_block(tmp_path)
    del slices[30]
    series = write_series(tmp_path / "series", slices)
    words = ["simulate", "-o", str(tmp_path / "out"), "--preset", "learning", "--seed", "3", "--bone", str(series)]
    places = [f"--entry={text(point(ENTRY))}", f"--target={text(point(TARGET))}"]
    monkeypatch.setattr("sys.argv", ["endoct", *words, *places])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("endoct:")]
    assert "between 29.dcm and 31.dcm" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--bone", "{}"], "not said where to drill"),
        (["--entry=1,2,3", "--target=1,2,30"], "not said what to drill into"),
        (["--bone", "{}", "--entry=1,2", "--target=1,2,3"], "--entry is no place"),
        (["--bone", "missing.nrrd", "--entry=1,2,3", "--target=1,2,30"], "no such file"),
        (["--bone", "{}", "--entry=1,2,3", "--target=1,2,30"], "the entry lies outside the volume"),
        (["--ct", "--preset", "quick"], "three dimensions only"),
    ],
)
def test_what_cannot_be_is_said_in_one_line_and_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    volume = block(tmp_path / "block.nrrd")
    words = [option.format(volume) for option in options]
    monkeypatch.setattr("sys.argv", ["endoct", "simulate", "-o", str(tmp_path / "out"), *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("endoct:")]
    assert len(lines) == 1
    assert message in lines[0]
    assert not (tmp_path / "out").exists()


def test_places_are_three_numbers() -> None:
    assert parse_place("entry", "-1.5, 2,3e1") == (-1.5, 2.0, 30.0)
    assert parse_place("entry", None) is None
    for wrong in ("", "1,2", "1,2,3,4", "1,2,x", "1,2,nan"):
        with pytest.raises(EndoctError, match="no place"):
            parse_place("target", wrong)
