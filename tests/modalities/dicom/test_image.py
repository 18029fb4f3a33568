"""Frames of DICOM as pydicom and imagecodecs write them: what the samples are, or in one line why they are not read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray
from pydicom import dcmread
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.fileset import FileSet
from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    ExplicitVRLittleEndian,
    ImplicitVRLittleEndian,
    RLELossless,
)

from benchmarks.fuzz.dicom_writer import CAPTURES, pixels, write
from endoct.base.errors import EndoctError
from endoct.modalities.dicom.decoding import stream_of
from endoct.modalities.dicom.dicom_file import DIRECTORY, is_dicom, kind_of
from endoct.modalities.dicom.image import open_image
from endoct.modalities.dicom.samples import as_seen

JPEG, LOSSLESS, LS, J2K = (f"1.2.840.10008.1.2.4.{k}" for k in (50, 70, 80, 90))
WORDS = np.array([[[0, 1, 2000], [2048, 4095, 3]]], np.uint16)
COLOUR = np.dstack([np.full((16, 24), value, np.uint8) for value in (200, 90, 30)])
DOUBT = "dicom-header-against-pictures"


def made(frames: NDArray[Any] = WORDS, photometric: str = "MONOCHROME2", **elements: Any) -> Dataset:
    dataset = pixels(frames, photometric)
    usual = {"SOPClassUID": CAPTURES, "SOPInstanceUID": "1.2.3", "Modality": "ES", "InstanceNumber": 1}
    for keyword, value in (usual | elements).items():
        setattr(dataset, keyword, value)
    return dataset


def coded(pictures: list[bytes], frames: NDArray[Any], photometric: str = "MONOCHROME2", **elements: Any) -> Dataset:
    dataset = made(frames, photometric, **elements)
    dataset.PixelData = encapsulate(pictures, has_bot=False)
    dataset["PixelData"].is_undefined_length = True
    return dataset


def j2k(words: NDArray[Any], **how: Any) -> bytes:
    return bytes(imagecodecs.jpeg2k_encode(words, level=0, reversible=True, **{"codecformat": "j2k"} | how))


def with_components(stream: bytes, count: int) -> bytes:
    """Return a JPEG 2000 whose header claims ``count`` numbers a pixel, for which a decoder would take memory."""
    return stream[:40] + count.to_bytes(2, "big") + stream[42:]


def lossless(words: NDArray[Any], bits: int) -> bytes:
    return bytes(imagecodecs.jpeg_encode(words, lossless=True, predictor=1, bitspersample=bits))


def large(value: int) -> NDArray[np.uint16]:
    return np.full((16, 16), value, np.uint16)


def read(path: Path, syntax: str, dataset: Dataset) -> tuple[list[Any], list[str]]:
    """Return the numbers of the first frame, and the codes of what is doubted."""
    image = open_image(write(dataset, path / "a.dcm", syntax))
    assert image.read is not None
    return image.read(0).tolist(), [doubt.code for doubt in image.doubts]


def test_numbers_lie_in_the_bits_that_the_header_says(tmp_path: Path) -> None:
    def numbers(words: list[int], **elements: Any) -> list[int]:
        frame = np.array([[words]], np.uint16)
        return list(read(tmp_path, ImplicitVRLittleEndian, made(frame, **elements))[0][0])

    assert numbers([0x7D0F, 0xFFFF], BitsStored=16, HighBit=15) == [0x7D0F, 0xFFFF]
    assert numbers([0x7D00, 0xFFF0], BitsStored=12, HighBit=15) == [2000, 4095]
    assert numbers([0x8300, 0x0010], BitsStored=12, HighBit=15, PixelRepresentation=1) == [-2000, 1]
    assert numbers([0x0830, 0xF830, 0x47D0], BitsStored=12, HighBit=11, PixelRepresentation=1) == [-2000, -2000, 2000]


def test_rle_holds_words_and_its_numbers_lie_in_the_same_bits(tmp_path: Path) -> None:
    dataset = _rle(WORDS << 4, BitsStored=12, HighBit=15)
    assert read(tmp_path, RLELossless, dataset) == (WORDS[0].tolist(), [])


@pytest.mark.parametrize(
    ("stream_signed", "says_signed", "bits", "stored"),
    [
        (True, 0, 16, 16),
        (True, 0, 13, 13),
        (False, 1, 13, 13),
        (False, 1, 16, 16),
        (False, 1, 13, 16),
        (True, 1, 16, 16),
    ],
)
def test_a_sign_that_jpeg_2000_or_the_header_knows_is_there(
    tmp_path: Path, stream_signed: bool, says_signed: int, bits: int, stored: int
) -> None:
    numbers = np.array([[-2000, 5], [0, 4000]], np.int16)
    words = numbers if stream_signed else numbers.view(np.uint16) & np.uint16((1 << bits) - 1)
    header = {"PixelRepresentation": says_signed, "BitsStored": stored, "HighBit": stored - 1}
    dataset = coded([j2k(words, bitspersample=bits)], words[None], **header)
    assert read(tmp_path, J2K, dataset) == (numbers.tolist(), [DOUBT] if stream_signed != bool(says_signed) else [])


def test_signed_numbers_of_fewer_bits_than_the_header_has_are_doubted(tmp_path: Path) -> None:
    words = large(0x830)
    for stored, codes in ((12, []), (16, [DOUBT])):
        header = {"PixelRepresentation": 1, "BitsStored": stored, "HighBit": stored - 1}
        assert read(tmp_path, LOSSLESS, coded([lossless(words, 12)], words[None], **header)) == (
            np.full((16, 16), -2000).tolist(),
            codes,
        )
    wide = large(0xF830)
    dataset = coded([lossless(wide, 16)], wide[None], PixelRepresentation=1, BitsStored=12, HighBit=11)
    assert read(tmp_path, LOSSLESS, dataset)[0][0][0] == -2000


@pytest.mark.parametrize(("kind", "rows"), [("OW", 3), ("OB", 3), ("OW", 4)])
def test_bytes_in_words_of_big_endian_are_put_back(tmp_path: Path, kind: str, rows: int) -> None:
    frames = np.arange(2 * rows * 3, dtype=np.uint8).reshape(2, rows, 3)
    dataset = made(frames)
    if kind == "OW":
        dataset.PixelData = np.frombuffer(dataset.PixelData, "u2").byteswap().tobytes()
    dataset["PixelData"].VR = kind
    path = write(dataset, tmp_path / "a.dcm", ExplicitVRBigEndian)
    image = open_image(path)
    assert image.read is not None
    assert np.array_equal([image.read(k) for k in range(2)], frames)
    assert np.array_equal(dcmread(path).pixel_array, frames)


@pytest.mark.parametrize(
    ("written", "subsampling", "strip", "says", "doubted"),
    [
        ("YCBCR", None, False, "RGB", True),  # JFIF
        ("RGB", None, False, "YBR_FULL_422", True),  # Adobe's segment says that it is RGB
        ("YCBCR", "420", True, "RGB", True),  # nothing but fewer samples of the colours
        ("YCBCR", None, True, "YBR_FULL_422", False),
        ("RGB", None, True, "RGB", False),
    ],
)
def test_colours_of_a_jpeg_are_those_that_it_says(
    tmp_path: Path, written: str, subsampling: str | None, strip: bool, says: str, doubted: bool
) -> None:
    data = bytes(
        imagecodecs.jpeg8_encode(COLOUR, level=98, colorspace="RGB", outcolorspace=written, subsampling=subsampling)
    )
    if strip:
        data = data[:2] + data[4 + int.from_bytes(data[4:6], "big") :]
    dataset = coded([data], COLOUR[None], says)
    found, codes = read(tmp_path, JPEG, dataset)
    assert np.abs(np.array(found) - COLOUR).max() < 4
    assert codes == [DOUBT] * doubted


@pytest.mark.parametrize(
    ("mct", "says", "codes"), [(True, "YBR_FULL", [DOUBT]), (False, "YBR_RCT", [DOUBT]), (True, "RGB", [])]
)
def test_colours_of_jpeg_2000_are_those_that_it_turns_back(
    tmp_path: Path, mct: bool, says: str, codes: list[str]
) -> None:
    dataset = coded([j2k(COLOUR, mct=mct)], COLOUR[None], says)
    image = open_image(write(dataset, tmp_path / "a.dcm", J2K))
    assert image.read is not None
    assert np.array_equal(as_seen(image.read(0), image.read), COLOUR)
    assert [doubt.code for doubt in image.doubts] == codes


def test_jpeg_2000_in_boxes_is_read(tmp_path: Path) -> None:
    assert read(tmp_path, J2K, coded([j2k(WORDS[0], codecformat="jp2")], WORDS)) == (WORDS[0].tolist(), [])


def test_a_stream_is_decoded_by_what_it_is_whatever_the_syntax(tmp_path: Path) -> None:
    assert read(tmp_path, LS, coded([j2k(WORDS[0])], WORDS)) == (WORDS[0].tolist(), [])


def test_frames_of_single_bits_may_begin_within_a_byte(tmp_path: Path) -> None:
    frames = np.random.default_rng(2).integers(0, 2, (3, 5, 7), dtype=np.uint8)
    dataset = made(frames, BitsAllocated=1, BitsStored=1, HighBit=0)
    dataset.PixelData = np.packbits(frames.ravel(), bitorder="little").tobytes()
    image = open_image(write(dataset, tmp_path / "a.dcm"))
    assert image.read is not None
    assert np.array_equal([image.read(k) for k in range(3)], frames)


def test_a_directory_is_known_by_its_meta_header(tmp_path: Path) -> None:
    files = FileSet()
    dataset = made(
        PatientID="0", PatientName="a", StudyInstanceUID="1.2.4", SeriesInstanceUID="1.2.5", StudyDate="20200101"
    )
    dataset.StudyTime, dataset.StudyID, dataset.SeriesNumber = "000000", "1", 1
    write(dataset, tmp_path / "a.dcm")
    files.add(tmp_path / "a.dcm")
    files.write(tmp_path / "set")
    files._stage["t"].cleanup()  # which it leaves to whoever collects it
    assert kind_of(tmp_path / "set" / "DICOMDIR").sop_class == DIRECTORY


@pytest.mark.parametrize("implicit", [True, False])
def test_bare_data_sets_are_known_by_their_first_element(tmp_path: Path, implicit: bool) -> None:
    path = tmp_path / "a"
    for keyword, value in (("ImageType", "ORIGINAL"), ("InstanceCreationDate", "20200101"), ("SOPClassUID", "1.2")):
        dataset = Dataset()
        setattr(dataset, keyword, value)
        dataset.save_as(path, implicit_vr=implicit, little_endian=True)
        assert is_dicom(path)
    dataset.save_as(path, implicit_vr=False, little_endian=False)
    assert is_dicom(path)
    path.write_bytes(b"\x08\x00 no data set at all")
    assert not is_dicom(path)


def _without(keyword: str) -> Dataset:
    dataset = made()
    del dataset[keyword]
    return dataset


def _fragments(*pieces: bytes, frames: NDArray[Any] = WORDS, bot: bytes = b"") -> Dataset:
    dataset = coded([b"xx"], frames)
    items = b"".join(b"\xfe\xff\x00\xe0" + len(piece).to_bytes(4, "little") + piece for piece in (bot, *pieces))
    dataset.PixelData = items
    dataset["PixelData"].is_undefined_length = True
    return dataset


TWO = np.concatenate([WORDS, WORDS])
LS_WORDS = bytes(imagecodecs.jpegls_encode(WORDS[0]))
GUARDS: dict[str, tuple[str, Callable[[], Dataset]]] = {
    "found -1 by its header": (ImplicitVRLittleEndian, lambda: made(NumberOfFrames=-1)),
    "holds no samples": (ImplicitVRLittleEndian, lambda: _without("PixelData")),
    "deflated as a whole": (DeflatedExplicitVRLittleEndian, made),
    "12 bits, 'MONOCHROME2'": (ImplicitVRLittleEndian, lambda: made(BitsAllocated=12)),
    "17 bits stored, up to 16, of 16": (ImplicitVRLittleEndian, lambda: made(BitsStored=17, HighBit=16)),
    "frames of 0 × 3": (ImplicitVRLittleEndian, lambda: made(Rows=0)),
    "found 12 bytes; expected 18": (ImplicitVRLittleEndian, lambda: made(Rows=3)),
    "found 12 bytes; expected 8": (ImplicitVRLittleEndian, lambda: made(Columns=2)),
    "found 12 bytes; expected 6": (ImplicitVRLittleEndian, lambda: made(Rows=1)),
    "bits in use below the lowest": (ImplicitVRLittleEndian, lambda: made(BitsStored=12, HighBit=15)),
    "YBR of more than 8 bits": (ImplicitVRLittleEndian, lambda: made(COLOUR[None].astype(np.uint16), "YBR_FULL")),
    "compressed as High-Throughput JPEG 2000": ("1.2.840.10008.1.2.4.201", lambda: coded([b"xx"], WORDS)),
    "1 fragments; expected 2 frames": (LS, lambda: coded([LS_WORDS], TWO)),
    "which nothing assigns to frames": (LS, lambda: _fragments(b"aa", b"bb", b"cc", frames=TWO)),
    "a table of frames that leads nowhere": (
        LS,
        lambda: _fragments(b"aa", b"bb", b"cc", frames=TWO, bot=b"\0\0\0\0\3\0\0\0"),
    ),
    "found (3, 3); expected (2, 3)": (LS, lambda: coded([j2k(np.eye(3, dtype=np.uint16))], WORDS)),
    "found (0, 0); expected (2, 3)": (LS, lambda: coded([b"no stream"], WORDS)),
    "found (16, 24, 3); expected (16, 24)": (J2K, lambda: coded([j2k(COLOUR)], COLOUR[None, ..., 0])),
    "found (2, 3, 16384); expected (2, 3)": (J2K, lambda: coded([with_components(j2k(WORDS[0]), 16384)], WORDS)),
    "colours with signs": (J2K, lambda: coded([j2k(COLOUR.view(np.int8))], COLOUR[None], "RGB")),
    "found up to 4095; expected numbers of 11 bits": (LS, lambda: coded([LS_WORDS], WORDS, BitsStored=11, HighBit=10)),
    "more than 50 scans": (JPEG, lambda: coded([_scans()], COLOUR[None], "YBR_FULL_422")),
    "1 planes of bytes where the header has 2": (RLELossless, lambda: _rle(WORDS.astype(np.uint8), BitsAllocated=16)),
    "6 bytes where the header has 12": (RLELossless, lambda: _rle(WORDS[:, :1], Rows=2)),
}  # fmt: skip


def _scans() -> bytes:
    return bytes(imagecodecs.jpeg8_encode(COLOUR, level=98)) + b"\xff\xda" * 50


def _rle(frames: NDArray[Any], **elements: Any) -> Dataset:
    dataset = made(frames)
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset.compress(RLELossless, generate_instance_uid=False)
    for keyword, value in elements.items():
        setattr(dataset, keyword, value)
    return dataset


def _check_colours(path: Path) -> None:
    image = open_image(path)
    assert image.read is not None
    as_seen(image.read(0), image.read)


@pytest.mark.parametrize("said", GUARDS)
def test_what_contradicts_itself_is_refused_in_one_line(tmp_path: Path, said: str) -> None:
    syntax, build = GUARDS[said]
    path = write(build(), tmp_path / "a.dcm", syntax)
    with pytest.raises(EndoctError) as raised:
        _check_colours(path)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_frames_coded_in_two_ways_are_refused(tmp_path: Path) -> None:
    image = open_image(write(coded([LS_WORDS, j2k(WORDS[0])], TWO), tmp_path / "a.dcm", LS))
    assert image.read is not None
    assert image.read(0).tolist() == WORDS[0].tolist()
    with pytest.raises(EndoctError, match=r"frame 1 .* coded in another way than the first"):
        image.read(1)


def test_two_pictures_are_not_one_frame_in_two_fragments(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="2 fragments, which nothing assigns"):
        open_image(write(coded([LS_WORDS, LS_WORDS], WORDS), tmp_path / "a.dcm", LS))


def test_no_header_and_samples_that_end_early_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.dcm"
    path.write_bytes(bytes(128) + b"DICM")
    with pytest.raises(EndoctError, match="no header of DICOM, or a damaged one"):
        open_image(path)
    path = write(made(), path)
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(EndoctError, match=r"a\.dcm is cut off"):
        open_image(path)
    path = write(coded([LS_WORDS], WORDS), path, LS)
    image = open_image(path)
    assert image.read is not None
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(EndoctError, match="is cut off or damaged; found 1 whole fragments"):
        open_image(path)
    with pytest.raises(EndoctError, match=r"frame 0 .* a file that is cut off"):
        image.read(0)
    data = write(made(), path).read_bytes()
    path.write_bytes(data.replace(b"OW\0\0\x0c\0\0\0", b"OW\0\0\xff\xff\xff\xff"))
    with pytest.raises(EndoctError, match="samples of a length that is not known"):
        open_image(path)


def test_a_stream_says_whether_it_lost_something() -> None:
    words = np.arange(256, dtype=np.uint16).reshape(16, 16)
    whole, near = imagecodecs.jpegls_encode(words), imagecodecs.jpegls_encode(words, level=3)
    loose = imagecodecs.jpeg2k_encode(words, level=40, reversible=False, codecformat="j2k")
    streams = [stream_of(bytes(data)) for data in (whole, near, j2k(words), loose, lossless(words, 16))]
    assert [stream is not None and stream.lossy for stream in streams] == [False, True, False, True, False]


def test_words_that_were_compressed_whole_are_shifted(tmp_path: Path) -> None:
    dataset = coded([bytes(imagecodecs.jpegls_encode(WORDS[0] << 4))], WORDS, BitsStored=12, HighBit=15)
    assert read(tmp_path, LS, dataset) == (WORDS[0].tolist(), [])


def test_numbers_that_were_compressed_alone_are_not_shifted(tmp_path: Path) -> None:
    dataset = coded([j2k(WORDS[0], bitspersample=12)], WORDS, BitsStored=12, HighBit=12)
    assert read(tmp_path, J2K, dataset) == (WORDS[0].tolist(), [])


def test_signed_numbers_of_which_the_least_is_white_are_turned_over(tmp_path: Path) -> None:
    numbers = np.array([[[-2048, -1, 0, 2047]]], np.int16)
    dataset = made(numbers.view(np.uint16), "MONOCHROME1", PixelRepresentation=1, BitsStored=12, HighBit=11)
    image = open_image(write(dataset, tmp_path / "a.dcm"))
    assert image.read is not None
    assert as_seen(image.read(0), image.read).tolist() == [[2047, 0, -1, -2048]]


def test_a_table_with_one_place_twice_leads_nowhere(tmp_path: Path) -> None:
    dataset = _fragments(b"aa", b"bb", b"cc", frames=TWO, bot=bytes(8))
    with pytest.raises(EndoctError, match="leads nowhere"):
        open_image(write(dataset, tmp_path / "a.dcm", LS))
