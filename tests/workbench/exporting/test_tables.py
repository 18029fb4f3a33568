"""The alignment as a transform, and numbers per frame as a table, read by other libraries."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import SimpleITK as sitk
from marked_wall import ALIGNMENT, PLACES, write_marked, write_marked_comparison

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment
from endoct.workbench import export


def read_tfm(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return (matrix, offset) as the text says."""
    said = dict(line.split(": ", 1) for line in path.read_text().splitlines() if ": " in line)
    assert said["Transform"] == "AffineTransform_double_3_3"
    assert said["FixedParameters"].split() == ["0"] * 3
    values = np.array(said["Parameters"].split(), dtype=float)
    return values[:9].reshape(3, 3), values[9:]


def on_wall(theta_rad: float, z_mm: float) -> np.ndarray:
    return np.array([1.25 * np.cos(theta_rad), 1.25 * np.sin(theta_rad), z_mm])


@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_a_point_of_b_lands_where_the_alignment_puts_it(tmp_path: Path, mirrored: bool, z_reversed: bool) -> None:
    alignment = Alignment(1.1, 0.7, 1.02, mirrored=mirrored, z_reversed=z_reversed)
    folder = write_marked_comparison(tmp_path / "result", PLACES[0], alignment)
    exported = export(folder, tmp_path / "b_to_a.tfm")
    export(folder, tmp_path / "a_to_b.tfm", inverse=True)
    assert (exported.facts["from"], exported.facts["to"]) == ("oct", "endoscope")
    (there, offset), (back, offset_back) = read_tfm(tmp_path / "b_to_a.tfm"), read_tfm(tmp_path / "a_to_b.tfm")
    for theta_rad, z_mm in ((0.0, 0.0), (0.4, 3.0), (6.2, -1.0)):
        in_b, in_a = on_wall(theta_rad, z_mm), on_wall(alignment.theta_to_a(theta_rad), alignment.z_to_a(z_mm))
        np.testing.assert_allclose(there @ in_b + offset, in_a, atol=1e-12)
        np.testing.assert_allclose(back @ in_a + offset_back, in_b, atol=1e-12)
    assert (np.linalg.det(there) < 0) == (mirrored != z_reversed)


def test_itk_reads_the_transform(tmp_path: Path) -> None:
    export(write_marked_comparison(tmp_path / "result", PLACES[0]), tmp_path / "b_to_a.tfm")
    transform = sitk.ReadTransform(str(tmp_path / "b_to_a.tfm"))
    expected = on_wall(ALIGNMENT.theta_to_a(0.4), ALIGNMENT.z_to_a(3.0))
    np.testing.assert_allclose(transform.TransformPoint(on_wall(0.4, 3.0).tolist()), expected, atol=1e-12)


def test_what_has_no_alignment_is_refused(tmp_path: Path) -> None:
    apart = write_marked_comparison(tmp_path / "apart", PLACES[0], alignment=None)
    with pytest.raises(EndoctError, match="are not aligned"):
        export(apart, tmp_path / "x.tfm")
    with pytest.raises(EndoctError, match="has no alignment; expected a folder written by `endoct compare`"):
        export(write_marked(tmp_path / "wall.zarr", PLACES[0]), tmp_path / "x.tfm")


def test_quality_is_a_table_with_units_in_its_headings(tmp_path: Path) -> None:
    store = write_marked(tmp_path / "wall.zarr", PLACES[0])
    export(store, tmp_path / "q.csv")
    table = pd.read_csv(tmp_path / "q.csv")
    assert list(table.columns) == [
        "slice_z_mm",
        "bridged",
        "residual_mm",
        "rotation_harmonics_rad 1",
        "rotation_harmonics_rad 2",
        "sine_omega",
    ]
    np.testing.assert_allclose(table["slice_z_mm"], -0.5 + 0.5 * np.arange(11))
    assert table["bridged"].dtype == np.bool_
    assert table["bridged"].tolist().index(True) == 3
    assert table["sine_omega"].isna().all()


def test_of_a_comparison_a_side_has_to_be_chosen(tmp_path: Path) -> None:
    folder = write_marked_comparison(tmp_path / "result", PLACES[0])
    with pytest.raises(EndoctError, match="has two sides; expected endoscope or oct; choose one with side='endoscope'"):
        export(folder, tmp_path / "q.csv")
    assert export(folder, tmp_path / "q.csv", side="oct").facts["rows"] == len(pd.read_csv(tmp_path / "q.csv"))
    assert len(pd.read_csv(tmp_path / "q.csv")) == 15
