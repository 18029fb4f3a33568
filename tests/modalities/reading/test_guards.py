"""Each guard of the readers fires on a file of tifffile, FFmpeg, Pillow, pydicom, zarr or NumPy that has that wrong."""

import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import tifffile
import zarr
from PIL import Image
from pydicom.uid import ExplicitVRLittleEndian

from benchmarks.frame_faults.videos import with_edits
from benchmarks.fuzz.dicom_writer import IVOCT_PRESENTATION, VIDEO_ENDOSCOPE, ivoct, pixels, write
from endoct.base.errors import EndoctError
from endoct.modalities.reading import video_index
from endoct.modalities.reading.images import read_single
from endoct.modalities.reading.numbering import positions_along
from endoct.modalities.reading.recording import ImageStack, open_stack, stated_by
from endoct.modalities.reading.thorlabs import open_scan
from endoct.modalities.reading.video_container import opened_video
from tests.modalities.thorlabs_writer import Oct, raw_file

STACK = np.random.default_rng(3).integers(1, 255, (5, 48, 64), dtype=np.uint8)
COLOUR = np.random.default_rng(4).integers(0, 255, (48, 64, 3), dtype=np.uint8)
H264 = "1.2.840.10008.1.2.4.102"


def read(path: Path) -> list[Any]:
    stack = open_stack(path)
    return [stack[k] for k in range(len(stack))]


def refusal(path: Path, read: Callable[[Path], object] = read) -> str:
    with pytest.raises(EndoctError) as raised:
        read(path)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def codes(stack: ImageStack) -> set[str]:
    return {doubt.code for doubt in stack.remarks.doubts}


def retagged(path: Path, changes: Mapping[int, Any], images: Any = STACK[0], **options: Any) -> Path:
    """Write a TIFF, and have tifffile write other values into tags of its first page."""
    tifffile.imwrite(path, images, **({"photometric": "minisblack", "metadata": None} | options))
    with tifffile.TiffFile(path, mode="r+b") as tiff:
        for code, value in changes.items():
            tiff.pages[0].tags[code].overwrite(value)
    return path


TILED = {"tile": (16, 16), "compression": "zlib"}
OF_COLOURS = {"images": COLOUR, "photometric": "rgb"}
NUMBERED: dict[str, Any] = {"photometric": "palette", "colormap": np.zeros((3, 256), np.uint16)}
TIFFS: dict[str, tuple[dict[int, Any], dict[str, Any]]] = {
    "found colours in planes of their own": ({}, OF_COLOURS | {"planarconfig": "separate", "images": COLOUR.T.copy()}),
    "a palette for pages of 3 samples of uint8": ({262: 3}, OF_COLOURS),
    "found 300 values in a palette of 256 colours": ({320: (7,) * 300}, NUMBERED),
    "found tiles of 16 × 0": ({322: 0}, TILED),
    "found 140625 strips or tiles in a page": ({256: 6000, 257: 6000}, TILED),
    "found 12 strips or tiles with 12 sizes in a page of 8": ({257: 32}, TILED),
    "strips or tiles that are empty or overlap": ({325: (0,) * 12}, TILED),
    "is a LSM file": ({}, {"extratags": [(34412, 7, 4, b"abcd", True)]}),
    "is a MetaMorph file": ({}, {"extratags": [(33629, 7, 4, b"abcd", True)]}),
    "found a JPEG of 48 × 64; expected 32 × 32": (
        {256: 32, 257: 32, 278: 32}, {"compression": "jpeg", "rowsperstrip": 48}
    ),
    "found a JPEG of 48 × 64; expected 32 × 64": ({257: 32, 278: 32}, {"compression": "jpeg", "rowsperstrip": 48}),
    "is compressed in a way that is not read; found compression 34925": ({}, {"compression": "lzma"}),
    "found uint8 (48, 64, 1); expected uint8 (48, 64)": ({262: 2}, {"compression": "zlib"}),
    "found samples of [8] bits, format [5]": ({339: 5}, {"images": STACK[0].view(np.int8)}),
    "found colours as CIE L*a*b*": ({262: 8}, OF_COLOURS),
    "found white is 0 (WhiteIsZero) in samples of float32": ({262: 0}, {"images": STACK[0].astype(np.float32)}),
}  # fmt: skip


@pytest.mark.parametrize("said", TIFFS)
def test_a_tiff_whose_tags_cannot_be_is_refused(tmp_path: Path, said: str) -> None:
    changes, options = TIFFS[said]
    assert said in refusal(retagged(tmp_path / "a.tif", changes, **options))


def test_directories_in_a_circle_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", STACK, photometric="minisblack", metadata=None)
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        first, last = tiff.pages[0].offset, tiff.pages[4].offset
        n_tags = len(tiff.pages[4].tags)
    data = bytearray((tmp_path / "a.tif").read_bytes())
    struct.pack_into("<I", data, last + 2 + 12 * n_tags, first)
    (tmp_path / "a.tif").write_bytes(data)
    assert "found directories in a circle" in refusal(tmp_path / "a.tif")


def test_a_recording_that_changes_while_it_is_open_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK, photometric="minisblack", metadata=None)
    stack = open_stack(path)
    tifffile.imwrite(path, STACK.astype(np.uint16), photometric="minisblack", metadata=None)
    with pytest.raises(EndoctError, match="another kind of page than when it was opened"):
        stack[0]
    Image.fromarray(STACK[0]).save(path, "png")
    with pytest.raises(EndoctError, match="is no readable TIFF"):
        stack[0]
    np.save(tmp_path / "a.npy", STACK)
    stack = open_stack(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", STACK[:4])
    with pytest.raises(EndoctError, match="is truncated; found frame 4 incomplete"):
        stack[4]


def test_an_archive_of_arrays_is_no_stack(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", STACK)
    (tmp_path / "a.npz").rename(tmp_path / "a.npy")
    assert "found an archive of arrays" in refusal(tmp_path / "a.npy")


def test_images_that_cannot_be_are_refused(tmp_path: Path) -> None:
    Image.fromarray(STACK[0]).save(tmp_path / "a.png")
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[: whole.rindex(b"IEND") - 4])
    assert "found a PNG without its first or last part" in refusal(tmp_path / "a.png")
    head = b"IHDR" + struct.pack(">II", 0, 48) + whole[24:29]
    (tmp_path / "a.png").write_bytes(whole[:12] + head + zlib.crc32(head).to_bytes(4, "big") + whole[33:])
    assert "found 48 × 0 pixels" in refusal(tmp_path / "a.png")
    Image.fromarray(COLOUR).convert("CMYK").save(tmp_path / "a.jpg")
    assert "a JPEG of 4 colours" in refusal(tmp_path / "a.jpg")
    Image.fromarray(STACK[0]).save(tmp_path / "b.jpg")
    (tmp_path / "b.jpg").write_bytes((tmp_path / "b.jpg").read_bytes()[:-2])
    assert "found a JPEG without its end" in refusal(tmp_path / "b.jpg")
    tifffile.imwrite(tmp_path / "c.tif", STACK, photometric="minisblack")
    assert "is one of several images of a recording; found 5 pages" in refusal(tmp_path / "c.tif", read_single)


def saved(folder: Path, names: list[str]) -> Path:
    for k, name in enumerate(names):
        file = name if name.endswith("jpg") else f"{name}.png"
        Image.fromarray(STACK[k % 5] + np.uint8(k)).save(folder / file)
    return folder


LONG = 10**17
NAMES: dict[str, list[str]] = {
    "frames-uneven": [str(LONG + n) for n in (0, 1, 5, 7)],
    "names-of-several-forms": ["f1", "f2x", "f3"],
    "names-in-two-orders": ["f1_1", "f2_2", "f3_4", "f4_5"],
    "names-unclear": ["a1.25", "a1.3", "a1.5", "a2.0"],
    "names-without-numbers": ["one", "two", "three"],
    "names-of-several-series": ["a1-1", "a1-2", "a2-1", "a2-2"],
    "names-negative": ["-1.0mm", "-0.5mm", "0.0mm"],
    "names-negative, or hyphens": ["a-0.5mm", "a-1.0mm", "a-1.5mm"],
    "names-in-two-orders, one falling": ["9_1", "7_2", "5_3"],
    "frames-of-several-kinds": ["f1", "f2.jpg", "f3"],
}


@pytest.mark.parametrize("code", NAMES)
def test_what_names_of_images_leave_open_is_doubted(tmp_path: Path, code: str) -> None:
    assert code.partition(",")[0] in codes(open_stack(saved(tmp_path, NAMES[code])))


@pytest.mark.parametrize(
    ("names", "said"),
    [(["f1", "f1.jpg", "f2"], "two images of one place that differ"), (["f1", "f2", "g1"], "images of several series")],
)
def test_images_that_are_not_one_recording_are_refused(tmp_path: Path, names: list[str], said: str) -> None:
    assert said in refusal(saved(tmp_path, names))


@pytest.mark.parametrize(
    ("names", "pitch_mm", "code"),
    [
        (["0.0mm", "0.2mm", "0.4mm"], 0.3, "names-against-pitch"),
        (["1", "2", "3", "100", "101"], 0.2, "frames-mostly-missing"),
        (["1", "2", "5", "9", "10.5"], 0.2, "frames-uneven"),
        (["20240101-120000", "20240101-120001", "20240101-120008", "20240101-120010"], 0.2, "frames-uneven"),
    ],
)
def test_places_of_images_are_doubted_against_the_pitch(
    tmp_path: Path, names: list[str], pitch_mm: float, code: str
) -> None:
    _, remarks = positions_along(open_stack(saved(tmp_path, names)).along, pitch_mm)
    assert code in [doubt.code for doubt in remarks.doubts]


def film(path: Path, frames: Any = STACK, codec: str = "ffv1", pixels_as: str = "gray", **how: Any) -> Path:
    av.logging.set_level(av.logging.PANIC)
    with av.open(str(path), "w", format=how.get("format")) as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixels_as
        container.start_encoding()
        for k, samples in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(samples, format="gray")
            frame.pts = k
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("suffix", "codec", "kind"),
    [
        ("wmv", "wmv2", "a Windows Media video"), ("mpg", "mpeg2video", "an MPEG video"),
        ("ts", "mpeg2video", "an MPEG transport stream"), ("m2ts", "mpeg2video", "an MPEG transport stream"),
        ("flv", "flv", "a Flash video"), ("ogv", "libvpx", "an Ogg video"), ("mxf", "mpeg2video", "an MXF video"),
        ("y4m", "wrapped_avframe", "a raw video"), ("h264", "libx264", "a video without a container"),
    ],
)  # fmt: skip
def test_videos_that_are_not_read_are_refused_by_their_name(tmp_path: Path, suffix: str, codec: str, kind: str) -> None:
    if codec not in av.codecs_available:
        pytest.skip(f"FFmpeg has no {codec} here")
    path = film(tmp_path / f"a.{suffix}", codec=codec, pixels_as="yuv420p")
    for place in (path, tmp_path):
        assert f"found {kind}" in refusal(place)


@pytest.mark.parametrize(
    ("form", "kind"), [("GIF", "a GIF"), ("WEBP", "a WebP image"), ("AVIF", "AVIF"), ("PDF", "a PDF")]
)
def test_images_that_are_not_read_are_refused_by_their_name(tmp_path: Path, form: str, kind: str) -> None:
    Image.init()
    if form not in Image.SAVE:
        pytest.skip(f"Pillow writes no {form} here")
    Image.fromarray(COLOUR).save(tmp_path / "a", form)
    for place in (tmp_path / "a", tmp_path):
        assert kind in refusal(place)


def test_a_video_whose_frames_cannot_be_counted_or_decoded_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "found a video without pictures" in refusal(film(tmp_path / "a.avi", [], "mpeg4", "yuv420p"))
    path = film(tmp_path / "b.mkv")
    path.write_bytes(path.read_bytes().replace(b"V_FFV1", b"V_XXXX"))
    assert "is coded in a way that is not read" in refusal(path)
    with av.open(str(tmp_path / "d.mkv"), "w") as container, av.open(str(film(tmp_path / "e.mkv"))) as whole:
        stream = container.add_stream_from_template(whole.streams.video[0])
        for packet in whole.demux(whole.streams.video[0]):
            if packet.size:
                packet.stream, packet.pts, packet.dts = stream, packet.pts // 80 * 80, packet.pts // 80 * 80
                container.mux(packet)
    assert "found 2 of 5 with the time stamp of another" in refusal(tmp_path / "d.mkv")
    monkeypatch.setattr("endoct.modalities.reading.video_index.MOST_FRAMES", 4)
    assert "has too many frames" in refusal(film(tmp_path / "c.mkv"))


def test_pictures_that_are_damaged_or_not_there_are_refused(tmp_path: Path) -> None:
    data = bytearray(film(tmp_path / "a.avi", codec="mpeg4", pixels_as="yuv420p").read_bytes())
    at = data.index(b"00dc", data.index(b"movi")) + 8
    data[at + 200 : at + 230] = bytes(30)
    (tmp_path / "a.avi").write_bytes(data)
    assert "found it is damaged" in refusal(tmp_path / "a.avi")
    data = bytearray(film(tmp_path / "b.mkv", codec="libvpx", pixels_as="yuv420p").read_bytes())
    data[data.index(b"\x9d\x01\x2a") - 3] &= 0xEF  # the frame is not to be shown
    (tmp_path / "b.mkv").write_bytes(data)
    assert "found no picture where its index has one" in refusal(tmp_path / "b.mkv")


def test_a_video_opens_no_other_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = film(tmp_path / "a.m3u8", codec="mpeg2video", pixels_as="yuv420p")  # with a file beside it
    monkeypatch.setattr("endoct.modalities.reading.video_container.container_of", lambda _: "hls")
    with pytest.raises(PermissionError, match=r"it refers to another file, a0\.ts"), opened_video(path):
        pass


def test_edits_that_turn_the_order_round_are_doubted(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", codec="mpeg4", pixels_as="yuv420p")
    path.write_bytes(with_edits(path.read_bytes(), [(3, 2), (0, 2)]))
    (doubt,) = open_stack(path).remarks.doubts
    assert (doubt.code, "in another order than they were recorded" in doubt.what) == ("video-edited", True)
    stamps = {0: (True, 48), 1: (False, 96), 2: (False, 144)}
    whole, part = video_index._Walk(stamps), video_index._Walk(stamps | {0: (True, -1)})
    for unedited, codes in ((whole, []), (part, ["video-edited"])):  # whose first frame lies who knows where
        taken, remarks = video_index._taken(np.arange(3), whole, unedited)
        assert taken.tolist() == [0, 1, 2]
        assert [doubt.code for doubt in remarks.doubts] == codes


def test_dicom_that_holds_no_frames_of_its_kind_is_refused(tmp_path: Path) -> None:
    said = "found a video, or colours; expected grey frames"
    colours = np.stack([np.dstack([STACK[0]] * 2 + [STACK[1]])])
    polar = ivoct(STACK[:1])
    round_ones = ivoct(STACK[:1, :, :48], sop_class=IVOCT_PRESENTATION, RangingDepth=24 * 0.01)
    for made, frames, expected in (
        (polar, colours, said),
        (round_ones, colours[:, :, :48], "holds no grey cross-sections; found colours"),
    ):
        of_colours = pixels(frames, "RGB")
        for element in of_colours:
            made[element.tag] = element
        assert expected in refusal(write(made, tmp_path / "a.dcm"))
    signed = ivoct(STACK[:1, :, :48], sop_class=IVOCT_PRESENTATION, RangingDepth=24 * 0.01, PixelRepresentation=1)
    assert "holds no grey cross-sections; found int8" in refusal(write(signed, tmp_path / "a.dcm"))


def test_several_videos_of_a_series_are_refused(tmp_path: Path) -> None:
    for number in (1, 2):
        made = pixels(STACK[:1])
        made.PixelData = b"\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0\x08\0\0\0\0\0\0\x08ftyp"
        made["PixelData"].VR, made["PixelData"].is_undefined_length = "OB", True
        made.SOPClassUID, made.SOPInstanceUID, made.InstanceNumber = VIDEO_ENDOSCOPE, f"1.2.{number}", number
        write(made, tmp_path / f"{number}.dcm", H264)
    assert "is one of several videos" in refusal(tmp_path)


def test_a_table_of_samples_that_ends_early_is_refused(tmp_path: Path) -> None:
    made = ivoct(STACK, to_linear=np.arange(256, dtype=np.uint16))
    table = made.SharedFunctionalGroupsSequence[0].PixelIntensityRelationshipLUTSequence[0]
    table.LUTDescriptor = [300, 0, 16]
    assert "a table of 256 numbers for 300" in refusal(write(made, tmp_path / "a.dcm", ExplicitVRLittleEndian))


OME = (
    '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0"><Pixels ID="Pixels:0" '
    'DimensionOrder="XYZCT" Type="uint8" SizeX="64" SizeY="48" SizeC="1" SizeZ="5" SizeT="1">{}</Pixels></Image></OME>'
)


@pytest.mark.parametrize(
    "block", ['FirstZ="-1" IFD="0" PlaneCount="1"', 'IFD="-1" PlaneCount="1"', 'PlaneCount="6"', 'PlaneCount="-1"']
)
def test_planes_of_ome_that_cannot_be_are_refused(tmp_path: Path, block: str) -> None:
    text = OME.format(f"<TiffData {block}/>")
    tifffile.imwrite(tmp_path / "a.tif", STACK, photometric="minisblack", metadata=None, description=text)
    assert "is damaged; found a block of" in refusal(tmp_path / "a.tif")


def stored(path: Path, chunk: tuple[int, ...] = (1, 48, 64), **attributes: Any) -> Path:
    group = zarr.open_group(path, mode="w", zarr_format=3)
    array = group.create_array("0", shape=STACK.shape, dtype="u1", chunks=chunk)
    if chunk[1] > 1:  # of single samples there were thousands of files
        array[:] = STACK
    axes = [{"name": axis, "type": "space"} for axis in "zyx"]
    scaled = [{"type": "scale", "scale": [1.0, 1.0, 1.0]}]
    one = {"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scaled}]}
    group.attrs.update({"ome": {"version": "0.5", "multiscales": [one]} | attributes})
    return path


def test_stores_of_ome_zarr_that_cannot_be_are_refused(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(stored(tmp_path / "a.zarr")), STACK)
    one = {"axes": [{"name": axis} for axis in "zyx"], "datasets": [{"path": "0"}]}
    several = stored(tmp_path / "b.zarr", multiscales=[one, one])
    assert "holds several images; found 2 multiscales" in refusal(several)
    flat = one | {"coordinateTransformations": [{"type": "scale", "scale": [1.0, 1.0]}]}
    assert "a scale of 2 axes for 3" in refusal(stored(tmp_path / "c.zarr", multiscales=[flat]))
    assert "has too many chunks; expected 2000 a frame" in refusal(stored(tmp_path / "d.zarr", (1, 1, 1)))
    stack = open_stack(tmp_path / "a.zarr")
    shutil.rmtree(tmp_path / "a.zarr" / "0")
    with pytest.raises(EndoctError, match="none of its chunks"):
        stack[1]


def levels(**fields: Any) -> Oct:
    return Oct(size=(48, 64, 5), **fields).add("Intensity", STACK.transpose(0, 2, 1).astype(np.float32))


def test_archives_of_thorlabs_that_cannot_be_are_refused(tmp_path: Path) -> None:
    twice = levels()
    twice.members.append(("intensity", *twice.members[0][1:]))
    assert "lists a file of data twice" in refusal(twice.write(tmp_path / "a.oct", leave_out=["intensity"]))
    with zipfile.ZipFile(tmp_path / "a.oct", "w") as packed:
        packed.writestr("data/Intensity.data", bytes(64))
    assert "is no ThorImage file; found no Header.xml" in refusal(tmp_path / "a.oct")
    spectra = np.random.default_rng(1).integers(0, 4096, (2, 64, 96), dtype=np.uint16)
    raw = raw_file(spectra, np.arange(96.0)).write(tmp_path / "a.oct")
    assert "holds raw spectra, of which only the modality 'oct' makes images" in refusal(raw)
    assert "holds raw spectra and no chirp" in refusal(raw_file(spectra, None).write(tmp_path / "a.oct"), stated_by)
    raw_file(spectra[:1], np.arange(96.0), timestamp=1).write(tmp_path / "a.oct")
    raw_file(spectra[:1], np.arange(96.0) + 0.5, timestamp=2).write(tmp_path / "b.oct")
    remarks = open_scan((tmp_path / "a.oct", tmp_path / "b.oct")).remarks
    assert "stops-differ" in [doubt.code for doubt in remarks.doubts]
    assert stated_by(tmp_path).keys["modality"] == "oct"
