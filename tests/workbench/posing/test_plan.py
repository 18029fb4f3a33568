"""The CT and its plan in one world, whatever the convention of either file."""

import json
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from pose_case import PoseCase

from endoct.workbench.posing.plan import PlannedBore, read_plan

SIGNS = {"LPS": np.ones(3), "RAS": np.array([-1.0, -1.0, 1.0])}


def in_lps(planned: PlannedBore) -> tuple[np.ndarray, np.ndarray]:
    """Return the world places of the corner voxels and of the plan, whatever the order of voxels."""
    shape, ct = np.array(planned.ct.voxels.shape) - 1, planned.ct
    corners = np.array([np.array(corner) * shape for corner in np.ndindex(2, 2, 2)]) @ ct.steps_mm + ct.origin_mm
    return np.sort(corners, axis=0), np.array([planned.plan.entry_mm, planned.plan.target_mm])


def markups(path: Path, case: PoseCase, system: str) -> Path:
    points = [
        {"id": "1", "label": "F-1", "position": (SIGNS[system] * case.plan.entry_mm).tolist()},
        {"id": "2", "label": "F-2", "position": (SIGNS[system] * case.plan.target_mm).tolist()},
    ]
    markup = {"type": "Line", "coordinateSystem": system, "controlPoints": points}
    path.write_text(json.dumps({"markups": [markup]}), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["ct.nii.gz", "ct.mha", "ct.nrrd", "turned.nii.gz", "turned.nrrd", "ras.nrrd"])
@pytest.mark.parametrize("system", ["LPS", "RAS"])
def test_every_way_of_saying_it_is_the_same_world(case: PoseCase, tmp_path: Path, name: str, system: str) -> None:
    path = tmp_path / name
    case.write_ct(path, turned=name.startswith("turned"))
    if name == "ras.nrrd":
        in_ras(path)
    expected = read_plan(case.write_ct(tmp_path / "plain.mha"), case.plan.entry_mm, case.plan.target_mm, None, None)
    planned = read_plan(path, None, None, markups(tmp_path / "plan.mrk.json", case, system), None)
    assert planned.coordinates == system.lower()
    assert "No label in plan.mrk.json says which point is the entry" in planned.ct.notes[-1]
    for one, other in zip(in_lps(planned), in_lps(expected), strict=True):
        assert np.abs(one - other).max() < 1e-4


def in_ras(path: Path) -> None:
    """Have an NRRD say its own numbers in RAS: another space, and the first two numbers of every vector negated."""
    header, _, data = path.read_bytes().partition(b"\n\n")
    lines = []
    for line in header.decode("ascii").split("\n"):
        field, _, value = line.partition(": ")
        if field == "space":
            value = "right-anterior-superior"
        elif field in ("space directions", "space origin"):
            vectors = [np.array(one.strip("()").split(","), float) for one in value.split()]
            value = " ".join(f"({','.join(repr(float(v)) for v in SIGNS['RAS'] * one)})" for one in vectors)
        lines.append(f"{field}: {value}" if value else line)
    path.write_bytes("\n".join(lines).encode("ascii") + b"\n\n" + data)


def test_a_ras_nrrd_is_read_as_simpleitk_has_it(case: PoseCase, tmp_path: Path) -> None:
    path = case.write_ct(tmp_path / "ct.nrrd")
    before = np.array(sitk.ReadImage(str(path)).GetOrigin())
    in_ras(path)
    assert np.allclose(sitk.ReadImage(str(path)).GetOrigin(), before)
