"""The CT: places in it are places of the bore, in Hounsfield units, read back by another library."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import nibabel
import numpy as np
import pytest
import xarray as xr
from bone_volumes import CELL, RAS, block, drilled, stated
from made_once import MadeOnce
from scipy import ndimage

from endoct.base.errors import EndoctError
from endoct.modalities.ct.nifti import nifti_header
from endoct.modalities.ct.trajectory import Trajectory, read_line
from endoct.synthetic import ct_scan
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.ct_scan import drawn_plan, true_line, write_ct
from endoct.synthetic.draw import Scans, draw
from endoct.synthetic.sample.parameters import Ct
from endoct.synthetic.specimen import simulate
from endoct.synthetic.truth import recording

SHARP = Ct(voxel_mm=0.2, psf_mm=0.4, noise_hu=20, bone_hu=1500)


@pytest.fixture(scope="module")
def specimen(made_once: MadeOnce) -> Path:
    ranges = {"bore.bone": ("network",)}
    return made_once(
        "scanned", lambda folder: simulate(folder, preset="learning", seed=4, ranges=ranges, ct=True, cone_beam=True)
    )


def opened(specimen: Path, name: str) -> tuple[Any, Any]:
    image: Any = nibabel.load(specimen / "truth" / name)
    assert np.allclose(image.get_sform(), image.get_qform(), atol=1e-4)
    return np.asarray(image.dataobj), image.affine


def to_world(specimen: Path) -> Any:
    world = json.loads((specimen / "truth/recording.json").read_text(encoding="utf-8"))["world"]
    assert world["coordinates"] == "ras"
    matrix = np.array(world["bore_to_world"])
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    assert np.allclose(matrix[:3, 3], world["entry_mm"])
    return matrix


def test_the_middle_of_a_cell_is_found_at_its_place_in_the_ct(tmp_path: Path) -> None:
    sample = drilled(stated(block(tmp_path / "block.nrrd"))).model_copy(update={"ct": SHARP})
    write_ct(tmp_path, sample)
    image: Any = nibabel.load(tmp_path / "ct.nii.gz")
    hu = np.asarray(image.dataobj, np.float64)
    weight = np.clip(800 - hu, 0, None) * (np.indices(hu.shape).max(axis=0) < 10_000)
    parts, _ = ndimage.label(hu < 250)
    at = np.rint(np.linalg.inv(image.affine) @ np.append(RAS * CELL, 1))[:3].astype(int)
    weight[parts != parts[tuple(at)]] = 0
    middle = np.array(ndimage.center_of_mass(weight))
    assert np.linalg.norm((image.affine @ np.append(middle, 1))[:3] - RAS * CELL) < 0.2 * SHARP.voxel_mm
    world = recording(sample)["world"]
    assert isinstance(world, dict)
    assert world["coordinates"] == "lps"


def test_cells_of_the_wall_have_the_same_number_in_the_ct(specimen: Path) -> None:
    cells, affine = opened(specimen, "ct_cells.nii.gz")
    wall = xr.open_zarr(specimen / "truth/wall.zarr", consolidated=False).load()
    row, column = np.nonzero(wall.cell.values & (wall.relief_mm.values > 0.5))
    assert row.size > 100
    radius, theta = wall.attrs["bore_radius_mm"] + 0.25, wall.theta.values[column]
    places = np.stack([radius * np.cos(theta), radius * np.sin(theta), wall.z.values[row], np.ones(row.size)])
    index = np.rint((np.linalg.inv(affine) @ to_world(specimen) @ places)[:3]).astype(int)
    found = cells[tuple(index)]
    assert np.mean(found == wall.cell_id.values[row, column]) > 0.97


def test_hounsfield_units_and_labels_agree(specimen: Path) -> None:
    hu, affine = opened(specimen, "ct.nii.gz")
    labels, _ = opened(specimen, "ct_labels.nii.gz")
    sample = json.loads((specimen / "truth/sample.json").read_text(encoding="utf-8"))
    assert set(np.unique(labels).tolist()) == {0, 1, 2, 3, 4, 5, 6}
    assert np.linalg.norm(affine[:3, 0]) == pytest.approx(sample["ct"]["voxel_mm"], rel=1e-5)
    deep = ndimage.binary_erosion(labels == 1, iterations=4)
    away = ndimage.distance_transform_edt(labels != 4) > 10
    assert np.mean(hu[deep & away]) == pytest.approx(sample["ct"]["bone_hu"], rel=0.01)
    assert np.std(hu[deep & away]) == pytest.approx(sample["ct"]["noise_hu"], rel=0.1)
    nerve = ndimage.binary_erosion(labels == 2, iterations=2)
    assert np.mean(hu[nerve]) < 500


def test_the_bore_shows_after_drilling_only(specimen: Path) -> None:
    sample = json.loads((specimen / "truth/sample.json").read_text(encoding="utf-8"))
    z = np.linspace(1, sample["bore"]["length_mm"] - 1, 50)
    axis = to_world(specimen) @ np.stack([np.zeros(50), np.zeros(50), z, np.ones(50)])
    after, affine = opened(specimen, "cone_beam.nii.gz")
    index = np.rint((np.linalg.inv(affine) @ axis)[:3]).astype(int)
    assert np.mean(after[tuple(index)]) < -850
    before, affine = opened(specimen, "ct.nii.gz")
    index = np.rint((np.linalg.inv(affine) @ axis)[:3]).astype(int)
    assert np.mean(before[tuple(index)]) > -500


def test_bone_of_half_the_density_lies_halfway_to_soft_tissue(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = draw("learning", 4, ranges={"bore.bone": ("network",)}, scans=Scans(ct=True))
    assert sample.ct is not None
    places = Lattice(np.array([2.0, -1.0, 3.0]), np.diag([0.2, 0.2, 0.2])[::-1], (6, 8, 8))
    hu = {}
    for share in (None, 0.5):
        density = None if share is None else SimpleNamespace(on=lambda of: np.full(of.shape, 0.5, np.float32))
        monkeypatch.setattr(ct_scan, "density_of", lambda _, density=density: density)
        hu[share] = ct_scan._tissues(sample, sample.ct, places, drilled=False)
    solid = hu[None] == sample.ct.bone_hu
    assert solid.sum() > 20
    assert np.unique(hu[0.5][solid]) == pytest.approx([(sample.ct.bone_hu + ct_scan.TISSUE_HU) / 2])


def test_thick_slices_on_request() -> None:
    sample = draw("learning", 4, ranges={"bore.bone": ("network",)}, scans=Scans(ct=True, ct_slice_mm=0.6))
    assert sample.ct is not None
    assert sample.ct.slice_mm == 0.6
    plain = draw("learning", 4, ranges={"bore.bone": ("network",)}, scans=Scans(ct=True))
    assert sample.model_copy(update={"ct": plain.ct}) == plain


def test_there_is_no_ct_of_a_phantom() -> None:
    with pytest.raises(EndoctError, match="three dimensions only"):
        draw("quick", 1, scans=Scans(ct=True))


@pytest.mark.parametrize("handed", [1.0, -1.0])
def test_a_header_says_the_same_twice(tmp_path: Path, handed: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn)) * handed
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = turn * rng.uniform(0.2, 2, 3), rng.uniform(-50, 50, 3)
        path = tmp_path / "one.nii"
        path.write_bytes(nifti_header((2, 3, 4), np.dtype(np.int16), affine, "any") + bytes(48))
        image: Any = nibabel.load(path)
        assert np.allclose(image.get_sform(), affine, atol=1e-5)
        assert np.allclose(image.get_qform(), affine, atol=1e-4)


def test_the_number_of_workers_changes_no_byte(specimen: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    simulate(other, preset="learning", seed=4, ranges={"bore.bone": ("network",)}, ct=True, cone_beam=True, workers=1)
    files = sorted(path.relative_to(specimen) for path in specimen.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(other) for path in other.rglob("*") if path.is_file())
    for name in files:
        assert (specimen / name).read_bytes() == (other / name).read_bytes(), name


def test_the_true_line_and_a_plan_beside_it_are_markups_in_the_world_of_the_ct(specimen: Path) -> None:
    true, convention = read_line(specimen / "truth/bore.mrk.json")
    world = json.loads((specimen / "truth/recording.json").read_text(encoding="utf-8"))["world"]
    assert convention == "lps"
    assert np.allclose(RAS * true.entry_mm, world["entry_mm"], atol=1e-9)
    assert np.allclose(RAS * true.target_mm, world["target_mm"], atol=1e-9)
    plan, _ = read_line(specimen / "plan.mrk.json")
    off, tilt = apart(true, plan)
    assert 0.01 < off <= 1.0
    assert 0.0 < tilt <= 2.0


def test_plans_are_off_by_up_to_a_millimetre_and_two_degrees() -> None:
    drawn = [draw("learning", seed, ranges={"bore.bone": ("network",)}, scans=Scans(ct=True)) for seed in range(40)]
    off = np.array([apart(true_line(sample), drawn_plan(sample)) for sample in drawn])
    assert off.max(axis=0) == pytest.approx([1.0, 2.0], rel=0.1)
    assert np.all(off <= [1.0, 2.0])
    again = draw("learning", 99, bore_seed=3, ranges={"bore.bone": ("network",)}, scans=Scans(ct=True))
    assert drawn_plan(again) == drawn_plan(drawn[3])


def apart(true: Trajectory, plan: Trajectory) -> tuple[float, float]:
    """Return the distance of the entries in mm, and the angle between the lines in degrees."""
    assert plan.length_mm == pytest.approx(true.length_mm)
    along = true.to_lps[:3, 2] @ plan.to_lps[:3, 2]
    return float(np.linalg.norm(np.subtract(true.entry_mm, plan.entry_mm))), float(np.degrees(np.arccos(along)))
