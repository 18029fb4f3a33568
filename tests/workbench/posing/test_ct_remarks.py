"""What was mended in a CT or is doubted of it reaches the console, the JSON and the report; its files are inputs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from pose_case import AIR_HU, BONE_HU, ORIGIN, SHAPE, VOXEL_MM, PoseCase, text
from scipy import ndimage
from tolerances import AIR_SAME

import endoct.fusion.pose.outlook as rehearsals
from benchmarks.ct_faults.writing import enhanced, save, write_series
from endoct.base.files.files import sha256_of
from endoct.fusion.pose.air import air_around
from endoct.fusion.pose.finding import PoseAnswer
from endoct.modalities.ct.ct_volume import read_ct
from endoct.workbench.posing import steps
from endoct.workbench.posing.result import PoseResult

Command = Callable[..., tuple[int, list[str], str]]
TILT_DEG = 15.0


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch, by_camera: PoseResult) -> None:
    before = by_camera.answer
    answer = PoseAnswer(before.pose, before.alone, None, (7.5,))
    monkeypatch.setattr(steps, "find", lambda *_: answer)


@pytest.fixture(scope="module")
def tilted(case: PoseCase, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The CT of the case as a scanner with a tilted gantry takes it, as DICOM."""
    aside = VOXEL_MM * np.tan(np.radians(TILT_DEG))
    hounsfield = BONE_HU + (AIR_HU - BONE_HU) * case.air.astype(np.float64)
    slices = []
    for k in range(SHAPE[0]):
        rows = np.arange(SHAPE[1]) + (k - SHAPE[0] // 2) * aside / VOXEL_MM
        index = np.meshgrid([k], rows, np.arange(SHAPE[2]), indexing="ij")
        values = ndimage.map_coordinates(hounsfield, index, order=3, mode="nearest")[0]
        slices.append(
            {
                "name": f"{k}.dcm", "values": np.rint(values).astype(np.int16), "InstanceNumber": k + 1,
                "ImagePositionPatient": [ORIGIN[0], float(ORIGIN[1] + rows[0] * VOXEL_MM), ORIGIN[2] + k * VOXEL_MM],
                "ImageOrientationPatient": [1, 0, 0, 0, 1, 0], "PixelSpacing": [VOXEL_MM] * 2, "RescaleSlope": 1,
                "RescaleIntercept": 0, "GantryDetectorTilt": TILT_DEG, "SliceThickness": VOXEL_MM,
            }
        )  # fmt: skip
    return write_series(tmp_path_factory.mktemp("tilted") / "series", slices)


def plan_of(case: PoseCase) -> list[str]:
    return [f"--entry={text(case.plan.entry_mm)}", f"--target={text(case.plan.target_mm)}"]


def test_the_air_of_a_tilted_ct_is_that_of_an_upright_one(case: PoseCase, files: Path, tilted: Path) -> None:
    upright = air_around(read_ct(files / "ct.nrrd"), case.plan).values[0, 0].numpy()
    askew = air_around(read_ct(tilted), case.plan).values[0, 0].numpy()
    middle = (slice(20, -20), slice(30, -30), slice(30, -30))  # what both saw
    assert np.abs(upright - askew)[middle].mean() < 0.01
    assert np.corrcoef(upright[middle].ravel(), askew[middle].ravel())[0, 1] > 0.998


def slices_of(case: PoseCase) -> list[dict[str, Any]]:
    values = np.rint(BONE_HU + (AIR_HU - BONE_HU) * case.air).astype(np.int16)
    return [
        {
            "name": f"{k}.dcm", "values": values[k], "InstanceNumber": k + 1, "PixelSpacing": [VOXEL_MM] * 2,
            "ImagePositionPatient": [ORIGIN[0], ORIGIN[1], float(ORIGIN[2] + k * VOXEL_MM)],
            "ImageOrientationPatient": [1, 0, 0, 0, 1, 0], "RescaleSlope": 1, "RescaleIntercept": 0,
        }
        for k in range(SHAPE[0])
    ]  # fmt: skip


def in_microns(case: PoseCase, path: Path) -> Path:
    image: Any = nibabel.load(case.write_ct(path))
    to_ras = image.affine * np.array([[1000.0]] * 3 + [[1.0]])
    changed = nibabel.Nifti1Image(np.asarray(image.dataobj), to_ras)
    changed.header.set_xyzt_units("micron")
    changed.set_sform(to_ras, 1)
    changed.set_qform(to_ras, 1)
    nibabel.save(changed, path)
    return path


@pytest.mark.parametrize("kind", ["series", "scout", "inverted", "enhanced", "microns", "mha", "mhd"])
def test_the_air_around_the_plan_is_the_same_in_every_container(
    case: PoseCase, files: Path, tmp_path: Path, kind: str
) -> None:
    slices = slices_of(case)
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
        path = in_microns(case, tmp_path / "ct.nii.gz") if kind == "microns" else case.write_ct(tmp_path / f"ct.{kind}")
    expected = air_around(read_ct(files / "ct.nrrd"), case.plan).values
    assert float((air_around(read_ct(path), case.plan).values - expected).abs().max()) < AIR_SAME


@pytest.mark.usefixtures("answered")
def test_a_mended_tilt_is_said_everywhere(
    command: Command, files: Path, case: PoseCase, tilted: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    status, errors, printed = command(files / "camera.zarr", "--ct", tilted, *plan_of(case), "-o", out)
    assert (status, errors) == (0, [])
    assert "note (CT): The gantry was tilted by 15.0°" in printed
    said = json.loads((out / "pose.json").read_text(encoding="utf-8"))
    assert said["volumes"]["ct"]["notes"][0].startswith("The gantry was tilted by 15.0°")
    assert said["doubts"] == []
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "1 note" in page
    assert "The gantry was tilted by 15.0°" in page


@pytest.mark.usefixtures("answered")
def test_a_doubted_ct_is_said_everywhere(
    command: Command, files: Path, case: PoseCase, tilted: Path, tmp_path: Path
) -> None:
    series = tmp_path / "series"
    series.mkdir()
    for path in tilted.iterdir():
        (series / path.name).write_bytes(path.read_bytes().replace(b"15.0", b"0.00"))
    status, errors, printed = command(
        files / "camera.zarr", "--ct", series, *plan_of(case), "--labels", files / "labels.nrrd", "-o", tmp_path / "out"
    )
    assert (status, errors) == (0, [])
    assert "doubt: Slices of" in printed
    said = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
    (doubt,) = said["volumes"]["ct"]["doubts"]
    assert (doubt["code"], [doubt["what"]]) == ("ct-slices-askew", said["doubts"])
    assert said["volumes"]["labels"]["labels"] == {"1": "bone", "2": "facial nerve"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "with 1 doubt" in page
    assert "ct-slices-askew" in page


def test_before_drilling_it_is_said_as_well(
    monkeypatch: pytest.MonkeyPatch, command: Command, case: PoseCase, tilted: Path, tmp_path: Path
) -> None:
    monkeypatch.setattr(rehearsals, "REHEARSALS", 1)
    out = tmp_path / "out"
    status, errors, printed = command("--plan-only", "--ct", tilted, *plan_of(case), "-o", out)
    assert (status, errors) == (0, [])
    assert "note (CT): The gantry was tilted by 15.0°" in printed
    said = json.loads((out / "outlook.json").read_text(encoding="utf-8"))
    assert (said["doubts"], len(said["volumes"]["ct"]["notes"])) == ([], 1)
    assert "The gantry was tilted" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("answered")
def test_labels_are_named_by_a_table_and_all_files_are_inputs(
    command: Command, files: Path, case: PoseCase, tmp_path: Path
) -> None:
    ct, labels = case.write_ct(tmp_path / "ct.mhd"), case.write_ct(tmp_path / "labels.nii.gz", labels=True)
    words = (
        files / "camera.zarr",
        "--ct",
        ct,
        *plan_of(case),
        "--labels",
        labels,
        "--overwrite",
        "-o",
        tmp_path / "out",
    )

    def structures() -> dict[str, Any]:
        said = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
        return said | {"names": [one["name"] for one in said["pose"]["structures"]]}

    status, _, printed = command(*words)
    assert status == 0
    assert structures()["names"] == ["unknown label 1", "unknown label 2"]
    assert "doubt: Labels without a name: 1, 2." in printed
    assert command(*words, "--label-names", "endoct")[0] == 0
    assert structures()["names"] == ["facial nerve"]
    assert structures()["pose"]["facial_recess"] is not None
    table = tmp_path / "my.ctbl"
    table.write_text("1 temporal_bone 1 2 3 255\n2 cochlea 1 2 3 255\n")
    assert command(*words, "--label-names", table)[0] == 0
    said = structures()
    assert (said["names"], said["pose"]["facial_recess"]) == (["cochlea"], None)
    inputs = {Path(name).name: digest for name, digest in said["inputs"].items()}
    for path in (ct, tmp_path / "ct.raw", labels, table):
        assert inputs[path.name] == sha256_of(path)
    without = (files / "camera.zarr", "--ct", ct, *plan_of(case), "-o", tmp_path / "other", "--label-names", "endoct")
    assert "no labels to be named" in command(*without)[1][0]


FAULTS: dict[str, Callable[[list[dict[str, Any]]], None]] = {
    "8.dcm": lambda slices: slices.pop(9),  # a gap after it
    "5.dcm": lambda slices: slices[5].update(ImagePositionPatient=slices[4]["ImagePositionPatient"]),
    "7.dcm": lambda slices: slices[7].update(values=slices[7]["values"][:-4]),
    "3.dcm": lambda slices: slices[3].pop("ImagePositionPatient"),
    "11.dcm": lambda slices: slices[11].update(ImageOrientationPatient=[1, 0, 0, 0, 0, -1]),
}
"""By the slice that is to be named."""


@pytest.mark.parametrize("named", FAULTS)
@pytest.mark.parametrize("before_drilling", [False, True])
def test_a_faulty_series_is_one_line_and_leaves_nothing(
    command: Command, files: Path, case: PoseCase, tmp_path: Path, named: str, before_drilling: bool
) -> None:
    slices = slices_of(case)
    FAULTS[named](slices)
    series = write_series(tmp_path / "series", slices)
    side = ["--plan-only"] if before_drilling else [files / "camera.zarr"]
    status, errors, _ = command(*side, "--ct", series, *plan_of(case), "-o", tmp_path / "out")
    assert (status, len(errors)) == (1, 1)
    assert named in errors[0]
    assert not (tmp_path / "out").exists()
