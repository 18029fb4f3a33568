"""DICOM of an endoscope: the pictures that pydicom decodes, in any colours and coding, and when each was taken."""

import io
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray
from pydicom import dcmread
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, encapsulate_extended
from pydicom.pixels.processing import apply_color_lut
from pydicom.uid import ExplicitVRBigEndian, ImplicitVRLittleEndian, RLELossless

from benchmarks.fuzz.dicom_writer import CAPTURES, ENDOSCOPE, STORAGE, VIDEO_ENDOSCOPE, pixels, write
from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import is_volume
from endoct.modalities.reading.recording import ImageStack, open_stack, stated_by
from endoct.modalities.recognition import recognise
from endoct.workbench.pipeline.information import describe

RNG = np.random.default_rng(11)
GREY = RNG.integers(0, 4096, (4, 34, 40), dtype=np.uint16)
COLOUR = RNG.integers(0, 256, (4, 34, 40, 3), dtype=np.uint8)
JPEG, JPEG_LOSSLESS, JPEG_LS, JPEG_2000, H264 = (f"1.2.840.10008.1.2.4.{k}" for k in (50, 70, 80, 90, 102))


def captured(frames: NDArray[Any], photometric: str, sop_class: str = CAPTURES, **header: Any) -> Dataset:
    made = pixels(frames, photometric)
    elements = {"SOPClassUID": sop_class, "SOPInstanceUID": "1.2.3", "Modality": "ES", "InstanceNumber": 1}
    for keyword, value in (elements | header).items():
        setattr(made, keyword, value)
    return made


def read(path: Path) -> NDArray[Any]:
    stack = open_stack(path)
    return np.stack([stack[k] for k in range(len(stack))])


@pytest.mark.parametrize("syntax", [ImplicitVRLittleEndian, ExplicitVRBigEndian, RLELossless])
@pytest.mark.parametrize("frames", [GREY, COLOUR])
def test_frames_are_what_pydicom_decodes(frames: NDArray[Any], syntax: str, tmp_path: Path) -> None:
    one = captured(frames, "MONOCHROME2" if frames.ndim == 3 else "RGB")
    path = write(one, tmp_path / "a.dcm", ImplicitVRLittleEndian)
    if syntax == ExplicitVRBigEndian:
        one.PixelData = frames.astype(frames.dtype.newbyteorder(">")).tobytes()
        write(one, path, syntax)
    elif syntax == RLELossless:
        one.compress(RLELossless, generate_instance_uid=False)
        write(one, path, syntax)
    np.testing.assert_array_equal(read(path), dcmread(path).pixel_array)
    np.testing.assert_array_equal(read(path), frames)


def test_white_as_zero_is_turned_over_and_said(tmp_path: Path) -> None:
    path = write(captured(GREY, "MONOCHROME1", BitsStored=12, HighBit=11), tmp_path / "a.dcm")
    np.testing.assert_array_equal(read(path), 4095 - GREY)
    assert "0 is white" in " ".join(open_stack(path).remarks.notes)


def test_bits_that_are_not_used_do_not_count(tmp_path: Path) -> None:
    dirty = GREY | (RNG.integers(0, 16, GREY.shape, dtype=np.uint16) << 12)
    path = write(captured(dirty, "MONOCHROME2", BitsStored=12, HighBit=11), tmp_path / "a.dcm")
    np.testing.assert_array_equal(read(path), GREY)


def test_colours_in_planes_in_ybr_and_by_a_palette_are_rgb(tmp_path: Path) -> None:
    planes = captured(COLOUR, "RGB", PlanarConfiguration=1)
    planes.PixelData = COLOUR.transpose(0, 3, 1, 2).tobytes()
    np.testing.assert_array_equal(read(write(planes, tmp_path / "a.dcm")), COLOUR)

    full = write(captured(COLOUR, "YBR_FULL"), tmp_path / "b.dcm")
    np.testing.assert_array_equal(read(full), _to_rgb(COLOUR))

    shared = COLOUR.copy()
    shared[:, :, 1::2, 1:] = shared[:, :, ::2, 1:]
    halved = captured(COLOUR, "YBR_FULL_422")
    luma, both = shared[..., 0].reshape(4, 34, 20, 2), shared[:, :, ::2, 1:]
    halved.PixelData = np.concatenate([luma, both], axis=-1).tobytes()
    path = write(halved, tmp_path / "c.dcm")
    np.testing.assert_array_equal(read(path), _to_rgb(shared))

    numbers = COLOUR[..., 0]
    listed = captured(numbers, "PALETTE COLOR")
    for k, name in enumerate(("Red", "Green", "Blue")):
        setattr(listed, f"{name}PaletteColorLookupTableDescriptor", [256, 0, 16])
        setattr(
            listed, f"{name}PaletteColorLookupTableData", (np.roll(np.arange(256), k) * 257).astype("<u2").tobytes()
        )
    path = write(listed, tmp_path / "d.dcm")
    np.testing.assert_array_equal(read(path), apply_color_lut(numbers, dcmread(path)) >> 8)


def _to_rgb(ybr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return colours after PS3.3 C.7.6.3.1.2, in full range."""
    y, b, r = np.moveaxis(ybr.astype(np.float64), -1, 0)
    rgb = np.stack([y + 1.402 * (r - 128), y - 0.344136 * (b - 128) - 0.714136 * (r - 128), y + 1.772 * (b - 128)], -1)
    return np.clip(np.floor(rgb + 0.5), 0, 255).astype(np.uint8)


def smooth() -> NDArray[np.uint8]:
    """Return pictures that a lossy codec keeps: smooth, and with colours that must not be confused."""
    y, x = np.mgrid[:34, :40]
    return np.stack([np.stack([200 - 3 * y, 60 + 2 * x, 20 + k * 30 + 0 * y], -1) for k in range(4)]).astype(np.uint8)


@pytest.mark.parametrize("table", ["one each", "basic", "extended"])
@pytest.mark.parametrize("syntax", [JPEG, JPEG_LOSSLESS, JPEG_LS, JPEG_2000])
def test_compressed_pictures_are_what_was_compressed(syntax: str, table: str, tmp_path: Path) -> None:
    frames = smooth() if syntax == JPEG else GREY
    encode = {
        JPEG: lambda a: imagecodecs.jpeg8_encode(a, level=98),
        JPEG_LOSSLESS: lambda a: imagecodecs.ljpeg_encode(a, bitspersample=16),
        JPEG_LS: imagecodecs.jpegls_encode,
        JPEG_2000: lambda a: imagecodecs.jpeg2k_encode(a, level=0, reversible=True, codecformat="j2k"),
    }[syntax]
    coded = [bytes(encode(frame)) for frame in frames]
    one = captured(frames, "YBR_FULL_422" if syntax == JPEG else "MONOCHROME2")
    if table == "extended":
        data, offsets, lengths = encapsulate_extended(coded)
        one.ExtendedOffsetTable, one.ExtendedOffsetTableLengths = offsets, lengths
        one.PixelData = data
    else:
        one.PixelData = encapsulate(
            coded, fragments_per_frame=1 if table == "one each" else 3, has_bot=table == "basic"
        )
    one["PixelData"].is_undefined_length = True
    found = read(write(one, tmp_path / "a.dcm", syntax))
    if syntax == JPEG:
        assert np.abs(found.astype(int) - frames).mean() < 2
    else:
        np.testing.assert_array_equal(found, frames)


@pytest.mark.parametrize("extended", [True, False])
@pytest.mark.parametrize(
    ("chosen", "is_read"),
    [
        ((0, 1, 2, 3), True),
        ((0, 2, 1, 3), False),
        ((0, 1, 1, 3), False),
        ((1, 2, 3, 4), False),
        ((0, 1, 2, None), False),
    ],
)
def test_a_table_of_frames_ascends_from_the_first_fragment(
    chosen: tuple[int | None, ...], is_read: bool, extended: bool, tmp_path: Path
) -> None:
    """Six fragments of four frames: only a table says which are whose. ``None`` leads between two fragments."""
    coded = [bytes(imagecodecs.jpegls_encode(frame)) for frame in GREY]
    cut = 2 * (len(coded[0]) // 4)
    pieces = [coded[0][:cut], coded[0][cut:], coded[1][:cut], coded[1][cut:], coded[2], coded[3]]
    pieces = [piece + b"\0" * (len(piece) % 2) for piece in pieces]
    starts = [sum(8 + len(piece) for piece in pieces[:k]) for k in (0, 2, 4, 5, 3)]
    offsets = [starts[3] + 2 if k is None else starts[k] for k in chosen]
    table = b"" if extended else np.array(offsets, "<u4").tobytes()
    items = [b"\xfe\xff\x00\xe0" + len(item).to_bytes(4, "little") + item for item in (table, *pieces)]
    one = captured(GREY, "MONOCHROME2")
    if extended:
        one.ExtendedOffsetTable = np.array(offsets, "<u8").tobytes()
        one.ExtendedOffsetTableLengths = bytes(8 * len(offsets))
    one.PixelData = b"".join(items)
    one["PixelData"].is_undefined_length = True
    path = write(one, tmp_path / "a.dcm", JPEG_LS)
    if is_read:
        np.testing.assert_array_equal(read(path), GREY)
        return
    with pytest.raises(EndoctError, match="a table of frames that leads nowhere"):
        read(path)


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2.4.201", "1.2.840.10008.1.2.4.92"])
def test_a_coding_that_is_not_read_is_named(syntax: str, tmp_path: Path) -> None:
    one = captured(GREY, "MONOCHROME2")
    one.PixelData = encapsulate([b"\xff\x4f" + bytes(40)] * 4)
    one["PixelData"].is_undefined_length = True
    with pytest.raises(EndoctError, match=r"samples compressed as .*JPEG.*; expected uncompressed DICOM.*gdcmconv"):
        open_stack(write(one, tmp_path / "a.dcm", syntax))


def test_times_are_those_of_frames_or_of_the_cine(tmp_path: Path) -> None:
    path = tmp_path / "a.dcm"
    write(captured(COLOUR, "RGB", FrameTime=40.0, CineRate=25), path)
    assert stated_by(path).keys == {"frame_rate_hz": 25.0}
    assert not open_stack(path).remarks.doubts
    write(captured(COLOUR, "RGB", CineRate=30), path)
    assert stated_by(path).keys == {"frame_rate_hz": 30.0}
    write(captured(COLOUR, "RGB", FrameTimeVector=[0, 40, 40, 120], CineRate=50), path)
    stack = open_stack(path)
    assert stack.along is not None
    np.testing.assert_allclose(stack.along.values, [0, 0.04, 0.08, 0.2])
    assert stated_by(path).keys == {"frame_rate_hz": 25.0}
    assert [doubt.code for doubt in stack.remarks.doubts] == ["frame-rate-against-cine"]
    write(captured(COLOUR, "RGB", FrameTimeVector=[0, 40, -40, 120]), path)
    with pytest.raises(EndoctError, match="do not rise"):
        open_stack(path)


@pytest.mark.parametrize(
    ("pointer", "rate_hz", "uneven"), [(None, 25.0, True), (0x0018_1065, 25.0, True), (0x0018_1063, 50.0, False)]
)
def test_of_two_times_the_one_that_is_pointed_at_counts(
    pointer: int | None, rate_hz: float, uneven: bool, tmp_path: Path
) -> None:
    one = captured(COLOUR, "RGB", FrameTimeVector=[0, 40, 40, 120], FrameTime=20.0)
    if pointer is not None:
        one.FrameIncrementPointer = pointer
    path = write(one, tmp_path / "a.dcm")
    stack = open_stack(path)
    assert stated_by(path).keys["frame_rate_hz"] == rate_hz
    assert (stack.along is not None) == uneven
    assert [doubt.code for doubt in stack.remarks.doubts] == ["frame-rate-against-cine"] * uneven


def test_pictures_of_a_file_each_are_one_recording_of_an_endoscope(tmp_path: Path) -> None:
    for k, number in enumerate((2, 1, 4, 3)):
        one = captured(COLOUR[k : k + 1], "RGB", ENDOSCOPE, InstanceNumber=number)
        one.SOPInstanceUID = f"1.2.3.{k}"
        write(one, tmp_path / f"{k}.dcm")
    np.testing.assert_array_equal(read(tmp_path), COLOUR[[1, 0, 3, 2]])
    assert stated_by(tmp_path).keys["modality"] == "endoscope"
    assert recognise(tmp_path).manifest.name == "endoscope"
    assert not is_volume(tmp_path)
    assert describe(tmp_path)["kind"] == "recording"


def video(container: str, frames: int = 6) -> bytes:
    buffer = io.BytesIO()
    with av.open(buffer, "w", format=container) as made:
        stream: Any = made.add_stream("mpeg4" if container == "mp4" else "mpeg2video", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(frames):
            picture = np.full((48, 64, 3), 30 + 30 * k, np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")):
                made.mux(packet)
        for packet in stream.encode():
            made.mux(packet)
    return buffer.getvalue()


def filmed(data: bytes, frames: int = 6, pieces: int = 1) -> Dataset:
    one = captured(np.zeros((1, 48, 64, 3), np.uint8), "YBR_PARTIAL_420", VIDEO_ENDOSCOPE, CineRate=25)
    one.NumberOfFrames = frames
    one.PixelData = encapsulate([data + bytes(len(data) % 2)], fragments_per_frame=pieces, has_bot=False)
    one["PixelData"].is_undefined_length = True
    return one


@pytest.mark.parametrize("pieces", [1, 4])
def test_a_video_in_dicom_is_read_where_it_lies(pieces: int, tmp_path: Path) -> None:
    data = video("mp4")
    (tmp_path / "plain.mp4").write_bytes(data)
    path = write(filmed(data, pieces=pieces), tmp_path / "a.dcm", H264)
    before = sorted(tmp_path.iterdir())
    np.testing.assert_array_equal(read(path), read(tmp_path / "plain.mp4"))
    assert sorted(tmp_path.iterdir()) == before
    stack = open_stack(path)
    np.testing.assert_array_equal(stack[4], stack[4])
    assert stack.along is not None
    np.testing.assert_allclose(np.diff(stack.along.values), 0.04)
    assert stated_by(path).keys == {"modality": "endoscope", "frame_rate_hz": 25.0}
    fewer = open_stack(write(filmed(data, frames=9), tmp_path / "b.dcm", H264))
    assert [doubt.code for doubt in fewer.remarks.doubts] == ["video-against-header"]


def test_a_video_without_an_mp4_is_refused_with_what_to_do(tmp_path: Path) -> None:
    path = write(filmed(video("mpegts")), tmp_path / "a.dcm", "1.2.840.10008.1.2.4.100")
    with pytest.raises(EndoctError, match=r"a video that is no MP4.*gdcmraw.*ffmpeg"):
        open_stack(path)


def test_other_dicom_is_refused_by_its_class(tmp_path: Path) -> None:
    one = captured(GREY, "MONOCHROME2", f"{STORAGE}.2")
    with pytest.raises(EndoctError, match="a DICOM file of CT Image Storage, which is not read"):
        open_stack(write(one, tmp_path / "a.dcm"))
    assert is_volume(tmp_path / "a.dcm")


def test_a_ct_in_a_capture_of_many_frames_is_no_recording(tmp_path: Path) -> None:
    path = write(captured(GREY, "MONOCHROME2", f"{STORAGE}.7.3", Modality="CT"), tmp_path / "a.dcm")
    assert is_volume(path)
    with pytest.raises(EndoctError, match="a DICOM file of Multi-frame Grayscale Word Secondary Capture"):
        open_stack(path)


def test_what_is_cut_off_or_lies_is_one_line(tmp_path: Path) -> None:
    coded = [bytes(imagecodecs.jpegls_encode(frame)) for frame in GREY]
    one = captured(GREY, "MONOCHROME2")
    one.PixelData = encapsulate(coded)
    one["PixelData"].is_undefined_length = True
    for name, syntax, made in (("a", JPEG_LS, one), ("b", H264, filmed(video("mp4")))):
        path = write(made, tmp_path / f"{name}.dcm", syntax)
        whole = path.read_bytes()
        for length in range(0, len(whole) - 8, 64):
            path.write_bytes(whole[:length])
            with pytest.raises(EndoctError) as caught:
                _all_of(open_stack(path))
            assert "\n" not in str(caught.value)
    large = captured(GREY, "MONOCHROME2", Rows=9000, Columns=9000)
    large.PixelData = encapsulate(coded)
    large["PixelData"].is_undefined_length = True
    with pytest.raises(EndoctError, match=r"other pictures in it than it says; found \(34, 40\)"):
        open_stack(write(large, tmp_path / "c.dcm", JPEG_LS))


def _all_of(stack: ImageStack) -> None:
    for k in range(len(stack)):
        stack[k]
