"""NIfTI, NRRD and MetaImage: placed as the header says by hand, or refused; no other file is opened."""

import gzip
import os
import subprocess
import sys
from pathlib import Path
from random import Random

import nibabel
import numpy as np
import pytest
import SimpleITK as sitk
from tolerances import CT_PLACE_MM

from benchmarks.ct_faults.drawn import MARK_HU, Drawn, drawn
from benchmarks.ct_faults.writing import metaimage_header, nifti, nrrd_header, write_metaimage, write_nrrd
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import CtVolume, is_volume, read_ct

RAS = np.array([-1.0, -1.0, 1.0])


@pytest.fixture
def volume() -> Drawn:
    return drawn(Random(21))


def mark_of(ct: CtVolume) -> np.ndarray:
    return np.asarray(ct.origin_mm + np.argwhere(ct.voxels == MARK_HU)[0] @ ct.steps_mm)


def refusal(path: Path) -> str:
    with pytest.raises(EndoctError) as raised:
        read_ct(path)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def bytes_of(volume: Drawn) -> bytes:
    return volume.voxels.astype("<i2").tobytes()


@pytest.mark.parametrize(("unit", "per_mm"), [("mm", 1.0), ("micron", 1000.0), ("meter", 1e-3)])
@pytest.mark.parametrize("forms", ["both", "sform", "qform"])
def test_nifti_in_any_unit_lies_where_its_forms_say(
    tmp_path: Path, volume: Drawn, unit: str, per_mm: float, forms: str
) -> None:
    to_ras = np.diag([*RAS, 1.0]) @ volume.to_lps
    to_ras[:3] *= per_mm
    image = nibabel.Nifti1Image(volume.voxels.transpose(), None)
    image.header.set_xyzt_units(unit)
    image.set_sform(to_ras, 1 if forms != "qform" else 0)
    image.set_qform(to_ras, 1 if forms != "sform" else 0)
    image.header["pixdim"][1:4] = np.linalg.norm(to_ras[:3, :3], axis=0)
    nibabel.save(image, tmp_path / "ct.nii.gz")
    ct = read_ct(tmp_path / "ct.nii.gz")
    assert (ct.coordinates, ct.doubts) == ("ras", ())
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM
    assert np.array_equal(ct.voxels, volume.voxels)


def test_nifti_without_codes_lies_nowhere_unless_coordinates_are_stated(tmp_path: Path, volume: Drawn) -> None:
    image = nibabel.Nifti1Image(volume.voxels.transpose(), None)
    image.header.set_xyzt_units("mm")
    image.header["pixdim"][1:4] = 0.5
    image.header["qform_code"] = image.header["sform_code"] = 0
    nibabel.save(image, tmp_path / "ct.nii")
    assert "state --coordinates ras or --coordinates lps" in refusal(tmp_path / "ct.nii")
    ct = read_ct(tmp_path / "ct.nii", "lps")
    assert ct.coordinates is None
    assert np.allclose(mark_of(ct), 0.5 * np.array(volume.mark[::-1]))
    assert np.allclose(mark_of(read_ct(tmp_path / "ct.nii", "ras")), RAS * 0.5 * np.array(volume.mark[::-1]))


def test_nifti_scales_its_values(tmp_path: Path, volume: Drawn) -> None:
    image = nifti(volume)
    nibabel.save(image, tmp_path / "ct.nii")
    content = bytearray((tmp_path / "ct.nii").read_bytes())
    content[112:120] = np.array([2.0, -100.0], "<f4").tobytes()
    (tmp_path / "ct.nii").write_bytes(content)
    assert np.allclose(read_ct(tmp_path / "ct.nii").voxels, volume.voxels * 2.0 - 100)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"srow_y": (0, 0, 0, 0), "qform_code": 0}, "two things of how far its voxels lie apart"),
        ({"quatern_b": float("nan"), "sform_code": 0}, "qform with numbers that are none"),
        ({"qoffset_x": float("inf"), "sform_code": 0}, "numbers that are none"),
        ({"srow_x": (0.3, 0, 0, 5), "qform_code": 0}, "lie"),
        ({"xyzt_units": 5}, "does not say its unit"),
        ({"xyzt_units": 1}, "voxels of a size that cannot be"),
        ({"pixdim": (1, 0, 0.3, 0.3, 1, 1, 1, 1), "sform_code": 0}, "how far its voxels lie apart"),
        ({"pixdim": (1, 9, 9, 9, 1, 1, 1, 1), "qform_code": 0}, "two things of how far"),
        ({"vox_offset": 100}, "voxels at byte 100"),
        ({"vox_offset": 400}, "is cut off"),
        ({"magic": b"ni1"}, "in another file"),
    ],
)
def test_a_nifti_that_contradicts_itself_is_refused(
    tmp_path: Path, volume: Drawn, change: dict[str, object], message: str
) -> None:
    nibabel.save(nifti(volume), tmp_path / "ct.nii")
    content = (tmp_path / "ct.nii").read_bytes()
    header = nibabel.Nifti1Header(content[:348], check=False)
    for field, value in change.items():
        header[field] = value
    (tmp_path / "ct.nii").write_bytes(header.binaryblock + content[348:])
    assert message in refusal(tmp_path / "ct.nii")


def test_a_flipped_bit_in_a_compressed_file_is_seen(tmp_path: Path, volume: Drawn) -> None:
    nibabel.save(nifti(volume), tmp_path / "ct.nii.gz")
    content = bytearray((tmp_path / "ct.nii.gz").read_bytes())
    content[-6] ^= 4
    (tmp_path / "ct.nii.gz").write_bytes(content)
    assert "cannot be read" in refusal(tmp_path / "ct.nii.gz")


@pytest.mark.parametrize(
    ("change", "scale"),
    [({}, 1.0), ({"space units": '"um" "um" "um"'}, 1e-3), ({"space units": '"mm" "mm" "mm"'}, 1.0)],
)
def test_nrrd_lies_where_its_header_says(tmp_path: Path, volume: Drawn, change: dict[str, str], scale: float) -> None:
    header = nrrd_header(volume)
    for field in ("space directions", "space origin"):
        vectors = [np.array(one.strip("()").split(","), float) / scale for one in header[field].split()]
        header[field] = " ".join("(" + ", ".join(f"{x:.15g}" for x in one) + ")" for one in vectors)
    ct = read_ct(write_nrrd(tmp_path / "ct.nrrd", header | change, bytes_of(volume)))
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM


@pytest.mark.parametrize(
    ("space", "signs", "coordinates"),
    [("RAS", RAS, "ras"), ("left-anterior-superior", np.array([1.0, -1.0, 1.0]), None), ("LPS", np.ones(3), "lps")],
)
def test_nrrd_in_each_space_of_a_patient(
    tmp_path: Path, volume: Drawn, space: str, signs: np.ndarray, coordinates: str | None
) -> None:
    header = nrrd_header(volume) | {"space": space}
    for field in ("space directions", "space origin"):
        vectors = [signs * np.array(one.strip("()").split(","), float) for one in header[field].split()]
        header[field] = " ".join("(" + ",".join(f"{x:.15g}" for x in one) + ")" for one in vectors)
    ct = read_ct(write_nrrd(tmp_path / "ct.nrrd", header, bytes_of(volume)))
    assert ct.coordinates == coordinates
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"space directions": None, "spacings": "0.3 0.3 0.3"},
            "does not say where its voxels lie; found spacings only",
        ),
        ({"space origin": None}, "no space origin"),
        ({"space directions": "none (0,1,0) (0,0,1)"}, "2 of them in space"),
        ({"space directions": "(0,0,0) (0,1,0) (0,0,1)"}, "does not say where"),
        ({"space directions": "(1,0,0) (0,nan,0) (0,0,1)"}, "does not say where"),
        ({"space units": '"furlong" "furlong" "furlong"'}, "unit of length that is not known"),
        ({"units": '"um" "um" "um"'}, "two things of its unit"),
        ({"encoding": "raw", "data file": "/etc/passwd"}, "does not lie next to it"),
        ({"encoding": "raw", "data file": "../ct.raw"}, "does not lie next to it"),
        ({"encoding": "raw", "data file": "LIST"}, "several files"),
        ({"encoding": "raw", "data file": "x%03d.raw 1 9 1"}, "several files"),
        ({"type": "block"}, "voxels of type block"),
        ({"type": "signed char"}, "other voxels than its header says"),
        ({"endian": None}, "order its bytes"),
    ],
)
def test_an_nrrd_that_does_not_say_enough_is_refused(
    tmp_path: Path, volume: Drawn, change: dict[str, str | None], message: str
) -> None:
    header = {field: value for field, value in (nrrd_header(volume) | change).items() if value is not None}
    assert message in refusal(write_nrrd(tmp_path / "ct.nrrd", header, bytes_of(volume)))


def test_voxels_next_to_their_header_belong_to_it(tmp_path: Path, volume: Drawn) -> None:
    (tmp_path / "ct.raw").write_bytes(bytes_of(volume))
    paths = [
        write_nrrd(tmp_path / "ct.nhdr", nrrd_header(volume) | {"encoding": "raw", "data file": "ct.raw"}, b""),
        write_metaimage(tmp_path / "ct.mhd", metaimage_header(volume) | {"ElementDataFile": "ct.raw"}, b""),
    ]
    for path in paths:
        ct = read_ct(path)
        assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM
        assert ct.files == (path, tmp_path / "ct.raw")
    (tmp_path / "ct.raw").unlink()
    os.mkfifo(tmp_path / "ct.raw")
    for path in paths:
        assert "found a pipe" in refusal(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ElementSpacing": None}, "no elementspacing"),
        ({"Offset": None}, "no offset"),
        ({"TransformMatrix": None}, "no transformmatrix"),
        ({"NDims": "999"}, "999 dimensions"),
        ({"NDims": "11"}, "11 dimensions"),
        ({"TransformMatrix": "0 0 0 0 1 0 0 0 1"}, "not of length 1"),
        ({"ElementSpacing": "0.3 nan 0.3"}, "elementspacing"),
        ({"ElementSpacing": "0.3 0 0.3"}, "without a size"),
        ({"ElementDataFile": "/etc/passwd"}, "does not lie next to it"),
        ({"ElementDataFile": "LIST"}, "several files"),
        ({"DimSize": "9999999 9999999 9999999"}, "too much memory"),
        ({"ElementType": "MET_UCHAR"}, "other voxels than its header says"),
        ({"DistanceUnits": "furlong"}, "unit of length"),
        ({"ElementNumberOfChannels": "3"}, "several numbers"),
    ],
)
def test_a_metaimage_that_cannot_be_is_refused(
    tmp_path: Path, volume: Drawn, change: dict[str, str | None], message: str
) -> None:
    header = {key: value for key, value in (metaimage_header(volume) | change).items() if value is not None}
    header["ElementDataFile"] = header.pop("ElementDataFile")
    assert message in refusal(write_metaimage(tmp_path / "ct.mha", header, bytes_of(volume)))


@pytest.mark.parametrize("name", ["ct.nii.gz", "ct.nrrd", "ct.mha", "ct.nhdr", "ct.mhd"])
def test_what_simpleitk_writes_is_where_simpleitk_puts_it(tmp_path: Path, volume: Drawn, name: str) -> None:
    image = sitk.GetImageFromArray(volume.voxels)
    image.SetDirection(np.stack([volume.row, volume.column, volume.normal], axis=1).ravel().tolist())
    image.SetSpacing((volume.spacing[1], volume.spacing[0], volume.between))
    image.SetOrigin(volume.origin.tolist())
    sitk.WriteImage(image, str(tmp_path / name), useCompression=name.startswith("ct.m"))
    ct = read_ct(tmp_path / name)
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM
    assert np.array_equal(ct.voxels, volume.voxels)
    assert is_volume(tmp_path / name)


def test_no_small_file_takes_much_memory(tmp_path: Path, volume: Drawn) -> None:
    zeros = gzip.compress(bytes(50_000_000))
    path = write_nrrd(tmp_path / "ct.nrrd", nrrd_header(volume) | {"encoding": "raw"}, zeros)
    path.write_bytes(path.read_bytes().replace(b"encoding: raw", b"encoding: gzip"))
    assert "other voxels than its header says" in refusal(path)


def test_values_that_are_no_numbers_are_refused(tmp_path: Path, volume: Drawn) -> None:
    voxels = volume.voxels.astype(np.float32)
    voxels[1, 2, 3] = np.inf
    nibabel.save(nifti(volume, voxels), tmp_path / "ct.nii")
    assert "values that are no numbers" in refusal(tmp_path / "ct.nii")


def test_a_pipe_as_a_ct_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "ct.nrrd")
    program = "import sys; from endoct.workbench.cli import main; sys.argv = ['endoct', *sys.argv[1:]]; main()"
    words = ["-c", program, "pose", "--plan-only", "--ct", str(tmp_path / "ct.nrrd"), "--entry=0,0,0", "--target=0,0,9"]
    command = [sys.executable, *words, "-o", str(tmp_path / "out")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 1
    assert "found a pipe" in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
