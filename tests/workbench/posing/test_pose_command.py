"""The command: its exit statuses, one line for what cannot be, nothing half-written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import SimpleITK as sitk
from pose_case import PoseCase, text

from endoct.base.errors import EndoctError
from endoct.fusion.pose.finding import PoseAnswer
from endoct.modalities.ct.trajectory import Trajectory, write_line
from endoct.stitching.store import save_panorama
from endoct.workbench import compare, verify
from endoct.workbench.page.report import write_report
from endoct.workbench.posing import steps
from endoct.workbench.posing.result import PoseResult

Command = Callable[..., tuple[int, list[str], str]]


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch, by_camera: PoseResult) -> Callable[[str | None], None]:
    """Have the pose that was found before be the answer, told or not."""

    def answer(reason: str | None) -> None:
        before = by_camera.answer

        def find(*_: Any) -> PoseAnswer:
            return PoseAnswer(before.pose, before.alone, reason, (7.5,))

        monkeypatch.setattr(steps, "find", find)

    return answer


def plan_of(case: PoseCase) -> list[str]:
    return [f"--entry={text(case.plan.entry_mm)}", f"--target={text(case.plan.target_mm)}"]


def test_told_is_0_and_says_where(
    command: Command, answered: Callable[[str | None], None], files: Path, case: PoseCase, tmp_path: Path
) -> None:
    answered(None)
    out = tmp_path / "out"
    labels = ("--labels", files / "labels.nrrd")
    status, errors, printed = command(
        files / "camera.zarr", "--ct", files / "ct.nrrd", *plan_of(case), *labels, "-o", out
    )
    assert (status, errors) == (0, [])
    assert "offset from the plan" in printed
    assert "facial nerve" in printed
    assert "not for clinical decisions" in printed
    assert (out / "bore_to_world.tfm").is_file()
    status, errors, _ = command(files / "camera.zarr", "--ct", files / "ct.nrrd", *plan_of(case), "-o", out)
    assert status == 1
    assert "exists already; choose another output, or replace it with --overwrite" in errors[0]
    status, _, printed = command(
        files / "camera.zarr", "--ct", files / "ct.nrrd", *plan_of(case), "-o", out, "--overwrite", "--json"
    )
    assert status == 0
    assert json.loads(printed)["pose"]["structures"] == []


def test_untold_is_3_and_hands_no_pose_over(
    command: Command, answered: Callable[[str | None], None], files: Path, case: PoseCase, tmp_path: Path
) -> None:
    answered("No pose stands out.")
    out = tmp_path / "out"
    status, errors, printed = command(files / "camera.zarr", "--ct", files / "ct.nrrd", *plan_of(case), "-o", out)
    assert (status, errors) == (3, [])
    assert "cannot be told: No pose stands out." in printed
    assert "offset" not in printed
    said = json.loads((out / "pose.json").read_text(encoding="utf-8"))
    assert (said["told"], said["reason"], said["pose"]) == (False, "No pose stands out.", None)
    assert said["best_unbelieved"]["by_side"]["camera"]["standing"] == 7.5
    there = {path.name for path in out.iterdir()}
    assert there == {"pose.json", "plan.mrk.json", "predicted", "figures", "report.html", "endoct-output.json"}
    assert "No pose stands out." in (out / "report.html").read_text(encoding="utf-8")


def test_an_open_handedness_is_said_first_everywhere(
    command: Command, case: PoseCase, files: Path, tmp_path: Path
) -> None:
    """An instrument with depth that does not say which way its θ runs, by itself."""
    save_panorama(replace(case.panorama("ranger"), handedness_known=False), tmp_path / "ranger.zarr")
    words = (tmp_path / "ranger.zarr", "--ct", files / "ct.nrrd", *plan_of(case), "-o", tmp_path / "out")
    status, errors, printed = command(*words)
    assert (status, errors) == (0, [])
    assert printed.startswith("doubt: the sense of θ of ranger is not known: a mirrored CT")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    above = page.partition("<header")[2].partition("</header>")[0].partition('<details class="how"')[0]
    assert "Told by ranger if the CT is not mirrored, with " in above
    assert above.index("the sense of θ of ranger is not known") < above.index("<code>handedness-open</code>")
    markup = json.loads((tmp_path / "out" / "trajectory.mrk.json").read_text(encoding="utf-8"))["markups"][0]
    assert markup["name"] == "bore (doubted: see report.html)"
    status, _, printed = command(*words, "--overwrite", "--strict", "--json")
    said = json.loads(printed)
    assert (status, said["told"], said["doubt_codes"][0]) == (3, True, "handedness-open")
    assert "the sense of θ of ranger is not known" in said["doubts"][0]
    assert said["pose"] is not None


def test_a_plan_as_markups_is_the_same_plan(
    command: Command, answered: Callable[[str | None], None], files: Path, case: PoseCase, tmp_path: Path
) -> None:
    answered(None)
    write_line(case.plan, "plan", tmp_path / "plan.mrk.json")
    words = (files / "camera.zarr", "--ct", files / "ct.nrrd", "--plan", tmp_path / "plan.mrk.json")
    status, errors, _ = command(*words, "-o", tmp_path / "out")
    assert (status, errors) == (0, [])
    said = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
    assert said["plan"]["entry_mm"] == pytest.approx(case.plan.entry_mm)


def test_one_side_of_a_comparison_is_a_side(
    command: Command, answered: Callable[[str | None], None], files: Path, case: PoseCase, tmp_path: Path
) -> None:
    answered(None)
    compared = tmp_path / "compared"
    (compared / "comparison.zarr").mkdir(parents=True)
    (compared / "panoramas").mkdir()
    shutil.copytree(files / "camera.zarr", compared / "panoramas" / "camera.zarr")
    plan = ("--ct", files / "ct.nrrd", *plan_of(case), "-o", tmp_path / "out")
    assert command(f"{compared}:camera", *plan)[0] == 0
    assert "name one of them" in command(compared, *plan, "--overwrite")[1][0]
    assert "no such side; found oct; expected camera" in command(f"{compared}:oct", *plan, "--overwrite")[1][0]


@pytest.mark.usefixtures("without_report")
def test_a_side_of_a_comparison_that_endoct_made_is_a_side(
    command: Command, answered: Callable[[str | None], None], files: Path, case: PoseCase, tmp_path: Path
) -> None:
    answered(None)
    compared = tmp_path / "compared"
    ranger = case.panorama("ranger", turn_rad=2.0, columns=96)
    compare(files / "camera.zarr", ranger, compared, settings={"n_theta": 512}, progress=False)
    plan = ("--ct", files / "ct.nrrd", *plan_of(case), "-o", tmp_path / "out")
    assert command(f"{compared}:camera", *plan)[:2] == (0, [])
    said = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
    assert said["sides"] == ["camera"]
    assert "name one of them" in command(compared, *plan, "--overwrite")[1][0]
    assert "found oct; expected camera, ranger" in command(f"{compared}:oct", *plan, "--overwrite")[1][0]
    assert verify(compared)[0].intact


def test_what_the_pose_predicts_has_no_report_of_its_own_but_a_copy_has(
    files: Path, found: PoseResult, tmp_path: Path
) -> None:
    del found
    folder = files / "both" / "predicted" / "camera"
    with pytest.raises(EndoctError, match=r"is a part of both.*endoct serve.*a copy"):
        write_report(folder)
    assert verify(files / "both")[0].intact
    shutil.copytree(folder, tmp_path / "copy")
    assert write_report(tmp_path / "copy").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{camera}", "--ct", "missing.nrrd", "{plan}"], "no such file"),
        (["{camera}", "--ct", "{camera}", "{plan}"], "is no volume"),
        (["{camera}", "--ct", "{ct}"], "not said where the bore was planned"),
        (["{camera}", "--ct", "{ct}", "--entry=1,2,3"], "both --entry=x,y,z and --target=x,y,z"),
        (["{camera}", "--ct", "{ct}", "--entry=1,2", "--target=1,2,3"], "--entry is no place"),
        (["{camera}", "--ct", "{ct}", "--entry=1,2,3", "--target=1,2,30"], "the entry lies outside the CT"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--coordinates", "ras"], "lies outside the CT"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--plan", "plan.mrk.json"], "the plan is given twice"),
        (["{camera}", "--ct", "{ct}", "--plan", "{ct}"], "is no JSON"),
        (["{camera}", "--ct", "{sheared}", "{plan}"], "do not lie at right angles"),
        (["{camera}", "--ct", "{unsaid}", "{plan}"], "RAS or LPS"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--labels", "{ct}"], "the labels are none"),
        (["{camera}", "{camera}", "--ct", "{ct}", "{plan}"], "compared with itself"),
        (["{camera}", "{camera}", "{camera}", "--ct", "{ct}", "{plan}"], "one side or two"),
        (["missing.zarr", "--ct", "{ct}", "{plan}"], "missing.zarr"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--set-a", "undistort=sine"], "settings for recordings only"),
        (["{mask}", "--ct", "{ct}", "{plan}"], "a mask drawn by hand"),
        (["{camera}", "--ct", "{ct}", "{plan}", "--device", "cuda"], "no CUDA device"),
    ],
)
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    command: Command,
    files: Path,
    case: PoseCase,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    paths = {"camera": files / "camera.zarr", "ct": files / "ct.nrrd"}
    if "{sheared}" in words:
        paths["sheared"] = case.write_ct(tmp_path / "sheared.nrrd", sheared=True)
    if "{unsaid}" in words:
        header, _, data = (files / "ct.nrrd").read_bytes().partition(b"\n\n")
        lines = [b"space dimension: 3" if one.startswith(b"space: ") else one for one in header.split(b"\n")]
        paths["unsaid"] = tmp_path / "unsaid.nrrd"
        paths["unsaid"].write_bytes(b"\n".join(lines) + b"\n\n" + data)
    if "{mask}" in words:
        import numpy as np
        from PIL import Image

        paths["mask"] = tmp_path / "mask.png"
        Image.fromarray((np.indices((40, 60)).sum(axis=0) % 2 * 255).astype(np.uint8)).save(paths["mask"])
    said = [part for word in words for part in (plan_of(case) if word == "{plan}" else [word.format(**paths)])]
    status, errors, _ = command(*said, "-o", tmp_path / "out")
    assert status == 1
    assert len(errors) == 1
    assert message in errors[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ct", "{other_patient}", "{plan}"], "the entry lies outside the CT"),
        (["--ct", "{ct}", "--plan", "{far}"], "the entry lies outside the CT"),
        (["--ct", "{shares}", "{plan}"], "the CT may hold Hounsfield units, or labels"),
        (["--ct", "{air}", "{plan}"], "there is no bone around the plan"),
        (["--ct", "{ct}", "{plan}", "--labels", "{elsewhere}"], "no labelled structure near the plan"),
        (["--ct", "{ct}", "{plan}", "--labels", "missing.nrrd"], "missing.nrrd"),
    ],
)
def test_a_volume_of_another_world_is_one_line_and_leaves_nothing(
    command: Command, files: Path, case: PoseCase, tmp_path: Path, words: list[str], message: str
) -> None:
    def changed(name: str, change: Callable[[sitk.Image], sitk.Image]) -> Path:
        """Write a volume of the case as ``name``, changed."""
        path = tmp_path / f"{name}.nrrd"
        source = "labels" if name == "elsewhere" else "ct"
        sitk.WriteImage(change(sitk.ReadImage(str(files / f"{source}.nrrd"))), str(path))
        return path

    def moved(image: sitk.Image) -> sitk.Image:
        image.SetOrigin([place + 60.0 for place in image.GetOrigin()])
        return image

    volumes: dict[str, Callable[[sitk.Image], sitk.Image]] = {
        "other_patient": moved,
        "elsewhere": moved,
        "shares": lambda image: sitk.Cast(image, sitk.sitkFloat32) / 4000 + 0.5,
        "air": lambda image: image * 0 - 1000,
    }
    paths = {"ct": files / "ct.nrrd", "far": tmp_path / "far.mrk.json"}
    paths |= {name: changed(name, change) for name, change in volumes.items() if f"{{{name}}}" in words}
    write_line(Trajectory((0, 0, 500), (0, 0, 530)), "far", paths["far"])
    said = [part for word in words for part in (plan_of(case) if word == "{plan}" else [word.format(**paths)])]
    status, errors, _ = command(files / "camera.zarr", *said, "-o", tmp_path / "out")
    assert status == 1
    assert len(errors) == 1
    assert message in errors[0]
    assert not (tmp_path / "out").exists()
