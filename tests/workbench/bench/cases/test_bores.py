"""Cases of bores in a CT: conditions do what they say, and a folder of one's own is read."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pose_case import LENGTH_MM, SEEN_MM, PoseCase

from benchmarks.pose import nearest_the_end, sector
from endoct.base.errors import EndoctError
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.modalities.ct.ct_volume import SIGNS
from endoct.modalities.ct.trajectory import Trajectory, write_line
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import save_panorama
from endoct.workbench.bench.cases.bores import own_cases, plan_off, posed_case
from endoct.workbench.pipeline.truth import TruePose

TURN_RAD = 0.7


@pytest.fixture(scope="module")
def bore() -> PoseCase:
    return PoseCase.drawn()


@pytest.fixture(scope="module")
def panorama(bore: PoseCase) -> Panorama:
    """What the camera sees, as one made of frames that the truth knows."""
    made = bore.panorama("camera", turn_rad=TURN_RAD, columns=64)
    frames = np.arange(made.grid.n_z)
    return replace(
        made,
        per_frame={
            **made.per_frame,
            "frame_index": PerFrame(frames, "", "frame"),
            "roll_rad": PerFrame(np.zeros(frames.size), "rad", "roll"),
        },
    )


@pytest.fixture(scope="module")
def specimen(bore: PoseCase, panorama: Panorama, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `endoct simulate --ct` writes it, with the panorama at hand."""
    folder = tmp_path_factory.mktemp("bores") / "n7"
    (folder / "truth").mkdir(parents=True)
    save_panorama(panorama, folder / "camera.zarr")
    bore.write_ct(folder / "truth" / "ct.nii.gz")
    theta = 2 * np.pi / 8 * np.arange(8)
    write_arrays(
        folder / "truth" / "wall.zarr",
        {
            "z": Named(("z",), np.array([0.0, LENGTH_MM])),
            "theta": Named(("theta",), theta),
            "cell": Named(("z", "theta"), np.zeros((2, 8), np.bool_)),
        },
        {},
    )
    recording = {
        "world": {"coordinates": "ras", "bore_to_world": (np.diag([*SIGNS["ras"], 1]) @ bore.to_lps).tolist()},
        "camera": {
            "z_mm": (panorama.z_mm + SEEN_MM[0]).tolist(),
            "roll_rad": [TURN_RAD] * panorama.grid.n_z,
        },
    }
    (folder / "truth" / "recording.json").write_text(json.dumps(recording))
    (folder / "truth" / "sample.json").write_text(json.dumps({"seed": 7, "bore": {"length_mm": LENGTH_MM}}))
    return folder


def test_a_plan_lies_off_the_bore_by_what_is_said_and_no_more(bore: PoseCase) -> None:
    plans = [plan_off(bore.to_lps, LENGTH_MM, 1.0, 2.0, np.random.default_rng(seed)) for seed in range(200)]
    entries = np.array([plan.entry_mm for plan in plans]) - bore.to_lps[:3, 3]
    aside = np.linalg.norm(entries @ bore.to_lps[:3, :2], axis=1)
    along = np.abs(entries @ bore.to_lps[:3, 2])
    tilt = np.degrees([np.arccos(plan.to_lps[:3, 2] @ bore.to_lps[:3, 2]) for plan in plans])
    for values, most in ((aside, 1.0), (along, 1.0), (tilt, 2.0)):
        assert 0.9 * most < values.max() <= most
    assert [plan.length_mm for plan in plans] == pytest.approx([LENGTH_MM] * 200)


def test_a_specimen_becomes_a_case_whose_truth_is_its_bore(bore: PoseCase, specimen: Path) -> None:
    case, again, other = (posed_case(specimen, ["camera"], seed=seed) for seed in (3, 3, 4))
    assert case.truth.to_lps == pytest.approx(bore.to_lps)
    assert case.truth.length_mm == LENGTH_MM
    assert case.truth.sides[0].z_bore(np.zeros(1)) == pytest.approx([SEEN_MM[0]])
    assert case.truth.sides[0].theta_bore(np.zeros(1)) == pytest.approx([TURN_RAD])
    assert case.given[2] == again.given[2] != other.given[2]


def test_what_is_seen_is_what_lies_nearest_the_end(panorama: Panorama) -> None:
    pose = TruePose(0.0, 1, panorama.z_mm, panorama.z_mm + SEEN_MM[0])
    left = nearest_the_end(panorama, pose, 4.05)
    assert left.z_mm[-1] == panorama.z_mm[-1]
    assert left.z_mm[0] == pytest.approx(panorama.z_mm[-1] - 4.0)
    assert np.array_equal(left.intensity, panorama.intensity[-left.grid.n_z :])
    assert np.array_equal(left.per_frame["frame_index"].values, np.arange(panorama.grid.n_z)[-left.grid.n_z :])
    # one that was recorded from the other end keeps its first rows
    reversed_pose = TruePose(0.0, 1, panorama.z_mm, SEEN_MM[1] - panorama.z_mm)
    assert nearest_the_end(panorama, reversed_pose, 4.0).z_mm[0] == panorama.z_mm[0]
    with pytest.raises(EndoctError, match="leave nothing"):
        nearest_the_end(panorama, reversed_pose, 0.01)


def test_a_share_of_the_wall_is_one_sector(panorama: Panorama) -> None:
    (seen,) = sector(panorama, TruePose(0.3, 1, panorama.z_mm, panorama.z_mm), 6.0, 0.5)
    assert seen.sum() == pytest.approx(32, abs=1)
    assert np.abs(np.diff(np.append(seen, seen[0]).astype(int))).sum() == 2


def test_a_specimen_of_ones_own_needs_no_plan(specimen: Path) -> None:
    (case,) = own_cases(specimen)
    assert case.name == "n7-camera"
    assert case.given[2] == posed_case(specimen, ["camera"], seed=7).given[2]


def test_a_folder_of_ones_own_has_the_true_line(bore: PoseCase, tmp_path: Path) -> None:
    folder = tmp_path / "head"
    (folder / "truth").mkdir(parents=True)
    for modality in ("camera", "ranger"):
        save_panorama(bore.panorama(modality, columns=64), folder / f"{modality}.zarr")
    bore.write_ct(folder / "ct.nrrd")
    with pytest.raises(EndoctError, match="no truth"):
        own_cases(folder)
    ends = [bore.to_lps[:3, 3] + z * bore.to_lps[:3, 2] for z in (0.0, LENGTH_MM)]
    true = Trajectory(*(tuple(map(float, end)) for end in ends))  # type: ignore[arg-type]
    write_line(true, "bore", folder / "truth" / "bore.mrk.json")
    with pytest.raises(EndoctError, match="no plan"):
        own_cases(folder)
    write_line(bore.plan, "plan", folder / "plan.mrk.json")
    cases = own_cases(folder)
    assert [case.conditions["sides"] for case in cases] == ["both", "camera", "ranger"]
    assert [one.modality for one in cases[0].given[0]] == ["camera", "ranger"]
    assert cases[0].truth.axis_lps(LENGTH_MM) == pytest.approx(ends[1])
    assert cases[0].given[2].entry_mm == pytest.approx(bore.plan.entry_mm)
    (folder / "ct.nrrd").unlink()
    with pytest.raises(EndoctError, match="no CT"):
        own_cases(folder)
