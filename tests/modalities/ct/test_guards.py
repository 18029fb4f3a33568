"""Each guard of a CT's readers fires on a file of pydicom, nibabel, pynrrd or SimpleITK that has just that wrong."""

import bz2
import gzip
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
from pydicom.dataset import Dataset

from benchmarks.ct_faults.drawn import Drawn, drawn, named_slices
from benchmarks.ct_faults.writing import enhanced, items, nifti, save, segmentation, write_series, write_slice
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import is_volume, read_ct
from endoct.modalities.ct.nifti import nifti_header

MPEG2 = "1.2.840.10008.1.2.4.100"


@pytest.fixture
def volume() -> Drawn:
    return drawn(Random(8))


def refusal(path: Path) -> str:
    with pytest.raises(EndoctError) as raised:
        read_ct(path)
    assert "\n" not in str(raised.value)
    return str(raised.value)


Change = Callable[[Dataset], Any]


def _frame(of: Dataset, at: int) -> Dataset:
    return of.PerFrameFunctionalGroupsSequence[at]


def _move(of: Dataset, at: int, by: float, axis: int = 0) -> None:
    place = _frame(of, at).PlanePositionSequence[0]
    place.ImagePositionPatient = [float(x) + by * (k == axis) for k, x in enumerate(place.ImagePositionPatient)]


def _alone(of: Dataset) -> None:
    for frame in of.PerFrameFunctionalGroupsSequence:
        frame.PlanePositionSequence = _frame(of, 0).PlanePositionSequence
    del of.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0].SpacingBetweenSlices


OF_SEGMENTATIONS: Mapping[str, tuple[str, Change]] = {
    "two frames at one place": (
        "LABELMAP", lambda of: setattr(_frame(of, 1), "PlanePositionSequence", _frame(of, 0).PlanePositionSequence)
    ),
    "does not say what its segments are; found 0 of 0": ("BINARY", lambda of: delattr(of, "SegmentSequence")),
    "a frame of no segment; found segment 9": (
        "BINARY", lambda of: setattr(_frame(of, 1), "SegmentIdentificationSequence", items(ReferencedSegmentNumber=9))
    ),
    "frames of several orientations or spacings": (
        "BINARY", lambda of: setattr(_frame(of, 1), "PixelMeasuresSequence", items(PixelSpacing=[0.7, 0.7]))
    ),
    "found frames at one place": ("BINARY", _alone),
    "slices; expected 20000 at most": (
        "BINARY", lambda of: setattr(
            of.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0], "SpacingBetweenSlices", 1e-5
        )
    ),
    "mm off the even grid of the others": ("LABELMAP", lambda of: _move(of, 1, 0.2)),
}  # fmt: skip


@pytest.mark.parametrize("said", OF_SEGMENTATIONS)
def test_a_segmentation_that_cannot_be_is_refused(tmp_path: Path, volume: Drawn, said: str) -> None:
    kind, change = OF_SEGMENTATIONS[said]
    of = segmentation(volume, {"bone": volume.voxels > 300}, kind=kind)
    change(of)
    save(of, tmp_path / "seg.dcm")
    assert said in refusal(tmp_path / "seg.dcm")


def test_two_segmentations_in_a_folder_are_refused(tmp_path: Path, volume: Drawn) -> None:
    for name in ("a.dcm", "b.dcm"):
        save(segmentation(volume, {"bone": volume.voxels > 300}), tmp_path / name)
    assert "2 files of segmentations; expected one" in refusal(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda of: of.PerFrameFunctionalGroupsSequence.pop(), "frames, 7 of them described"),
        (
            lambda of: setattr(
                _frame(of, 2), "PlaneOrientationSequence", items(ImageOrientationPatient=[1, 0, 0, 1, 0, 0])
            ),
            "frame 3 of .*has an orientation that cannot be",
        ),
        (
            lambda of: setattr(
                _frame(of, 1), "PlaneOrientationSequence", items(ImageOrientationPatient=[1, 0, 0, 0.01, 1, 0])
            ),
            "frame 2 of .*has an orientation that cannot be",
        ),
        (
            lambda of: setattr(
                _frame(of, 1), "PixelValueTransformationSequence", items(ModalityLUTSequence=[Dataset()])
            ),
            r"frame 2 of .*by a table \(Modality LUT\)",
        ),
        (lambda of: setattr(of, "InConcatenationNumber", 1), "part 1 of a number that it does not say"),
        (lambda of: setattr(of, "ConcatenationUID", "1.2.9"), "part 0 of a number that it does not say"),
    ],
)  # fmt: skip
def test_an_enhanced_ct_that_cannot_be_is_refused(tmp_path: Path, volume: Drawn, change: Change, said: str) -> None:
    of = enhanced(named_slices(volume))
    change(of)
    save(of, tmp_path / "ct.dcm")
    with pytest.raises(EndoctError, match=said):
        read_ct(tmp_path / "ct.dcm")


def test_both_halves_of_a_concatenation_are_one_volume(tmp_path: Path, volume: Drawn) -> None:
    slices = named_slices(volume)
    for number, part in ((1, slices[:3]), (2, slices[3:])):
        of = enhanced(part)
        of.ConcatenationUID, of.InConcatenationNumber, of.InConcatenationTotalNumber = "1.2.9", number, 2
        save(of, tmp_path / f"{number}.dcm")
    assert len(read_ct(tmp_path).voxels) == len(slices)
    (tmp_path / "2.dcm").unlink()
    assert "found part 1 of 2" in refusal(tmp_path)


def test_a_video_is_no_ct(tmp_path: Path, volume: Drawn) -> None:
    (tmp_path / "ct").mkdir()
    for k, one in enumerate(named_slices(volume)):
        write_slice(tmp_path / "ct" / f"{k}.dcm", k, one | {"PixelData": b"\xfe\xff\x00\xe0\0\0\0\0"}, MPEG2)
    assert "found a video" in refusal(tmp_path / "ct")


def test_too_few_slices_and_slices_too_far_askew_are_refused(tmp_path: Path, volume: Drawn) -> None:
    slices = named_slices(volume)
    assert "found 2 slices; expected 3" in refusal(write_series(tmp_path / "two", slices[:2]))
    for k, one in enumerate(slices):
        one["ImagePositionPatient"] = (volume.position(k) + 2 * k * volume.between * volume.column).tolist()
    assert "slices that lie 63° askew" in refusal(write_series(tmp_path / "askew", slices))


@pytest.mark.parametrize(
    ("signed", "value", "limit"), [(1, 63536, None), (1, 32768, None), (0, 63536, 63530), (1, -2000, -1990)]
)
def test_what_was_padded_is_air(tmp_path: Path, volume: Drawn, signed: int, value: int, limit: int | None) -> None:
    slices = named_slices(volume)
    for one in slices:
        numbers = one["values"].astype(np.int32) + (0 if signed else 1024)
        numbers[0, :3] = [value - 65536 * (signed and value > 0), value if limit is None else limit, 100]
        one |= {"PixelRepresentation": signed, "RescaleIntercept": 0 if signed else -1024, "PixelPaddingValue": value}
        one |= {"PixelPaddingRangeLimit": limit, "PixelData": (numbers & 0xFFFF).astype("<u2").tobytes()}
        if signed and value > 0:  # as pydicom writes a number without its sign
            one["PixelPaddingValue"] = value - 65536
    ct = read_ct(write_series(tmp_path / "series", slices))
    assert ct.voxels[:, 0, :3].tolist() == [[-1000, -1000, 100 if signed else -924]] * len(slices)
    assert np.array_equal(ct.voxels[:, 1:], volume.voxels[:, 1:])
    assert f"{2 * len(slices)} voxels" in ct.notes[0]
    assert not ct.doubts


def test_a_padding_that_tissue_has_is_doubted_and_no_ct_is_padded(tmp_path: Path, volume: Drawn) -> None:
    slices = [one | {"PixelPaddingValue": int(volume.voxels[0, 0, 0])} for one in named_slices(volume)]
    slices[0]["values"] = np.full_like(slices[0]["values"], 40)
    slices = [one | {"PixelPaddingValue": 40} for one in slices]
    ct = read_ct(write_series(tmp_path / "series", slices))
    assert (ct.voxels[0] == -1000).all()
    assert "ct-padding-like-tissue" in [doubt.code for doubt in ct.doubts]
    other = read_ct(write_series(tmp_path / "mr", [one | {"Modality": "MR"} for one in slices]))
    assert (other.voxels[0] == 40).all()


def test_a_directory_beside_slices_is_left_out(tmp_path: Path, volume: Drawn) -> None:
    folder = write_series(tmp_path / "series", named_slices(volume))
    of = Dataset()
    of.SOPClassUID, of.SOPInstanceUID, of.DirectoryRecordSequence = "1.2.840.10008.1.3.10", "1.2.3", []
    save(of, folder / "DIRFILE")
    data = (folder / "DIRFILE").read_bytes()
    at = data.index(b"\x08\x00\x16\x00UI", 144)
    (folder / "DIRFILE").write_bytes(data[:at] + data[data.index(b"\x04\x00\x20\x12SQ") :])
    assert read_ct(folder).notes == ("left out as no images: DIRFILE",)
    (tmp_path / "alone").mkdir()
    (folder / "DIRFILE").rename(tmp_path / "alone" / "DIRFILE")
    assert not is_volume(tmp_path / "alone")


def _nrrd(path: Path, volume: Drawn, data: Any = None, **changed: Any) -> Path:
    header = {
        "space": "left-posterior-superior",
        "space directions": volume.to_lps[:3, :3].T,
        "space origin": volume.origin,
        "encoding": "raw",
    }
    nrrd.write(str(path), volume.voxels.transpose() if data is None else data, header | changed, index_order="F")
    return path


@pytest.mark.parametrize("encoding", ["gzip", "bzip2"])
def test_several_members_of_an_archive_are_one_volume(tmp_path: Path, volume: Drawn, encoding: str) -> None:
    pack = {"gzip": gzip.compress, "bzip2": bz2.compress}[encoding]
    path = _nrrd(tmp_path / "ct.nrrd", volume)
    head, _, data = path.read_bytes().partition(b"\n\n")
    head = head.replace(b"encoding: raw", f"encoding: {encoding}".encode())
    parts = pack(data[:90]) + pack(data[90:91]) + pack(data[91:])
    for fill in (b"", b"\0" * 300, b"\n"):
        path.write_bytes(head + b"\n\n" + parts + fill)
        assert np.array_equal(read_ct(path).voxels, volume.voxels)
    path.write_bytes(head + b"\n\n" + parts[:-20])
    assert "compressed voxels that are cut off" in refusal(path)
    path.write_bytes(head + b"\n\n" + parts + pack(b"one"))
    assert "has other voxels than its header says" in refusal(path)
    nibabel.save(nifti(volume), tmp_path / "ct.nii")
    data = (tmp_path / "ct.nii").read_bytes()
    (tmp_path / "ct.nii.gz").write_bytes(gzip.compress(data[:200]) + gzip.compress(data[200:]))
    assert np.array_equal(read_ct(tmp_path / "ct.nii.gz").voxels, volume.voxels)


def test_a_detached_header_may_say_that_its_voxels_lie_here(tmp_path: Path, volume: Drawn) -> None:
    path = _nrrd(tmp_path / "ct.nhdr", volume)
    text = path.read_text()
    for name, ok in (("./ct.raw", True), ("../ct.raw", False), ("./../ct.raw", False), ("a/ct.raw", False)):
        path.write_text(text.replace("data file: ct.raw", f"data file: {name}"))
        if ok:
            assert np.array_equal(read_ct(path).voxels, volume.voxels)
        else:
            assert "does not lie next to it" in refusal(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("\ntype", f"\n# {'c' * 1_000_000}\ntype"), "a header of more than 1 MB"),
        (lambda text: text.replace("dimension: 3", "dimension: 5"), "does not say|5 dimensions|cannot be read"),
        (lambda text: text.replace("encoding: raw", "encoding: raw\nbyte skip: -2"), "byte skip -2"),
        (lambda text: text.replace("sizes: ", "sizes: 0 "), "cannot be read|no volume|space directions of 4"),
        (lambda text: text.replace("data file: ct.raw", "data file: ct.%03d.raw 1 9 1"), "its voxels in several files"),
        (lambda text: text.replace("data file: ct.raw", "data file: LIST"), "its voxels in several files"),
        (lambda text: text.replace("encoding: raw", "encoding: ascii"), "voxels of type short|of type int16, ascii"),
        (lambda text: text.replace("type: int16", "type: block"), "voxels of type block, raw"),
        (lambda text: re.sub("endian: .*\n", "", text), "in which order its bytes are"),
        (lambda text: re.sub("space directions: .*\n", "", text), "found no space directions"),
        (lambda text: re.sub("space directions: .*\n", "spacings: 1 1 1\n", text), "found spacings only"),
        (lambda text: re.sub("space origin: .*\n", "", text), "found no space origin"),
        (
            lambda text: text.replace("encoding", 'space units: "mm" "mm" "inch"\nencoding'),
            "unit of length that is not",
        ),
        (lambda text: text.replace("encoding", 'units: "mm" "mm" "um"\nencoding'), "two things of its unit"),
        (
            lambda text: re.sub(r"space directions: \S+", "space directions: none", text),
            "3 dimensions, 2 of them in space",
        ),
        (lambda text: re.sub("sizes: [0-9]+ ([0-9]+)", r"sizes: 4000 \1", text), "ct.raw is cut off"),
    ],
)
def test_an_nrrd_whose_header_cannot_be_is_refused(
    tmp_path: Path, volume: Drawn, change: Callable[[str], str], said: str
) -> None:
    path = _nrrd(tmp_path / "ct.nhdr", volume)
    path.write_text(change(path.read_text()))
    with pytest.raises(EndoctError, match=said):
        read_ct(path)


def test_an_nrrd_of_several_numbers_a_voxel_or_one_label_twice_is_refused(tmp_path: Path, volume: Drawn) -> None:
    two = np.stack([volume.voxels.transpose()] * 2)
    of_two = {"space directions": np.vstack([[np.nan] * 3, volume.to_lps[:3, :3].T])}
    assert "2 numbers a voxel" in refusal(_nrrd(tmp_path / "a.nrrd", volume, two, **of_two))
    named = {f"Segment{k}_{key}": value for k in (0, 1) for key, value in (("Name", "bone"), ("LabelValue", "1"))}
    assert "names one label twice" in refusal(
        _nrrd(tmp_path / "b.seg.nrrd", volume, (volume.voxels > 300).astype(np.uint8).transpose(), **named)
    )
    assert "layers of float64" in refusal(
        _nrrd(tmp_path / "c.seg.nrrd", volume, volume.voxels.astype(np.float64).transpose(), **named)
    )
    for key, value in (("LabelValue", "x"), ("Layer", "1")):
        assert "which voxels are segment 1" in refusal(
            _nrrd(tmp_path / "d.seg.nrrd", volume, **(named | {f"Segment1_{key}": value}))
        )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("ElementType = MET_SHORT", "ElementType = MET_STRING"), "of MET_STRING"),
        (("BinaryData = True", "BinaryData = False"), "voxels as text"),
        (("ObjectType = Image", "ObjectType = Image\nElementToIntensityFunctionSlope = 2"), "a slope of 2"),
        (("ElementDataFile", "HeaderSize = -7\nElementDataFile"), "HeaderSize = -7"),
        (("NDims = 3", "NDims = 3\nNDims = 3"), "'ndims' twice"),
        (("NDims = 3", "NDims = three"), "ndims = three; expected a whole number"),
        (("BinaryData = True", "BinaryData = maybe"), "binarydata = maybe"),
        (("ElementDataFile = ct.raw\n", ""), "a header without ElementDataFile"),
        (("NDims = 3", "NDims = 999"), "999 dimensions"),
        (("ObjectType = Image", "ObjectType = Tube"), "is no volume"),
        (("ObjectType = Image", "ObjectType = Image\nDistanceUnits = inch"), "DistanceUnits = inch"),
        (("ElementSpacing = 1 1 1", "ElementSpacing = 1 1 0"), "voxels without a size"),
        (("ElementSpacing = 1 1 1", "ElementSpacing = 1 1"), "elementspacing = 1 1; expected 3 numbers"),
        (("TransformMatrix = 1", "TransformMatrix = 2"), "directions that are not of length 1"),
        (("Offset =", "Origin = 0 0 0\nOffset ="), "offset and origin; expected one of"),
        (("Offset =", "Place ="), "no offset or position or origin"),
        (("ct.raw", "LIST"), "its voxels in several files"),
        (("ct.raw", "ct%03d.raw 1 9 1"), "its voxels in several files"),
    ],
)
def test_a_metaimage_whose_header_cannot_be_is_refused(
    tmp_path: Path, volume: Drawn, change: tuple[str, str], said: str
) -> None:
    path = tmp_path / "ct.mhd"
    sitk.WriteImage(sitk.GetImageFromArray(volume.voxels), str(path))
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change).rstrip("\n"))
    assert said in refusal(path)


def test_a_metaimage_of_several_numbers_a_voxel_is_refused(tmp_path: Path, volume: Drawn) -> None:
    two = sitk.GetImageFromArray(np.stack([volume.voxels] * 2, axis=-1), isVector=True)
    sitk.WriteImage(two, str(tmp_path / "ct.mha"))
    assert "found several numbers a voxel" in refusal(tmp_path / "ct.mha")


def test_a_nifti_of_colours_of_times_or_with_forms_apart_is_refused(tmp_path: Path, volume: Drawn) -> None:
    path = tmp_path / "ct.nii"
    nibabel.save(nifti(volume, volume.voxels.astype(np.complex64)), path)
    assert "voxels of complex64" in refusal(path)
    nibabel.save(nibabel.Nifti1Image(np.stack([volume.voxels.transpose()] * 2, -1), np.eye(4)), path)
    assert "4 dimensions" in refusal(path)
    image = nifti(volume)
    matrix = image.get_sform()
    matrix[0, 3] += 5
    image.set_sform(matrix, 1)
    nibabel.save(image, path)
    assert "sform and qform 5 mm apart" in refusal(path)
    with pytest.raises(EndoctError, match="NIfTI holds no"):
        nifti_header((2, 2, 2), np.dtype("S3"), np.eye(4), "")
