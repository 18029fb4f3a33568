"""What is refused or doubted of any volume, whoever wrote it: SimpleITK, nibabel, pynrrd, pydicom or NumPy."""

from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
from PIL import Image

from benchmarks.ct_faults.drawn import Drawn, drawn, named_slices
from benchmarks.ct_faults.writing import nifti, save, segmentation, write_series
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import check_within, holds_labels, meaning_of, read_ct
from endoct.modalities.ct.trajectory import Trajectory, as_point

Slices = list[dict[str, Any]]


@pytest.fixture
def volume() -> Drawn:
    return drawn(Random(8))


def refusal(read: Callable[[], object]) -> str:
    with pytest.raises(EndoctError) as raised:
        read()
    assert "\n" not in str(raised.value)
    return str(raised.value)


def written(path: Path, volume: Drawn, **changed: Any) -> Path:
    header = {
        "space": "left-posterior-superior",
        "space directions": volume.to_lps[:3, :3].T,
        "space origin": volume.origin,
        "encoding": "raw",
    } | changed
    kept = {field: value for field, value in header.items() if value is not None}
    nrrd.write(str(path), volume.voxels.transpose(), kept, index_order="F")
    return path


def test_what_is_not_there_and_what_is_no_volume_is_said(tmp_path: Path, volume: Drawn) -> None:
    assert "ct.nii cannot be read; found no such file" in refusal(lambda: read_ct(tmp_path / "ct.nii"))
    (tmp_path / "ct.nii").symlink_to(tmp_path / "gone.nii")
    assert "found a link that leads nowhere" in refusal(lambda: read_ct(tmp_path / "ct.nii"))
    np.save(tmp_path / "ct.npy", volume.voxels)
    assert "ct.npy is no volume; found no DICOM, NIfTI" in refusal(lambda: read_ct(tmp_path / "ct.npy"))
    Image.fromarray(volume.voxels[0] > 0).save(tmp_path / "ct.png")
    (tmp_path / "ct.png").rename(tmp_path / "ct.nrrd")
    assert "no DICOM, NIfTI, NRRD or MetaImage by its content" in refusal(lambda: read_ct(tmp_path / "ct.nrrd"))


def test_voxels_without_a_size_or_of_one_that_cannot_be_are_refused(tmp_path: Path, volume: Drawn) -> None:
    flat = volume.to_lps[:3, :3].T * [[1], [1], [0]]
    path = written(tmp_path / "ct.nrrd", volume, **{"space directions": flat})
    assert "does not say where its voxels lie; found steps of 0 × " in refusal(lambda: read_ct(path))
    image = nifti(volume)
    image.header.set_xyzt_units("meter")
    nibabel.save(image, tmp_path / "ct.nii")
    assert "has voxels of a size that cannot be; found " in refusal(lambda: read_ct(tmp_path / "ct.nii"))
    askew = volume.to_lps[:3, :3].T.copy()
    askew[2] += 0.3 * askew[0]
    path = written(tmp_path / "ct.nrrd", volume, **{"space directions": askew})
    assert "do not lie at right angles" in refusal(lambda: read_ct(path))
    image = sitk.GetImageFromArray(np.where(volume.voxels > 2000, np.nan, volume.voxels).astype(np.float32))
    sitk.WriteImage(image, str(tmp_path / "ct.mha"))
    assert "has values that are no numbers; found nan" in refusal(lambda: read_ct(tmp_path / "ct.mha"))


def test_coordinates_without_a_name_have_to_be_stated(tmp_path: Path, volume: Drawn) -> None:
    path = written(tmp_path / "ct.nrrd", volume, space=None, **{"space dimension": 3})
    assert "whether its coordinates are RAS or LPS" in refusal(lambda: read_ct(path))
    assert np.array_equal(read_ct(path, "ras").origin_mm, volume.origin * [-1, -1, 1])
    las = read_ct(written(tmp_path / "ct.nrrd", volume, space="left-anterior-superior"))
    assert "las.nrrd does not say" in refusal(lambda: meaning_of(las, None, "las.nrrd"))
    assert meaning_of(las, "ras", "las.nrrd") == "ras"
    assert np.array_equal(las.origin_mm, volume.origin * [1, -1, 1])


def test_an_end_outside_of_the_ct_is_refused_in_its_own_coordinates(tmp_path: Path) -> None:
    image = sitk.GetImageFromArray(np.zeros((4, 5, 6), np.int16))
    image.SetOrigin((10.0, 20.0, 30.0))
    sitk.WriteImage(image, str(tmp_path / "ct.mha"))
    ct = read_ct(tmp_path / "ct.mha")
    for x, inside in ((9.51, True), (15.49, True), (9.49, False), (15.51, False)):
        line = Trajectory((12.0, 21.0, 31.0), as_point(np.array([x, 22.0, 33.0])))
        if inside:
            check_within(ct, line, "lps", "ct.mha")
            continue
        said = refusal(lambda line=line: check_within(ct, line, "ras", "ct.mha"))
        assert f"the target lies outside ct.mha; found {-x:g}, -22, 33" in said
        assert "within -15.0 … -10.0, -24.0 … -20.0, 30.0 … 33.0 mm (RAS)" in said


def test_labels_of_what_is_no_bone_and_numbers_of_either_kind_are_refused(tmp_path: Path, volume: Drawn) -> None:
    mask = volume.voxels > 300
    for names, fits in ((("Mastoid bone",), True), (("bone", "air cells"), False), (("facial nerve",), False)):
        save(segmentation(volume, dict.fromkeys(names, mask)), tmp_path / "seg.dcm")
        ct = read_ct(tmp_path / "seg.dcm")
        if fits:
            assert holds_labels(ct, "the CT", "")
        else:
            assert "does not have air as 0 and bone as its labels" in refusal(lambda ct=ct: holds_labels(ct, "it", ""))
    nibabel.save(nifti(volume, np.abs(volume.voxels)), tmp_path / "ct.nii")
    ct = read_ct(tmp_path / "ct.nii")
    assert "may hold Hounsfield units, or labels; found values from" in refusal(lambda: holds_labels(ct, "it", ""))


def each(**elements: Any) -> Callable[[Slices], None]:
    def change(slices: Slices) -> None:
        for one in slices:
            one |= elements

    return change


def inverted(slices: Slices) -> None:
    for one in slices:
        one["values"] = -1 - one["values"]


def dim(slices: Slices) -> None:
    for one in slices:
        one["values"] = np.minimum(one["values"], 200)


DOUBTS: dict[str, Callable[[Slices], None]] = {
    "ct-other-modality": each(Modality="MR"),
    "ct-other-unit": each(RescaleType="OD"),
    "ct-no-rescale": each(RescaleSlope=None, RescaleIntercept=None),
    "ct-lossy": each(LossyImageCompression="01"),
    "ct-rescale-varies": lambda slices: slices[1].update(RescaleIntercept=-1),
    "ct-tilt-contradicted": each(GantryDetectorTilt=12.0, ImageOrientationPatient=[1, 0, 0, 0, 1, 0]),
    "ct-values-inverted": inverted,
    "ct-values-too-low": each(RescaleIntercept=-1024),
    "ct-no-air": each(RescaleIntercept=300),
    "ct-no-bone": dim,
    "ct-slices-copied": lambda slices: slices[1].update(values=slices[2]["values"]),
    "ct-slices-renumbered": lambda slices: slices[1].update(InstanceNumber=9),
}


@pytest.mark.parametrize("code", DOUBTS)
def test_what_a_series_says_against_itself_is_doubted_by_name(tmp_path: Path, volume: Drawn, code: str) -> None:
    slices = named_slices(volume)
    for k, one in enumerate(slices):
        one["ImagePositionPatient"] = [0.0, 0.0, k * volume.between]
        one["ImageOrientationPatient"] = [1, 0, 0, 0, 1, 0]
    assert read_ct(write_series(tmp_path / "sound", slices)).doubts == ()
    DOUBTS[code](slices)
    doubts = read_ct(write_series(tmp_path / "series", slices)).doubts
    assert code in [doubt.code for doubt in doubts]


def test_forms_of_nifti_that_lie_a_little_apart_are_doubted(tmp_path: Path, volume: Drawn) -> None:
    for apart_mm, codes in ((0.005, []), (0.02, ["ct-forms-apart"])):
        image = nifti(volume)
        matrix = image.get_sform()
        matrix[0, 3] += apart_mm
        image.set_sform(matrix, 1)
        nibabel.save(image, tmp_path / "ct.nii")
        assert [doubt.code for doubt in read_ct(tmp_path / "ct.nii").doubts] == codes


def test_a_label_beyond_the_numbers_of_voxels_and_overlaps_beyond_them_are_refused(
    tmp_path: Path, volume: Drawn
) -> None:
    mask = volume.voxels > 300
    of = segmentation(volume, {"bone": mask, "cochlea": mask})
    path = tmp_path / "seg.dcm"
    for numbers, said in (((0, 1), "a label of "), ((1, 65_535), "overlap in too many ways")):
        for segment, number in zip(of.SegmentSequence, numbers, strict=True):
            segment.SegmentNumber = number
        for k, frame in enumerate(of.PerFrameFunctionalGroupsSequence):
            first = k < of.NumberOfFrames // 2
            frame.SegmentIdentificationSequence[0].ReferencedSegmentNumber = numbers[0] if first else numbers[1]
        save(of, path)
        assert said in refusal(lambda: read_ct(path))
