"""NRRD and NIfTI, read by other libraries: the mark lies at its x, y and z in mm, and not at its mirror image."""

from collections.abc import Callable
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
from marked_wall import MARK, PLACES, RADIUS_MM, WALL, Place, write_marked

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench import export

VOXEL_MM = 0.02
FROM_RAS = np.array([-1, -1, 1])
"""What turns right, anterior, superior into left, posterior, superior, which is the bore frame here."""

Read = Callable[[Path], tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]]
"""Returns voxels [i, j, k], and what takes these indices to x, y, z of the bore frame in mm."""


def read_nrrd(path: Path) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    voxels, header = nrrd.read(str(path), index_order="F")
    assert header["space"] == "left-posterior-superior"
    assert header["space units"] == ["mm", "mm", "mm"]
    return voxels, lambda index: header["space origin"] + index @ header["space directions"]


def read_nifti(path: Path) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    image = nibabel.load(path)
    assert image.header.get_xyzt_units()[0] == "mm"
    assert np.linalg.det(image.affine[:3, :3]) > 0
    np.testing.assert_allclose(image.get_qform(), image.affine, atol=1e-6)
    assert image.header["sform_code"] > 0
    voxels = np.asarray(image.dataobj)
    return voxels, lambda index: FROM_RAS * nibabel.affines.apply_affine(image.affine, index)


def read_itk(path: Path) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    image = sitk.ReadImage(str(path))
    voxels = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    return voxels, lambda index: np.array(image.TransformContinuousIndexToPhysicalPoint(index.tolist()))


@pytest.fixture(scope="module")
def volumes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A panorama with its volume for each place."""
    folder = tmp_path_factory.mktemp("volumes")
    return [write_marked(folder / f"wall{k}.zarr", place, dtype="uint16") for k, place in enumerate(PLACES)]


@pytest.mark.parametrize("k", range(len(PLACES)))
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("v.nrrd", read_nrrd),
        ("v.nrrd", read_itk),
        ("v.nii.gz", read_nifti),
        ("v.nii", read_nifti),
        ("v.nii.gz", read_itk),
    ],
)
def test_the_mark_lies_at_its_place_in_mm(volumes: list[Path], tmp_path: Path, k: int, name: str, read: Read) -> None:
    place = PLACES[k]
    exported = export(volumes[k], tmp_path / name, voxel_mm=VOXEL_MM)
    voxels, to_mm = read(tmp_path / name)
    assert list(voxels.shape) == exported.facts["shape"]
    assert voxels.dtype == np.uint16
    weights = np.clip(voxels.astype(np.float64) - (WALL + MARK) / 2, 0, None)
    centre = np.array([(np.indices(voxels.shape)[axis] * weights).sum() for axis in range(3)]) / weights.sum()
    found_mm = to_mm(centre)
    assert np.abs(found_mm - place.xyz_mm).max() < VOXEL_MM / 2
    assert np.abs(found_mm - place.mirrored.xyz_mm).max() > VOXEL_MM
    assert voxels.max() > 0.95 * MARK


@pytest.mark.parametrize("place", [Place(1.1, 0.5), Place(0.005, 0.5), Place(2 * np.pi - 0.005, 0.5)])
def test_samples_finer_than_a_voxel_are_averaged_and_stay_where_they_are(tmp_path: Path, place: Place) -> None:
    of = SurfaceGrid.full_circle(21, 1999, z0_mm=0, dz_mm=0.05, radius_mm=RADIUS_MM, theta0_rad=0.3)
    export(write_marked(tmp_path / "wall.zarr", place, of, "uint16"), tmp_path / "v.nrrd", voxel_mm=0.08)
    voxels, to_mm = read_nrrd(tmp_path / "v.nrrd")
    at_mm = to_mm(np.moveaxis(np.indices(voxels.shape), 0, -1))
    near = (np.abs(at_mm - place.xyz_mm) < 0.3).all(axis=-1)
    weights = np.where(near & (voxels > WALL), voxels - WALL, 0)
    found_mm = (at_mm * weights[..., np.newaxis]).sum(axis=(0, 1, 2)) / weights.sum()
    assert np.abs(found_mm - place.xyz_mm).max() < 0.008


def test_voxels_are_those_of_the_recording_and_empty_where_it_shows_nothing(tmp_path: Path) -> None:
    for dtype, empty in (("uint8", 0), ("float32", np.nan)):
        store = write_marked(tmp_path / f"{dtype}.zarr", PLACES[0], dtype=dtype)
        export(store, tmp_path / f"{dtype}.nrrd", voxel_mm=VOXEL_MM)
        voxels, to_mm = read_nrrd(tmp_path / f"{dtype}.nrrd")
        assert voxels.dtype == np.dtype(dtype)
        middle = voxels.shape[0] // 2
        np.testing.assert_allclose(to_mm(np.array([middle, middle, 0])), (0, 0, -0.5), atol=1e-9)
        np.testing.assert_array_equal(voxels[middle, middle], empty)
        np.testing.assert_array_equal(voxels[0, 0], empty)
        # the wall is even all around, over the seam too
        around = np.linspace(0, 2 * np.pi, 721)
        index = np.rint(middle + 1.3 / VOXEL_MM * np.array([np.cos(around), np.sin(around)])).astype(int)
        np.testing.assert_allclose(voxels[*index, -1].astype(float), WALL, atol=1)


def test_a_panorama_without_volume_says_how_to_get_one(tmp_path: Path) -> None:
    store = write_marked(tmp_path / "wall.zarr", PLACES[0])
    with pytest.raises(EndoctError, match=r"has no volume.*volume=True"):
        export(store, tmp_path / "wall.nrrd")
    assert [path.name for path in tmp_path.iterdir()] == ["wall.zarr"]
