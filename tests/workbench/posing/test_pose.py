"""A bore is found where it is, and all that is handed over says so in the same world."""

import json
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
import trimesh
from pose_case import LENGTH_MM, NERVE_ASIDE_MM, NERVE_RADIUS_MM, RADIUS_MM, SEEN_MM, PoseCase

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.comparison import load_comparison
from endoct.modalities.ct.trajectory import read_line
from endoct.stitching.store import load_panorama
from endoct.workbench import pose, verify
from endoct.workbench.posing.result import NOTICE, PoseResult

MICROMETRE = 1e-3


def off_axis(result: PoseResult, place: Coordinates) -> float:
    """Return the distance of a place to the found axis, mm."""
    to_lps = result.answer.pose.bore_to_lps
    from_entry = place - to_lps[:3, 3]
    return float(np.linalg.norm(from_entry - (from_entry @ to_lps[:3, 2]) * to_lps[:3, 2]))


@pytest.mark.parametrize("depth_mm", [0.0, LENGTH_MM, LENGTH_MM + 5])
def test_the_axis_is_where_the_bore_was_drilled(case: PoseCase, found: PoseResult, depth_mm: float) -> None:
    true = case.to_lps[:3, 3] + depth_mm * case.to_lps[:3, 2]
    assert off_axis(found, true) < 0.15


def test_rows_lie_at_their_depth(case: PoseCase, found: PoseResult) -> None:
    to_lps = found.answer.pose.bore_to_lps
    for name in ("ranger", "camera"):
        for z, depth in zip((0.0, SEEN_MM[1] - SEEN_MM[0]), found.summary.ends_mm[name], strict=True):
            true = case.to_lps[:3, 3] + (z + SEEN_MM[0]) * case.to_lps[:3, 2]
            assert depth.value == pytest.approx((true - to_lps[:3, 3]) @ to_lps[:3, 2], abs=0.15)
            assert depth.low < depth.value < depth.high


def test_a_place_goes_to_the_panorama_and_back(case: PoseCase, found: PoseResult) -> None:
    bore = found.answer.pose
    local = np.array([[1.3, 0.2, 2.0], [-0.4, 1.1, 6.0], [0.9, -0.9, 11.0], [3.0, 1.0, 5.0]])
    marked = local @ case.to_lps[:3, :3].T + case.to_lps[:3, 3]
    to_bore = np.linalg.inv(bore.bore_to_lps)
    again = (marked @ to_bore[:3, :3].T + to_bore[:3, 3]) @ bore.bore_to_lps[:3, :3].T + bore.bore_to_lps[:3, 3]
    assert np.abs(again - marked).max() < MICROMETRE
    for name, turn_rad in (("ranger", 2.0), ("camera", 0.7)):
        theta, z, behind = bore.from_lps(name, marked)
        assert np.abs(bore.to_lps(name, theta, z, behind) - marked).max() < MICROMETRE
        # and it is the place that was marked: where the bone has it, there the panorama has it
        off = np.angle(np.exp(1j * (theta + turn_rad - np.arctan2(local[:, 1], local[:, 0]))))
        assert np.abs(off).max() * RADIUS_MM < 0.2
        assert z == pytest.approx(local[:, 2] - SEEN_MM[0], abs=0.2)


def test_the_file_says_what_was_found(files: Path, found: PoseResult, case: PoseCase) -> None:
    said = json.loads((files / "both" / "pose.json").read_text(encoding="utf-8"))
    assert said == json.loads(json.dumps(found.to_json()))
    assert (said["told"], said["reason"], said["best_unbelieved"]) == (True, None, None)
    assert (said["notice"], said["coordinates"], said["sides"]) == (NOTICE, "lps", ["ranger", "camera"])
    assert said["plan"]["entry_mm"] == pytest.approx(case.plan.entry_mm)
    assert np.allclose(said["pose"]["bore_to_world"], found.answer.pose.bore_to_lps)
    recess = case.to_lps[:3, 3] + (LENGTH_MM - 2) * case.to_lps[:3, 2] - case.plan.entry_mm
    assert said["pose"]["facial_recess"]["depth_mm"] == pytest.approx(recess @ case.to_lps[:3, 2], abs=0.4)
    (nerve,) = said["pose"]["structures"]
    true = NERVE_ASIDE_MM - NERVE_RADIUS_MM - RADIUS_MM
    assert nerve["name"] == "facial nerve"
    assert nerve["margin_mm"] == nerve["distance_mm"]["low"] < true < nerve["distance_mm"]["high"]
    assert nerve["distance_mm"]["high"] - nerve["distance_mm"]["low"] < 0.6
    assert {str(files / "ct.nrrd"), str(files / "labels.nrrd"), "ranger.tif", "camera.tif"} == set(said["inputs"])
    assert {"torch", "kornia", "SimpleITK", "endoct"} <= set(said["versions"])


def test_transforms_markups_and_meshes_lie_in_the_world_of_the_ct(files: Path, found: PoseResult) -> None:
    out, to_lps = files / "both", found.answer.pose.bore_to_lps
    place = np.array([0.5, -0.3, 7.0])
    expected = to_lps[:3, :3] @ place + to_lps[:3, 3]
    for name in ("bore_to_world.tfm", "bore_to_world.h5"):
        transform = sitk.ReadTransform(str(out / name))
        assert np.abs(np.array(transform.TransformPoint(place.tolist())) - expected).max() < MICROMETRE
    back = sitk.ReadTransform(str(out / "world_to_bore.tfm"))
    assert np.abs(np.array(back.TransformPoint(expected.tolist())) - place).max() < MICROMETRE
    line, convention = read_line(out / "trajectory.mrk.json")
    assert convention == "lps"
    assert np.abs(np.array(line.entry_mm) - to_lps[:3, 3]).max() < MICROMETRE
    assert np.abs(np.array(line.target_mm) - to_lps[:3, 3] - LENGTH_MM * to_lps[:3, 2]).max() < MICROMETRE
    assert read_line(out / "plan.mrk.json")[0] == found.answer.pose.plan
    for name in ("bore.ply", "bore.stl"):
        mesh = trimesh.load_mesh(out / name)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(np.pi * RADIUS_MM**2 * LENGTH_MM, rel=0.01)
        middle = to_lps[:3, 3] + LENGTH_MM / 2 * to_lps[:3, 2]
        assert np.abs(mesh.bounding_box.centroid - middle).max() < 0.1
        assert b"SPACE=LPS" in (out / name).read_bytes()[:400]


def test_the_prediction_is_a_comparison_that_agrees(files: Path, found: PoseResult) -> None:
    for name in ("ranger", "camera"):
        folder = files / "both" / "predicted" / name
        compared = load_comparison(folder / "comparison.zarr")
        assert compared.names == (name, "ct")
        assert compared.result.jaccard is not None
        assert compared.result.jaccard > 0.6
        assert load_panorama(folder / "panoramas" / "ct.zarr").modality == "ct"


def test_the_page_is_one_file_that_says_what_it_is_not_for(files: Path, found: PoseResult) -> None:
    page = (files / "both" / "report.html").read_text(encoding="utf-8")
    assert NOTICE in page
    assert page.count('<img src="data:image/') == 3
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "<script" not in page
    for said in ("facial nerve", "5 mm beyond the target", "ranger", "camera"):
        assert said in page
    assert {path.name for path in (files / "both" / "figures").iterdir()} == {
        "cut.png",
        "wall-ranger.png",
        "wall-camera.png",
    }


def test_one_processor_finds_the_same_and_writes_the_same(
    files: Path, found: PoseResult, case: PoseCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # both sides here, one after the other
    again = pose(
        [case.panorama("ranger", turn_rad=2.0, columns=96), files / "camera.zarr"],
        files / "ct.nrrd",
        tmp_path / "again",
        entry_mm=case.plan.entry_mm,
        target_mm=case.plan.target_mm,
        labels=files / "labels.nrrd",
        progress=False,
    )
    assert again.to_json() | {"seconds": {}} == found.to_json() | {"seconds": {}}
    for drawn in (files / "both" / "figures").iterdir():
        assert (tmp_path / "again" / "figures" / drawn.name).read_bytes() == drawn.read_bytes()


def test_the_output_is_replaced_only_on_request(files: Path, found: PoseResult, case: PoseCase) -> None:
    del found
    assert verify(files / "both")
    options = {"entry_mm": case.plan.entry_mm, "target_mm": case.plan.target_mm, "progress": False}
    with pytest.raises(EndoctError, match="exists already"):
        pose([files / "camera.zarr"], files / "ct.nrrd", files / "both", **options)  # type: ignore[arg-type]
    with pytest.raises(EndoctError, match="is or contains the input"):
        pose([files / "camera.zarr"], files / "ct.nrrd", files, overwrite=True, **options)  # type: ignore[arg-type]


def test_voxels_in_another_order_or_convention_give_the_same_answer(
    case: PoseCase, files: Path, by_camera: PoseResult, tmp_path: Path
) -> None:
    turned = case.write_ct(tmp_path / "turned.nii.gz", turned=True)
    found = pose(
        [files / "camera.zarr"],
        turned,
        entry_mm=mirrored(case.plan.entry_mm),
        target_mm=mirrored(case.plan.target_mm),
        progress=False,
    )
    assert found.coordinates == "ras"
    assert by_camera.coordinates == "lps"
    assert np.abs(found.answer.pose.bore_to_lps - by_camera.answer.pose.bore_to_lps).max() < 2e-3
    said = np.array(found.to_json()["pose"]["bore_to_world"])
    assert np.allclose(np.diag([-1.0, -1.0, 1.0, 1.0]) @ said, found.answer.pose.bore_to_lps)


def mirrored(place: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = place
    return -x, -y, z
