"""A series of DICOM is an even volume, mended and said, or refused in one line that names the slice."""

import os
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import imagecodecs
import numpy as np
import pytest
from pydicom import dcmread
from pydicom.encaps import encapsulate
from scipy.spatial.transform import Rotation
from tolerances import CT_PLACE_MM, CT_SHEARED_HU

from benchmarks.ct_faults.drawn import MARK_HU, Drawn, drawn, named_slices
from benchmarks.ct_faults.writing import enhanced, save, segmentation, write_series, write_slice
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import CtVolume, is_volume, read_ct, upright

Slices = list[dict[str, Any]]
JPEG_LOSSLESS, JPEG_LS, JPEG_2000 = (f"1.2.840.10008.1.2.4.{number}" for number in (70, 80, 90))


@pytest.fixture
def volume() -> Drawn:
    return drawn(Random(8))


@pytest.fixture
def slices(volume: Drawn) -> Slices:
    return named_slices(volume)


def mark_of(ct: CtVolume) -> np.ndarray:
    return np.asarray(ct.origin_mm + np.argwhere(ct.voxels == MARK_HU)[0] @ ct.steps_mm)


def refusal(path: Path) -> str:
    with pytest.raises(EndoctError) as raised:
        read_ct(path)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_each_voxel_lies_where_the_headers_put_it(tmp_path: Path, slices: Slices) -> None:
    folder = write_series(tmp_path / "series", slices)
    ct = read_ct(folder)
    assert (ct.coordinates, ct.notes, ct.doubts) == ("lps", (), ())
    for path in folder.iterdir():  # by hand, from each header
        header = dcmread(path)
        position = np.array(header.ImagePositionPatient, float)
        row, column = np.split(np.array(header.ImageOrientationPatient, float), 2)
        between_rows, between_columns = map(float, header.PixelSpacing)
        j, i = header.Rows - 1, header.Columns - 1
        place = position + j * between_rows * column + i * between_columns * row
        index = (place - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)
        k = round(float(index[0]))
        assert np.abs((index - [k, j, i]) @ ct.steps_mm).max() < CT_PLACE_MM
        assert np.array_equal(ct.voxels[k], header.pixel_array)


@pytest.mark.parametrize("stated", ["15.0", "-15.0", None, "0"])
def test_a_tilted_gantry_is_placed_where_it_lies_and_said(
    tmp_path: Path, volume: Drawn, slices: Slices, stated: str | None
) -> None:
    aside = volume.between * np.tan(np.radians(15))
    for k, one in enumerate(slices):
        one["ImagePositionPatient"] = (volume.position(k) + k * aside * volume.column).tolist()
        one["GantryDetectorTilt"] = stated
    ct = read_ct(write_series(tmp_path / "series", slices))
    k, j, i = volume.mark
    assert np.abs(mark_of(ct) - (volume.place(k, j, i) + k * aside * volume.column)).max() < CT_PLACE_MM
    said = [*ct.notes, *(doubt.what for doubt in ct.doubts)]
    assert len(said) == 1
    assert "15.0" in said[0]
    assert "mm aside of the first" in said[0]
    assert [doubt.code for doubt in ct.doubts] == ([] if stated and "15" in stated else ["ct-slices-askew"])


def test_a_sheared_volume_becomes_upright_with_its_content_in_place() -> None:
    steps = np.array([[0.0, 0.31, 0.8], [0.0, 0.4, 0.0], [0.45, 0.0, 0.0]])
    origin = np.array([-12.0, 30.0, 7.0])

    def hounsfield(places: np.ndarray) -> np.ndarray:
        return np.asarray(1000 * np.sin(places[..., 1] / 0.4) * np.cos(places[..., 0] / 0.45))

    index = np.moveaxis(np.indices((20, 40, 30)), 0, -1)
    ct = upright(CtVolume(hounsfield(origin + index @ steps).astype(np.float32), origin, steps, "lps"))
    assert not ct.is_sheared
    assert ct.voxels.shape == (20, 40 + 15, 30)
    places = ct.origin_mm + np.moveaxis(np.indices(ct.voxels.shape), 0, -1) @ ct.steps_mm
    within = (places - origin) @ np.linalg.inv(steps)
    inside = np.all((within > 4) & (within < np.array([20, 40, 30]) - 5), axis=-1)
    assert inside.sum() > 3000
    assert np.abs(ct.voxels - hounsfield(places))[inside].max() < CT_SHEARED_HU


@pytest.mark.parametrize("marked", [True, False])
def test_a_scout_is_left_out_where_it_says_so_and_else_named(tmp_path: Path, slices: Slices, marked: bool) -> None:
    scout = slices[0] | {
        "name": "scout.dcm",
        "ImageOrientationPatient": [1, 0, 0, 0, 0, -1],
        "ImagePositionPatient": [0] * 3,
    }
    scout |= {"ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]} if marked else {}
    folder = write_series(tmp_path / "series", [scout, *slices])
    if not marked:
        assert "another orientation in scout.dcm" in refusal(folder)
        return
    ct = read_ct(folder)
    assert len(ct.voxels) == len(slices)
    assert ct.notes == ("left out as a scout: scout.dcm",)
    assert "1 scouts only" in refusal(write_series(tmp_path / "scouts", [scout]))


def test_two_volumes_in_one_series_are_refused(tmp_path: Path, volume: Drawn, slices: Slices) -> None:
    def with_second(by: float, **other: Any) -> str:
        more = [
            one | {"name": f"b{k}", "ImagePositionPatient": volume.position(k + by).tolist()} | other
            for k, one in enumerate(slices)
        ]
        return refusal(write_series(tmp_path / f"series{by}{len(other)}", [*slices, *more]))

    assert f"{len(slices)} slices at the places of others" in with_second(0.0)
    assert "numbered as those of 2 volumes by turns" in with_second(0.5)
    assert "ConvolutionKernel H60s in b0, b1, b2" in with_second(0.5, ConvolutionKernel="H60s")
    assert "AcquisitionNumber changes to and fro" in with_second(0.5, AcquisitionNumber=2, InstanceNumber=None)
    assert "TemporalPositionIdentifier 2" in with_second(0.0, TemporalPositionIdentifier=2)


def test_slices_numbered_in_another_order_are_doubted(tmp_path: Path, slices: Slices) -> None:
    slices[1]["ImagePositionPatient"], slices[3]["ImagePositionPatient"] = (
        slices[3]["ImagePositionPatient"],
        slices[1]["ImagePositionPatient"],
    )
    (doubt,) = read_ct(write_series(tmp_path / "series", slices)).doubts
    assert doubt.code == "ct-slices-renumbered"


def test_positions_with_few_digits_are_doubted_and_no_slice_lies_off_by_more(tmp_path: Path, slices: Slices) -> None:
    for k, one in enumerate(slices):
        one |= {
            "ImagePositionPatient": [10.0, 20.0, round(0.625 * k, 1)],
            "ImageOrientationPatient": [1, 0, 0, 0, 1, 0],
        }
    ct = read_ct(write_series(tmp_path / "series", slices))
    assert [doubt.code for doubt in ct.doubts] == ["ct-positions-rounded"]
    assert ct.steps_mm[0, 2] == pytest.approx(0.625, abs=0.01)
    slices[2]["ImagePositionPatient"] = [10.0, 20.0, 1.1]
    assert "IM0002.dcm" in refusal(write_series(tmp_path / "other", slices))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.write_bytes(b""), "IM0002.dcm is no slice; found an empty file"),
        (lambda path: path.write_bytes(path.read_bytes()[:-40]), "IM0002.dcm is cut off"),
        (lambda path: path.write_bytes(path.read_bytes()[:300]), "IM0002.dcm"),
        (lambda path: (path.unlink(), path.symlink_to("gone.dcm")), "a link that leads nowhere"),
        (lambda path: (path.unlink(), os.mkfifo(path)), "IM0002.dcm is no slice; found a pipe"),
        (lambda path: path.write_bytes(bytes(range(256)) * 9), "no DICOM, or a damaged one"),
    ],
)
def test_a_damaged_slice_is_named(tmp_path: Path, slices: Slices, damage: Any, message: str) -> None:
    folder = write_series(tmp_path / "series", slices)
    damage(folder / "IM0002.dcm")
    assert message in refusal(folder)


def test_other_files_in_the_folder_are_no_slices(tmp_path: Path, slices: Slices) -> None:
    folder = write_series(tmp_path / "series", slices)
    (folder / "README").write_text("what: a series\n")
    (folder / "preview.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (folder / ".DS_Store").write_bytes(b"\0\1\2")
    ct = read_ct(folder)
    assert ct.notes == ("left out as no DICOM: README, preview.png",)
    assert is_volume(folder)
    assert not is_volume(tmp_path)
    assert "name the folder that holds the slices" in refusal(tmp_path)


def test_values_are_those_of_each_header(tmp_path: Path, volume: Drawn, slices: Slices) -> None:
    for one in slices:
        one["PhotometricInterpretation"] = "MONOCHROME1"
    ct = read_ct(write_series(tmp_path / "inverted", slices))
    assert np.array_equal(ct.voxels, volume.voxels)
    assert "MONOCHROME1" in ct.notes[0]
    slices[2] |= {"RescaleIntercept": -24, "values": slices[2]["values"] + np.int16(24)}
    ct = read_ct(write_series(tmp_path / "scaled", slices))
    assert np.array_equal(ct.voxels, volume.voxels)
    assert [doubt.code for doubt in ct.doubts] == ["ct-rescale-varies"]
    slices[1]["PhotometricInterpretation"] = "PALETTE COLOR"
    assert "IM0001.dcm is no CT; found PALETTE COLOR" in refusal(write_series(tmp_path / "palette", slices))


def compressed(stored: np.ndarray, syntax: str) -> bytes:
    if syntax == JPEG_2000:
        return bytes(imagecodecs.jpeg2k_encode(stored, level=0, codecformat="j2k", reversible=True))
    unsigned = stored.view(np.uint16)
    if syntax == JPEG_LS:
        return bytes(imagecodecs.jpegls_encode(unsigned))
    return bytes(imagecodecs.jpeg_encode(unsigned, lossless=True, predictor=1, bitspersample=16))


@pytest.mark.parametrize("syntax", [JPEG_LOSSLESS, JPEG_LS, JPEG_2000])
@pytest.mark.parametrize("signed", [False, True])
def test_compressed_slices_have_the_same_values(
    tmp_path: Path, volume: Drawn, slices: Slices, syntax: str, signed: bool
) -> None:
    intercept = 0 if signed else -1024
    (tmp_path / "series").mkdir()
    for number, one in enumerate(slices):
        stored = (one["values"].astype(np.int32) - intercept).astype(np.int16 if signed else np.uint16)
        of = {"PixelData": encapsulate([compressed(stored, syntax)]), "PixelRepresentation": int(signed)}
        write_slice(tmp_path / "series" / f"{number}.dcm", number, one | of | {"RescaleIntercept": intercept}, syntax)
    assert np.array_equal(read_ct(tmp_path / "series").voxels, volume.voxels)


def test_a_picture_of_another_size_than_stated_is_not_decoded(tmp_path: Path, slices: Slices) -> None:
    (tmp_path / "series").mkdir()
    for number, one in enumerate(slices):
        large = np.zeros((3000, 3000), np.uint16) if number == 1 else one["values"].view(np.uint16)
        of = {"PixelData": encapsulate([bytes(imagecodecs.jpegls_encode(large))])}
        write_slice(tmp_path / "series" / f"{number}.dcm", number, one | of, JPEG_LS)
    assert "1.dcm has other pictures in it than it says; found (3000, 3000)" in refusal(tmp_path / "series")


def test_an_enhanced_ct_is_read_frame_by_frame(tmp_path: Path, volume: Drawn, slices: Slices) -> None:
    save(enhanced(slices[::-1]), tmp_path / "ct.dcm")
    ct = read_ct(tmp_path / "ct.dcm")
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM
    assert (int(ct.voxels.min()), int(ct.voxels.max())) == (volume.voxels.min(), MARK_HU)
    save(enhanced([*slices[:2], *slices[3:]]), tmp_path / "gap.dcm")
    assert "between frame 2 of gap.dcm and frame 3 of gap.dcm" in refusal(tmp_path / "gap.dcm")


def test_a_name_says_nothing_of_what_a_file_is(tmp_path: Path, volume: Drawn, slices: Slices) -> None:
    save(enhanced(slices), tmp_path / "ct.nii")
    ct = read_ct(tmp_path / "ct.nii")
    assert ct.coordinates == "lps"
    assert np.abs(mark_of(ct) - volume.marked).max() < CT_PLACE_MM
    os.mkfifo(tmp_path / "pipe.nii.gz")
    assert "no file with content; found a pipe" in refusal(tmp_path / "pipe.nii.gz")


@pytest.mark.parametrize("kind", ["BINARY", "LABELMAP"])
def test_a_segmentation_object_has_its_names_and_places(tmp_path: Path, volume: Drawn, kind: str) -> None:
    part = np.indices(volume.voxels.shape).sum(axis=0) % 6
    part[0] = part[2] = 0  # slices without a frame
    masks = {"facial nerve": part == 1, "cochlea": part == 2}
    save(segmentation(volume, masks, kind=kind), tmp_path / "seg.dcm")
    labels = read_ct(tmp_path / "seg.dcm")
    assert labels.segments is not None
    for segment, (name, mask) in zip(labels.segments, masks.items(), strict=True):
        assert segment.name == name
        where = np.isin(labels.voxels, segment.values)
        for index in (np.argwhere(where)[0], np.argwhere(where)[-1]):
            place = labels.origin_mm + index @ labels.steps_mm
            own = np.linalg.inv(volume.to_lps) @ np.array([*place, 1.0])
            assert mask[tuple(np.rint(own[2::-1]).astype(int))]
        assert where.sum() == mask.sum()
    save(segmentation(volume, masks, kind="FRACTIONAL"), tmp_path / "shares.dcm")
    assert "holds shares of segments" in refusal(tmp_path / "shares.dcm")


def test_segments_that_overlap_are_both_there(tmp_path: Path, volume: Drawn) -> None:
    one, other = np.zeros((2, *volume.voxels.shape), np.bool_)
    one[1:4, 2:6, 2:6] = other[2:5, 4:8, 4:8] = True
    save(segmentation(volume, {"bone": one, "nerve": other}), tmp_path / "seg.dcm")
    labels = read_ct(tmp_path / "seg.dcm")
    assert labels.segments is not None
    sizes = [int(np.isin(labels.voxels, segment.values).sum()) for segment in labels.segments]
    assert sizes == [int(one.sum()), int(other.sum())]
    assert np.unique(labels.voxels).size == 4


def test_other_axes_of_the_patient_are_as_right(tmp_path: Path) -> None:
    volume = drawn(Random(3))
    turn = Rotation.from_euler("xyz", [91, -3, 178], degrees=True).as_matrix()
    turned = replace(volume, row=turn[:, 0], column=turn[:, 1])
    ct = read_ct(write_series(tmp_path / "series", named_slices(turned)))
    assert np.abs(mark_of(ct) - turned.marked).max() < CT_PLACE_MM
