"""The tube to print: closed, of the stated size, its marks where its file says."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from endoct.base.errors import EndoctError
from endoct.modalities.tube.target import read_target
from endoct.workbench.calibrating.printed_tube import tube_mesh, tube_of, write_tube


@pytest.mark.parametrize("bore_mm", [1.8, 2.5])
def test_mesh_is_closed_and_to_scale(bore_mm: float) -> None:
    tube = tube_of(bore_mm)
    made = tube_mesh(tube)
    mesh = trimesh.Trimesh(made.points_mm, made.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    np.testing.assert_allclose(mesh.extents, [tube.outer_diameter_mm] * 2 + [tube.length_mm], atol=0.41)
    r = np.hypot(*made.points_mm[:, :2].T)
    theta, z = np.arctan2(made.points_mm[:, 1], made.points_mm[:, 0]), made.points_mm[:, 2]
    inner = r < tube.radius_mm + tube.ring_depth_mm + tube.groove_depth_mm + 0.1
    clear = np.abs(tube.ring_inside_mm(z)) > 0.01
    clear &= np.abs(tube.groove_inside_mm(z, theta)) > 0.01
    expected = tube.radius_mm + tube.relief_mm(z, theta)
    np.testing.assert_allclose(r[inner & clear], expected[inner & clear], atol=1e-4)


def test_folder_holds_file_mesh_and_drawing(tmp_path: Path) -> None:
    write_tube(tmp_path / "tube", bore_diameter_mm=2.0)
    assert read_target(tmp_path / "tube/tube.toml") == tube_of(2.0)
    assert (tmp_path / "tube/tube.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "tube/tube.stl").stat().st_size > 1000


def test_a_bore_that_cannot_be_printed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"no tube of that bore"):
        write_tube(tmp_path / "tube", bore_diameter_mm=0.5)
    assert not (tmp_path / "tube").exists()
