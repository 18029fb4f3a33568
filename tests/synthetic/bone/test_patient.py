"""A bore through a volume: relief, cells and beams where they can be worked out by hand, whatever the file's axes."""

from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from bone_volumes import (
    CELL,
    CELL_RADIUS_MM,
    ENTRY,
    LENGTH_MM,
    RAS,
    TARGET,
    VOXEL_MM,
    block,
    dicom,
    drilled,
    point,
    stated,
    tilted,
)
from scipy import ndimage

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.patient import bore_to_lps, stated_volume
from endoct.synthetic.bone.scene import build_scene, crossings
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample, Volume

PART_OF_VOXEL = 0.1
"""Within which surfaces lie where they should."""


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    return drilled(stated(block(tmp_path_factory.mktemp("block") / "block.nrrd")))


@pytest.fixture(scope="module")
def wall(sample: Sample) -> Wall:
    return build_wall(sample)


def cell_in_bore(volume: Volume) -> Coordinates:
    return np.asarray((np.linalg.inv(bore_to_lps(volume)) @ np.append(CELL, 1))[:3])


def sides(origin: Coordinates, heading: Coordinates, centre: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return how far along rays (n, 3) the sphere of the cell begins and ends, NaN where they miss it."""
    along = np.sum((centre - origin) * heading, axis=1)
    apart = np.sum((centre - origin - along[:, None] * heading) ** 2, axis=1)
    with np.errstate(invalid="ignore"):
        half = np.sqrt(CELL_RADIUS_MM**2 - apart)
    return np.asarray(along - half), np.asarray(along + half)


def check_same(first: Wall, other: Wall) -> None:
    # rounding decides at its very rim whether a cell is as deep as it is or not there
    assert (first.cell != other.cell).sum() < 0.005 * other.cell.sum()
    off = np.abs(first.relief_mm - other.relief_mm)[first.cell & other.cell]
    assert np.percentile(off, 99.5) < 0.05 * VOXEL_MM


def test_the_wall_has_the_cell_of_the_volume_where_it_is(sample: Sample, wall: Wall) -> None:
    assert sample.bore.volume is not None
    n_z, n_theta = wall.relief_mm.shape
    row, column = (index.ravel() for index in np.indices((n_z, n_theta)))
    theta = wall.dtheta_rad * column
    heading = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=1)
    origin = np.zeros_like(heading)
    origin[:, 2] = wall.dz_mm * row
    begins, ends = (side - wall.radius_mm for side in sides(origin, heading, cell_in_bore(sample.bore.volume)))
    open_ = (begins < 0) & (ends > 0)
    # but for its rim the cell is open where it should be, as deep as it should be
    assert 0.01 < open_.mean() < 0.1
    assert (wall.cell.ravel() != open_).sum() < 0.04 * open_.sum()
    relief, inside = ends, open_ & (ends > 0.1) & wall.cell.ravel()
    off = np.abs(wall.relief_mm.ravel()[inside] - relief[inside])
    assert np.median(off) < PART_OF_VOXEL * VOXEL_MM
    assert np.percentile(off, 95) < 2.5 * PART_OF_VOXEL * VOXEL_MM
    elsewhere = ~ndimage.binary_dilation(open_.reshape(n_z, n_theta), iterations=3)
    assert not wall.relief_mm[elsewhere].any()
    assert set(np.unique(wall.cell_id[wall.cell]).tolist()) == {1}


def test_beams_end_on_the_far_side_of_the_cell_and_know_it(sample: Sample) -> None:
    assert sample.bore.volume is not None
    centre = cell_in_bore(sample.bore.volume)
    scene = build_scene(sample)
    rng = np.random.default_rng(0)
    heading = np.array([centre[0], centre[1], 0]) / np.hypot(*centre[:2]) + 0.12 * rng.normal(size=(400, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    origin = np.tile([0.0, 0.0, centre[2]], (400, 1))
    met = crossings(scene, origin, heading, np.zeros(400), np.full(400, 4.0))
    _, expected = sides(origin, heading, centre)
    beyond = np.nan_to_num(np.hypot(*(origin + expected[:, None] * heading).T[:2]), nan=0.0) > 1.35
    assert beyond.sum() > 200
    assert np.median(np.abs(met.entry_mm - expected)[beyond]) < PART_OF_VOXEL * VOXEL_MM
    assert np.all(met.cell[beyond] == 1)
    normal = (centre - origin - expected[:, None] * heading)[beyond] / CELL_RADIUS_MM
    assert np.median(np.sum(met.normal[beyond] * normal, axis=1)) > 0.995
    opposite = crossings(scene, origin, -heading, np.zeros(400), np.full(400, 4.0))
    assert not opposite.cell.any()
    assert np.allclose(np.hypot(*(origin - opposite.entry_mm[:, None] * heading).T[:2]), 1.25, atol=1e-3)


def test_a_septum_is_left_and_bone_met_again(tmp_path: Path) -> None:
    # a block whose cell lies behind a thin piece of wall
    volume = stated(block(tmp_path / "block.nrrd"))
    sample = drilled(volume, diameter_mm=1.6)
    centre = cell_in_bore(volume)
    scene = build_scene(sample)
    away = float(np.hypot(*centre[:2])) - CELL_RADIUS_MM
    assert away < 0.8  # so that it opens into this bore
    narrow = build_scene(drilled(volume, diameter_mm=2 * (away - 0.2)))
    heading = np.array([[centre[0], centre[1], 0.0]]) / np.hypot(*centre[:2])
    origin = np.array([[0.0, 0.0, centre[2]]])
    met = crossings(narrow, origin, heading, np.zeros(1), np.full(1, 5.0))
    assert met.entry_mm[0] == pytest.approx(away - 0.2, abs=1e-3)
    assert met.exit_mm[0] == pytest.approx(away, abs=2 * PART_OF_VOXEL * VOXEL_MM)
    assert met.reentry_mm[0] == pytest.approx(away + 2 * CELL_RADIUS_MM, abs=2 * PART_OF_VOXEL * VOXEL_MM)
    assert np.isnan(crossings(scene, origin, -heading, np.zeros(1), np.full(1, 5.0)).exit_mm[0])


def test_ras_and_lps_give_the_same_bore(tmp_path: Path) -> None:
    path = block(tmp_path / "block.nrrd")
    lps = stated(path)
    ras = stated_volume(path, (point(RAS * ENTRY), point(RAS * TARGET)), coordinates="ras")
    assert np.array_equal(bore_to_lps(lps), bore_to_lps(ras))
    assert np.array_equal(build_wall(drilled(lps)).relief_mm, build_wall(drilled(ras)).relief_mm)


def test_a_file_means_by_its_coordinates_what_its_format_says(tmp_path: Path) -> None:
    assert stated(block(tmp_path / "block.nrrd"), coordinates=None).coordinates == "lps"
    nifti = block(tmp_path / "block.nii.gz")
    in_nifti = stated_volume(nifti, (point(RAS * ENTRY), point(RAS * TARGET)))
    assert in_nifti.coordinates == "ras"
    assert np.allclose(bore_to_lps(in_nifti), bore_to_lps(stated(nifti)))
    text = (tmp_path / "block.nrrd").read_bytes()
    ras = tmp_path / "ras.nrrd"
    header, _, data = text.partition(b"\n\n")
    ras.write_bytes(header.replace(b"left-posterior-superior", b"right-anterior-superior") + b"\n\n" + data)
    # the same numbers in another convention: the patient's other side
    assert stated(ras, coordinates=None).coordinates == "ras"
    assert np.allclose(bore_to_lps(stated(ras, coordinates=None))[:3, 3], RAS * ENTRY)
    nowhere = tmp_path / "nowhere.nrrd"
    nowhere.write_bytes(header.replace(b"space: left-posterior-superior", b"space dimension: 3") + b"\n\n" + data)
    with pytest.raises(EndoctError, match=r"RAS or LPS.*state --coordinates"):
        stated(nowhere, coordinates=None)
    walls = [build_wall(drilled(stated(path))) for path in (nowhere, tmp_path / "block.nrrd")]
    assert np.allclose(walls[0].relief_mm, walls[1].relief_mm)


@pytest.mark.parametrize("name", ["turned.nrrd", "turned.nii.gz", "turned.mha"])
def test_turned_axes_of_the_voxels_change_nothing(tmp_path: Path, wall: Wall, name: str) -> None:
    turned = build_wall(drilled(stated(block(tmp_path / name, turned=True))))
    check_same(turned, wall)


def test_a_series_of_dicom_is_the_same_volume(tmp_path: Path, wall: Wall) -> None:
    volume = stated(dicom(tmp_path / "series"), coordinates=None)
    assert volume.coordinates == "lps"
    check_same(build_wall(drilled(volume)), wall)


def test_a_series_of_a_tilted_gantry_is_the_same_volume(tmp_path: Path, wall: Wall) -> None:
    askew = build_wall(drilled(stated(tilted(tmp_path / "series", 12.0), coordinates=None)))
    assert (askew.cell != wall.cell).sum() < 0.02 * wall.cell.sum()
    assert np.median(np.abs(askew.relief_mm - wall.relief_mm)[askew.cell & wall.cell]) < PART_OF_VOXEL * VOXEL_MM


def test_voxels_in_another_file_are_a_part_of_what_was_drilled_into(tmp_path: Path) -> None:
    sample = drilled(stated(block(tmp_path / "block.mhd")))
    voxels = (tmp_path / "block.raw").read_bytes()
    (tmp_path / "block.raw").write_bytes(voxels[:-2] + b"\0\0")
    with pytest.raises(EndoctError, match="not the volume that was drilled into"):
        build_scene(sample)


def test_axes_that_are_not_at_right_angles_are_refused(tmp_path: Path) -> None:
    path = block(tmp_path / "block.nrrd")
    header, _, data = path.read_bytes().partition(b"\n\n")
    lines = header.split(b"\n")
    at = next(n for n, line in enumerate(lines) if line.startswith(b"space directions"))
    lines[at] = b"space directions: (0.2,0.02,0) (0,0.2,0) (0,0,0.2)"
    path.write_bytes(b"\n".join(lines) + b"\n\n" + data)
    with pytest.raises(EndoctError, match="right angles"):
        stated(path)


@pytest.mark.parametrize(("row", "column", "change"), [(0, 1, 0.02), (2, 3, 5.0)])
def test_a_nifti_that_says_two_things_of_its_place_is_refused(
    tmp_path: Path, row: int, column: int, change: float
) -> None:
    path = block(tmp_path / "block.nii.gz")
    image: Any = nibabel.load(path)
    matrix = image.affine.copy()
    matrix[row, column] += change
    image.set_sform(matrix, 1)
    nibabel.save(image, tmp_path / "other.nii.gz")
    assert stated(path).coordinates == "lps"
    with pytest.raises(EndoctError, match="does not say where its voxels lie"):
        stated(tmp_path / "other.nii.gz")


def test_labels_are_as_good_as_grey_values_to_a_part_of_a_voxel(tmp_path: Path, wall: Wall) -> None:
    labels = build_wall(drilled(stated(block(tmp_path / "labels.nrrd", labels=True))))
    both = labels.cell & wall.cell
    assert both.sum() > 0.9 * wall.cell.sum()
    assert np.median(np.abs(labels.relief_mm - wall.relief_mm)[both]) < 0.2 * VOXEL_MM


def test_what_is_finer_than_voxels_comes_on_request_only(tmp_path: Path, wall: Wall) -> None:
    path = block(tmp_path / "block.nrrd")
    rough = build_wall(drilled(stated(path, detail_mm=0.006)))
    deep = wall.relief_mm > 0.2
    off = (rough.relief_mm - wall.relief_mm)[deep]
    assert 0.004 < np.std(off[np.abs(off) < 0.05]) < 0.012
    assert np.array_equal(rough.relief_mm[wall.relief_mm < -0.02], wall.relief_mm[wall.relief_mm < -0.02])


@pytest.mark.parametrize(
    ("entry", "target", "options", "message"),
    [
        (ENTRY - 50, TARGET, {}, "the entry lies outside the volume"),
        (ENTRY, RAS * TARGET, {}, "the target lies outside the volume.*--coordinates"),
        (ENTRY, ENTRY, {}, "the same place"),
        (ENTRY, TARGET, {"bone_hu": 3000.0}, "no bone"),
        (ENTRY, TARGET, {"bone_label": 7}, "no bone"),
    ],
)
def test_a_trajectory_that_cannot_be_is_refused(
    tmp_path: Path, entry: Coordinates, target: Coordinates, options: dict[str, float], message: str
) -> None:
    path = block(tmp_path / "block.nrrd")
    with pytest.raises(EndoctError, match=message):
        stated_volume(path, (point(entry), point(target)), coordinates="lps", **options)  # type: ignore[arg-type]


def test_volumes_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no such file"):
        stated(tmp_path / "missing.nrrd")
    with pytest.raises(EndoctError, match="no DICOM"):
        stated(tmp_path)
    (tmp_path / "text.nrrd").write_text("no volume")
    with pytest.raises(EndoctError, match="is no volume"):
        stated(tmp_path / "text.nrrd")
    (tmp_path / "page.png").write_bytes(b"")
    with pytest.raises(EndoctError, match="is no volume"):
        stated(tmp_path / "page.png")
    with pytest.raises(EndoctError, match="no bone"):
        stated(block(tmp_path / "air.nrrd", air=True))
    with pytest.raises(EndoctError, match="as far apart as the recordings"):
        draw("paper", 0, volume=stated(block(tmp_path / "block.nrrd")))


def test_a_way_through_air_is_refused(tmp_path: Path) -> None:
    # nothing of the block is as dense as is asked for
    volume = stated(block(tmp_path / "block.nrrd"))
    inside = drilled(volume.model_copy(update={"bone_hu": 1500.5}))
    with pytest.raises(EndoctError, match="does not run through bone"):
        build_scene(inside)


def test_a_volume_that_changed_is_not_replayed(tmp_path: Path) -> None:
    path = block(tmp_path / "block.nrrd")
    sample = drilled(stated(path))
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(EndoctError, match=r"not the volume that was drilled into.*sha256"):
        build_scene(sample)
    assert pytest.approx(sample.bore.length_mm) == LENGTH_MM
