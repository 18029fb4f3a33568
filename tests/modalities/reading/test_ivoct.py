"""IVOCT in DICOM: what the standard has done before display is done, and what the header states needs no sidecar."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydicom import dcmread
from pydicom.sequence import Sequence as Items
from tolerances import COORDINATE_ATOL

from benchmarks.fuzz.dicom_writer import IVOCT_PRESENTATION, item, ivoct, pixels, write
from endoct.base.errors import EndoctError
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.pullback_stream import Pullback
from endoct.modalities.reading.recording import ImageStack, open_stack, stated_by
from endoct.modalities.recognition import open_recording, recognise

BSCANS = np.random.default_rng(3).integers(1, 60_000, (5, 48, 40), dtype=np.uint16)
"""(frame, A-scan, depth)."""


def codes(stack: ImageStack) -> set[str]:
    return {doubt.code for doubt in stack.remarks.doubts}


def read(path: Path) -> NDArray[Any]:
    stack = open_stack(path)
    return np.stack([stack[k] for k in range(len(stack))])


def made(folder: Path, bscans: NDArray[Any] = BSCANS, **options: Any) -> Path:
    return write(ivoct(bscans, **options), folder / "pullback.dcm")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_are_what_pydicom_decodes_with_depth_downward(dtype: Any, tmp_path: Path) -> None:
    path = made(tmp_path, BSCANS.astype(dtype))
    independent = dcmread(path).pixel_array
    np.testing.assert_array_equal(read(path), independent.transpose(0, 2, 1))
    np.testing.assert_array_equal(read(tmp_path), independent.transpose(0, 2, 1))
    again = pickle.loads(pickle.dumps(open_stack(path)))
    np.testing.assert_array_equal(again[3], BSCANS.astype(dtype)[3].T)


def test_padding_goes_the_seam_comes_first_and_the_z_offset_moves_depth(tmp_path: Path) -> None:
    said = [{"padded": 8, "seam": 5 * k, "offset": k - 2} for k in range(5)]
    path = made(tmp_path, per_frame=said, OCTZOffsetApplied="NO")
    found = read(path)
    assert found.shape == (5, 40, 40)
    for k, frame in enumerate(found):
        for ascan, sample in ((0, 20), (39, 7), (11, 33)):
            source = sample - (k - 2)
            assert frame[sample, ascan] == BSCANS[k, (ascan + 5 * k) % 40, source]
    assert not found[4, :2].any()  # moved outward: nothing was recorded there
    assert not found[0, -2:].any()
    notes = " ".join(open_stack(path).remarks.notes)
    assert "there are 40" in notes
    assert "-2 to 2 samples" in notes
    assert "begin at the seam" in notes


def test_a_z_offset_that_was_applied_is_not_applied_again(tmp_path: Path) -> None:
    path = made(tmp_path, per_frame=[{"offset": 7}] * 5)
    np.testing.assert_array_equal(read(path), BSCANS.transpose(0, 2, 1))
    unsaid = made(tmp_path, per_frame=[{"offset": 7}] * 5, OCTZOffsetApplied=None)
    np.testing.assert_array_equal(read(unsaid), BSCANS.transpose(0, 2, 1))
    assert codes(open_stack(unsaid)) == {"z-offset"}


@pytest.mark.parametrize(("rotation", "step"), [("CW", -12), ("CC", 12)])
def test_frames_with_a_seam_of_their_own_are_turned_to_the_first(rotation: str, step: int, tmp_path: Path) -> None:
    # frame 1 begins 90° later, clockwise: a quarter of 48 A-scans
    said = [{"place": 30.0}, {"place": 120.0}, *[{"place": 30.0}] * 3]
    path = made(tmp_path, per_frame=said, CatheterDirectionOfRotation=rotation, FirstALineLocation=30.0)
    found = read(path)
    np.testing.assert_array_equal(found[1], np.roll(BSCANS[1], -step, axis=0).T)
    np.testing.assert_array_equal(found[2], BSCANS[2].T)
    assert codes(open_stack(path)) == set()
    assert "seam-against-start" in codes(open_stack(made(tmp_path, per_frame=said, FirstALineLocation=200.0)))


def test_turns_of_different_length_get_one_number_of_ascans(tmp_path: Path) -> None:
    said = [{"padded": padded} for padded in (0, 24, 0, 3, 0)]
    found = read(made(tmp_path, per_frame=said))
    assert found.shape == (5, 40, 48)
    np.testing.assert_array_equal(found[1][:, ::2], BSCANS[1, :24].T)
    assert "24 to 48" in " ".join(open_stack(tmp_path).remarks.notes)


def test_the_header_states_the_keys_of_a_pullback(tmp_path: Path) -> None:
    said = [{"distance": 0.0}, *[{"distance": 0.2}] * 4]
    made(
        tmp_path,
        np.tile(BSCANS, (1, 2, 2)),
        per_frame=said,
        ALinePixelSpacing=0.004,
        EffectiveRefractiveIndex=1.33,
        CatheterDirectionOfRotation="CC",
        FirstALineLocation=90.0,
    )
    stated = stated_by(tmp_path)
    assert stated.by == "the DICOM header of pullback.dcm"
    assert stated.keys == {
        "modality": "oct",
        "pullback_pitch_mm": 0.2,
        "travel": "out",
        "axial_pixel_mm": pytest.approx(0.004 * 1.33),
        "medium_index": 1.33,
        "intensity": "log",
        "handedness": "mirrored",
        "theta_origin_rad": pytest.approx(np.pi / 2),
        "first_sample_mm": 0.0,
    }
    assert recognise(tmp_path).manifest.name == "oct"
    sizes = "bore_diameter_mm = 0.6\ncapillary_outer_diameter_mm = 0.3\n"
    (tmp_path / "acquisition.toml").write_text(sizes)
    _, stream = open_recording(tmp_path)
    assert isinstance(stream, Pullback)
    assert stream.acquisition.mm_per_px == pytest.approx(0.004)
    (tmp_path / "acquisition.toml").write_text(sizes + "medium_index = 1.0\n")  # it was dry
    _, stream = open_recording(tmp_path)
    assert isinstance(stream, Pullback)
    assert stream.acquisition.medium_index == 1.0
    assert [doubt.code for doubt in stream.remarks.doubts] == ["stated-otherwise"]


def test_air_is_meant_where_the_index_was_not_applied(tmp_path: Path) -> None:
    header = {"ALinePixelSpacing": 0.005, "EffectiveRefractiveIndex": 1.4}
    assert stated_by(made(tmp_path, RefractiveIndexApplied="NO", **header)).keys["axial_pixel_mm"] == 0.005
    assert stated_by(made(tmp_path, **header)).keys["axial_pixel_mm"] == pytest.approx(0.007)
    for lacks in ({"RefractiveIndexApplied": None}, {"EffectiveRefractiveIndex": None}):
        path = made(tmp_path, **(header | lacks))
        assert "axial_pixel_mm" not in stated_by(path).keys
        assert "must state axial_pixel_mm" in " ".join(open_stack(path).remarks.notes)


def test_a_ranging_depth_shows_where_the_header_lies_about_the_index(tmp_path: Path) -> None:
    header = {"ALinePixelSpacing": 0.005, "EffectiveRefractiveIndex": 1.4}
    true = made(tmp_path, **header, RangingDepth=40 * 0.007)
    assert codes(open_stack(true)) == set()
    lie = made(tmp_path, **header, RangingDepth=40 * 0.005)
    (doubt,) = open_stack(lie).remarks.doubts
    assert (doubt.code, doubt.expected) == ("index-applied", pytest.approx(0.005))


def exponential(n: int = 65_536) -> NDArray[np.uint16]:
    return np.rint(np.exp(np.arange(n) * (11 / n))).astype(np.uint16)


def test_logarithms_stay_and_what_only_claims_to_be_is_made_linear(tmp_path: Path) -> None:
    true = made(tmp_path, to_linear=exponential())
    assert stated_by(true).keys["intensity"] == "log"
    np.testing.assert_array_equal(open_stack(true)[1], BSCANS[1].T)
    root = (np.arange(65_536) / 257.0).astype(np.uint16) ** 2
    claimed = made(tmp_path, to_linear=root)
    assert stated_by(claimed).keys["intensity"] == "linear"
    np.testing.assert_array_equal(open_stack(claimed)[1], root[BSCANS[1]].T)
    narrow = made(tmp_path, BSCANS.astype(np.uint8), to_linear=root)  # samples of 8 bits, a table for 16
    np.testing.assert_array_equal(open_stack(narrow)[1], root[BSCANS[1].astype(np.uint8)].T)
    assert stated_by(made(tmp_path, PixelIntensityRelationship="LIN")).keys["intensity"] == "linear"
    unsaid = made(tmp_path, PixelIntensityRelationship=None)
    assert "intensity" not in stated_by(unsaid).keys
    assert "says nothing" in " ".join(open_stack(unsaid).remarks.notes)


def test_places_come_from_distances_or_from_the_speed_of_the_pullback(tmp_path: Path) -> None:
    uneven = made(tmp_path, per_frame=[{"distance": -step} for step in (0.0, 0.2, 0.2, 0.31, 0.2)])
    assert stated_by(uneven).keys["travel"] == "in"
    along = open_stack(uneven).along
    assert along is not None
    np.testing.assert_allclose(along.values, [0, 0.2, 0.4, 0.71, 0.91], atol=COORDINATE_ATOL)
    speed = {"IVUSAcquisition": "MOTORIZED", "IVUSPullbackRate": 20.0, "CatheterRotationalRate": 100.0}
    keys = stated_by(made(tmp_path, **speed)).keys
    assert keys["pullback_pitch_mm"] == pytest.approx(0.2)
    assert (keys["scan"], keys["travel"]) == ("helical", "out")
    standing = made(tmp_path, **speed, IVUSPullbackStartFrameNumber=2, IVUSPullbackStopFrameNumber=4)
    np.testing.assert_array_equal(read(standing), BSCANS[1:4].transpose(0, 2, 1))
    both = made(tmp_path, per_frame=[{"distance": 0.3}] * 5, **speed)
    assert stated_by(both).keys["pullback_pitch_mm"] == 0.3
    assert codes(open_stack(both)) == {"pitch-against-speed"}
    to_and_fro = made(tmp_path, per_frame=[{"distance": step} for step in (0, 0.2, -0.2, 0.2, 0.2)])
    assert "pullback_pitch_mm" not in stated_by(to_and_fro).keys
    assert codes(open_stack(to_and_fro)) == {"frames-uneven"}


def test_rates_and_counts_that_contradict_the_frames_are_doubted(tmp_path: Path) -> None:
    right = made(tmp_path, ALineRate=4800.0, CatheterRotationalRate=100.0)
    assert codes(open_stack(right)) == set()
    wrong = made(tmp_path, ALineRate=6000.0, CatheterRotationalRate=100.0, ALinesPerFrame=60)
    assert codes(open_stack(wrong)) == {"ascans-against-rate", "ascans-against-header"}


def series(folder: Path, numbers: list[Any], **each: list[Any]) -> Path:
    """Write a frame a file; names run against the numbers."""
    for k, number in enumerate(numbers):
        header = {keyword: values[k] for keyword, values in each.items()}
        one = ivoct(BSCANS[k : k + 1], InstanceNumber=number, **header)
        one.SOPInstanceUID = f"1.2.3.{k}"
        write(one, folder / f"IM{9 - k}")
    return folder


def test_files_of_a_frame_each_are_ordered_by_their_numbers(tmp_path: Path) -> None:
    found = open_stack(series(tmp_path, [3, 1, 2, 5, 4], SliceLocation=[0.6, 0.2, 0.4, 1.0, 0.8]))
    for place, k in enumerate((1, 2, 0, 4, 3)):
        np.testing.assert_array_equal(found[place], BSCANS[k].T)
    assert codes(found) == set()
    assert "the DICOM header of" in stated_by(tmp_path).by


def test_numbers_against_places_or_times_are_doubted(tmp_path: Path) -> None:
    assert codes(open_stack(series(tmp_path, [1, 2, 3, 4, 5], SliceLocation=[0, 1, 3, 2, 4]))) == {"frames-order"}
    times = [f"2024010112000{k}.5" for k in (0, 1, 4, 2, 5)]
    assert codes(open_stack(series(tmp_path, [1, 2, 3, 4, 5], AcquisitionDateTime=times))) == {"frames-order"}
    missing = open_stack(series(tmp_path, [1, 2, 3, 7, 8]))
    assert missing.along is not None
    np.testing.assert_array_equal(missing.along.values, [1, 2, 3, 7, 8])


@pytest.mark.parametrize("numbers", [[1, 2, 2, 3, 4], [1, 2, None, 3, 4]])
def test_an_order_that_nothing_says_is_refused(numbers: list[Any], tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"the order of the slices in .* is not known"):
        open_stack(series(tmp_path, numbers))


def test_several_recordings_in_a_folder_are_refused(tmp_path: Path) -> None:
    write(ivoct(BSCANS), tmp_path / "a.dcm")
    write(ivoct(BSCANS, SeriesInstanceUID="1.2.3"), tmp_path / "b.dcm")
    with pytest.raises(EndoctError, match=r"holds more than one recording; found 2 DICOM series: a.dcm, b.dcm"):
        open_stack(tmp_path)


def test_of_a_console_that_wrote_both_the_polar_one_is_read(tmp_path: Path) -> None:
    write(ivoct(BSCANS), tmp_path / "a.dcm")
    write(ivoct(BSCANS[:, :32, :32], sop_class=IVOCT_PRESENTATION, SeriesInstanceUID="1.2.3"), tmp_path / "b.dcm")
    np.testing.assert_array_equal(read(tmp_path), BSCANS.transpose(0, 2, 1))


def round_frames(side: int = 128) -> NDArray[np.uint8]:
    """Return frames whose brightness is the direction, clockwise from the top, and dark within 20 pixels."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    direction = np.mod(np.arctan2(x, -y), 2 * np.pi)
    image = np.where(np.hypot(x, y) < 20, 0, 20 + 200 * direction / (2 * np.pi))
    return np.stack([image.astype(np.uint8)] * 3)


def test_a_presentation_whose_radius_is_stated_is_made_polar(tmp_path: Path) -> None:
    header = {"sop_class": IVOCT_PRESENTATION, "EffectiveRefractiveIndex": 1.4}
    path = made(tmp_path, round_frames(), **header, RangingDepth=64 * 0.01 * 1.4)
    frame = open_stack(path)[1]
    assert frame.shape == (64, 403)
    assert frame[:18].max() < 20
    turn = (np.arange(403) / 403 * 200 + 20)[5:-5]
    assert np.abs(frame[30:60, 5:-5].mean(axis=0) - turn).max() < 2
    keys = stated_by(path).keys
    assert keys["axial_pixel_mm"] == pytest.approx(0.014)
    assert (keys["handedness"], keys["medium_index"], "intensity" in keys) == ("same", 1.4, False)
    assert "made polar" in " ".join(open_stack(path).remarks.notes)
    for radius in (None, 50 * 0.01 * 1.4):  # a part of the disc is cut away, or nothing says how large it is
        with pytest.raises(EndoctError, match="round cross-sections, whose centre its header does not say"):
            open_stack(made(tmp_path, round_frames(), **header, RangingDepth=radius))


@pytest.mark.parametrize(("sop_class", "modality"), [("3.1", "IVUS"), ("6.1", "IVUS"), ("7.4", "OCT")])
def test_ultrasound_and_captures_are_refused_by_name(sop_class: str, modality: str, tmp_path: Path) -> None:
    one = pixels(round_frames())
    one.SOPClassUID, one.SOPInstanceUID, one.Modality = f"1.2.840.10008.5.1.4.1.1.{sop_class}", "1.2.3", modality
    one.SequenceOfUltrasoundRegions = Items([item(ReferencePixelX0=64, ReferencePixelY0=64)])
    write(one, tmp_path / "a.dcm")
    with pytest.raises(EndoctError, match=f"round cross-sections.*{modality}.*for processing") as caught:
        open_stack(tmp_path / "a.dcm")
    assert caught.value.remedy


def test_the_model_of_the_sidecar_knows_every_stated_key(tmp_path: Path) -> None:
    speed = {"IVUSAcquisition": "MOTORIZED", "IVUSPullbackRate": 20.0, "CatheterRotationalRate": 100.0}
    assert stated_by(made(tmp_path, **speed)).keys.keys() <= OctAcquisition.model_fields.keys()


@pytest.mark.parametrize(
    "header",
    [
        {"ALinePixelSpacing": float("nan")},
        {"EffectiveRefractiveIndex": float("inf")},
        {"NumberOfFrames": 2_000_000},
        {"NumberOfFrames": 6},
        {"Rows": 60_000, "Columns": 60_000},
        {"Rows": 0},
        {"BitsAllocated": 12},
        {"BitsStored": 17},
        {"PhotometricInterpretation": "CMYK"},
        {"per_frame": [{"padded": 47}] * 5},
        {"per_frame": [{"seam": 48}] * 5},
        {"per_frame": [{"offset": 40}] * 5, "OCTZOffsetApplied": "NO"},
    ],
)
def test_a_header_that_cannot_be_is_one_line(header: dict[str, Any], tmp_path: Path) -> None:
    path = made(tmp_path, **header)
    with pytest.raises(EndoctError) as caught:
        open_stack(path)
    assert "\n" not in str(caught.value)


def test_whatever_is_cut_off_is_one_line(tmp_path: Path) -> None:
    whole = made(tmp_path, BSCANS[:2, :24, :16]).read_bytes()
    path = tmp_path / "cut.dcm"
    for length in range(0, len(whole), 64):
        path.write_bytes(whole[:length])
        with pytest.raises(EndoctError) as caught:
            read(path)
        assert "\n" not in str(caught.value)
