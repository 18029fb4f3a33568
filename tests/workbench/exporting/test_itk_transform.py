"""Transforms for ITK: a point of one side is the point of the other that the alignment says."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment, Bend
from endoct.workbench.exporting.itk_transform import affine_of, write_itk_transform
from endoct.workbench.running.progress import SilentStages

BEND_MM = 2e-3
"""A field is sampled every 0.02 mm and is linear in between."""


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_a_point_is_taken_where_the_alignment_puts_it(
    tmp_path: Path, mirrored: bool, z_reversed: bool, inverse: bool
) -> None:
    alignment = Alignment(0.7, 0.3, mirrored=mirrored, z_scale=1.02, z_reversed=z_reversed)
    source: Any = SimpleNamespace(kind="comparison", alignment=alignment, sides=("endoscope", "oct"), path=tmp_path)
    said = write_itk_transform(source, tmp_path / "a.tfm", SimpleNamespace(inverse=inverse), SilentStages())  # type: ignore[arg-type]
    read = sitk.ReadTransform(str(tmp_path / "a.tfm"))
    theta_rad, z_mm, r_mm = 1.2, 2.5, 1.25
    in_b = r_mm * np.cos(theta_rad), r_mm * np.sin(theta_rad), z_mm
    theta_a = float(alignment.theta_to_a(theta_rad))
    in_a = r_mm * np.cos(theta_a), r_mm * np.sin(theta_a), float(alignment.z_to_a(z_mm))
    start, end = (in_a, in_b) if inverse else (in_b, in_a)
    assert read.TransformPoint(start) == pytest.approx(end)
    assert (said["from"], said["to"]) == (("endoscope", "oct") if inverse else ("oct", "endoscope"))
    assert f"in the bore frame of {said['from']} to that of {said['to']}" in (tmp_path / "a.tfm").read_text()
    matrix, offset = affine_of(alignment)
    assert abs(np.linalg.det(matrix)) == pytest.approx(1.02)
    assert offset.tolist() == [0, 0, 0.3]


@pytest.mark.parametrize(("changed", "said"), [({"kind": "panorama"}, "has no alignment"), ({}, "are not aligned")])
def test_without_an_alignment_there_is_none(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    source: Any = SimpleNamespace(**{"kind": "comparison", "alignment": None, "path": tmp_path, **changed})
    with pytest.raises(EndoctError, match=said):
        write_itk_transform(source, tmp_path / "a.tfm", SimpleNamespace(inverse=False), SilentStages())  # type: ignore[arg-type]
    assert not (tmp_path / "a.tfm").exists()


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_a_bend_follows_the_affine_part(tmp_path: Path, mirrored: bool, z_reversed: bool, inverse: bool) -> None:
    bend = Bend((1.0, 2.0, 5.0), (0.0, 0.2, -0.1), (0.0, 0.3, 0.1), (0.0,) * 3, (0.0,) * 3)
    alignment = Alignment(0.7, 2.3, mirrored=mirrored, z_scale=1.02, z_reversed=z_reversed, bend=bend)
    source: Any = SimpleNamespace(kind="comparison", alignment=alignment, sides=("endoscope", "oct"), path=tmp_path)
    said = write_itk_transform(source, tmp_path / "a.tfm", SimpleNamespace(inverse=inverse), SilentStages())  # type: ignore[arg-type]
    read = sitk.ReadTransform(str(tmp_path / "a.tfm"))
    assert said["bends"]
    for theta_rad, z_mm, r_mm in ((1.2, -8.0, 1.25), (1.2, 0.1, 1.25), (3.0, 1.31, 2.0), (6.2, 4.0, 0.3)):
        in_b = r_mm * np.cos(theta_rad), r_mm * np.sin(theta_rad), z_mm
        theta_a = float(alignment.theta_to_a(theta_rad, z_mm))
        in_a = r_mm * np.cos(theta_a), r_mm * np.sin(theta_a), float(alignment.z_to_a(z_mm))
        start, end = (in_a, in_b) if inverse else (in_b, in_a)
        assert read.TransformPoint(start) == pytest.approx(end, abs=BEND_MM)
