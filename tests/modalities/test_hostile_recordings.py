"""Damaged and hostile recordings end in one line: no waiting, no memory, no connection, no other file."""

import contextlib
import os
import random
import resource
import socket
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import tifffile

from endoct.base.errors import EndoctError
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.pullback_stream import Pullback
from endoct.modalities.reading import tiff_directory
from endoct.modalities.reading.frame_names import read_names
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.reading.tiff import is_tiff
from endoct.modalities.reading.video import ReadVideo
from endoct.modalities.reading.video_container import container_of
from endoct.modalities.recognition import recognise
from endoct.stitching.grid import SurfaceGrid
from tests.modalities.numbered import positions_by_number

STACK = np.random.default_rng(5).integers(0, 256, (5, 24, 32), dtype=np.uint8)
MOST_BYTES = 50_000_000


def refused(path: Path) -> str:
    """Open and read all; return what was said. Little memory may be taken for that."""
    tracemalloc.start()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        with pytest.raises(EndoctError) as caught:
            read_all(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < 4 * MOST_BYTES
    assert "\n" not in str(caught.value)
    return str(caught.value)


def read_all(path: Path) -> list[np.ndarray]:
    stack = open_stack(path)
    return [stack[index] for index in range(len(stack))]


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(columns: int, rows: int, *more: bytes) -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0))
    return (
        b"\x89PNG\r\n\x1a\n" + head + b"".join(more) + chunk(b"IDAT", zlib.compress(bytes(6000))) + chunk(b"IEND", b"")
    )


def jpeg(columns: int, rows: int) -> bytes:
    data = cv2.imencode(".jpg", STACK[0])[1].tobytes()
    at = data.index(b"\xff\xc0") + 5
    return data[:at] + struct.pack(">HH", rows, columns) + data[at + 4 :]


def bmp(columns: int, rows: int) -> bytes:
    data = bytearray(cv2.imencode(".bmp", STACK[0])[1].tobytes())
    data[18:26] = struct.pack("<ii", columns, rows)
    return bytes(data)


def directory(*tags: tuple[int, int, int, int], following: int = 0) -> bytes:
    return (
        struct.pack("<H", len(tags))
        + b"".join(struct.pack("<HHII", *tag) for tag in tags)
        + struct.pack("<I", following)
    )


def page(columns: int, rows: int, compression: int, data: bytes, **more: int) -> bytes:
    """A TIFF of one page whose single strip is ``data``."""
    tags = {256: columns, 257: rows, 258: 8, 259: compression, 262: 1, 273: 8, 277: 1, 278: rows, 279: len(data)}
    tags |= {int(key[1:]): value for key, value in more.items()}
    return (
        b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory(*((t, 4, 1, v) for t, v in sorted(tags.items())))
    )


@pytest.mark.parametrize("name", ["frame_0001.png", "pullback.tif", "pullback.npy", "frames.mkv", "frames.mp4"])
def test_a_pipe_is_refused_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    for path in (tmp_path, tmp_path / name):
        assert "a pipe" in refused(path)
        with pytest.raises(EndoctError):
            recognise(path)
    assert not is_tiff(tmp_path / name)
    assert not container_of(tmp_path / name)


def test_a_device_is_refused(tmp_path: Path) -> None:
    (tmp_path / "frame_1.png").symlink_to("/dev/zero")
    assert "a device" in refused(tmp_path)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("x.png", png(65535, 65535)),
        ("x.png", png(2**31 - 1, 1)),
        ("x.jpg", jpeg(65500, 65500)),
        ("x.bmp", bmp(60000, 60000)),
        ("x.bmp", bmp(60000, -60000)),
        ("x.tif", page(60000, 60000, 1, bytes(100))),
        ("x.tif", page(60000, 60000, 8, zlib.compress(bytes(100)))),
        ("x.tif", page(64, 64, 8, zlib.compress(bytes(100)), t322=60000, t323=60000, t324=8, t325=50)),
    ],
    ids=["png", "wide png", "jpeg", "bmp", "bmp upside down", "tiff", "compressed tiff", "tile"],
)
def test_the_size_is_checked_before_memory_is_taken(name: str, data: bytes, tmp_path: Path) -> None:
    assert "too much memory" in refused(written(tmp_path / name, data))


def test_a_large_text_in_a_png_is_not_unpacked(tmp_path: Path) -> None:
    text = chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(7_000_000)))
    rows = b"".join(b"\0" + bytes(96) for _ in range(20))
    data = png(32, 20, *[text] * 100).replace(zlib.compress(bytes(6000)), b"")
    data = data[: data.rindex(b"IDAT") - 4] + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert open_stack(written(tmp_path / "x.png", data))[0].shape == (20, 32, 3)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < 100_000_000


@pytest.mark.parametrize("suffix", [".webp", ".jp2", ".hdr", ".exr", ".gif", ".pgm", ".ras"])
def test_what_a_decoder_would_take_for_something_else_is_refused(suffix: str, tmp_path: Path) -> None:
    colour = np.repeat(STACK[0][..., None], 3, axis=2)
    try:
        done, data = cv2.imencode(suffix, colour.astype(np.float32) if suffix in (".hdr", ".exr") else colour)
    except cv2.error:
        done = False
    if not done:
        pytest.skip(f"OpenCV writes no {suffix} here")
    assert "is no readable image" in refused(written(tmp_path / "frame_1.png", data.tobytes()))


def test_a_damaged_png_is_refused_in_silence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    data = cv2.imencode(".png", STACK[0])[1].tobytes()
    for at in range(20, len(data) - 20, 7):
        refused(written(tmp_path / "x.png", data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]))
    wrong = png(32, 24).replace(zlib.compress(bytes(6000)), zlib.compress(bytes(6000))[:-4] + b"abcd")
    body = wrong[: wrong.index(b"IDAT") - 4] + chunk(b"IDAT", b"no deflate at all") + chunk(b"IEND", b"")
    refused(written(tmp_path / "x.png", body))
    refused(written(tmp_path / "x.jpg", cv2.imencode(".jpg", STACK[0])[1].tobytes()[:-200]))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "data",
    [
        b"II*\0" + struct.pack("<I", 8) + directory((256, 4, 1, 1), following=8),
        b"II*\0" + struct.pack("<I", 8),
        b"II+\0" + struct.pack("<HHQ", 8, 0, 2**63),
        b"II+\0" + struct.pack("<HHQ", 8, 0, 16) + struct.pack("<Q", 2**40),
        b"II*\0" + struct.pack("<I", 8) + directory((256, 4, 2**31, 0)),
        page(32, 24, 1, bytes(32 * 24), t273=2**32 - 1),
        page(32, 24, 1, bytes(32 * 24), t278=0).replace(struct.pack("<HHI", 279, 4, 1), struct.pack("<HHI", 279, 2, 1)),
        page(32, 24, 34712, bytes(900)),
        page(32, 24, 50001, bytes(900)),
        page(32, 24, 8, zlib.compress(bytes(50_000_000))),
        page(32, 24, 7, jpeg(60000, 60000)),
        page(32, 24, 7, jpeg(3200, 24)),
        page(0, 24, 1, bytes(900)),
        page(32, 24, 1, bytes(900), t258=24),
        page(32, 24, 1, bytes(900), t32997=1000),
        page(32, 24, 1, bytes(900), t33629=3),
    ],
)
def test_directories_that_cannot_be_are_refused(data: bytes, tmp_path: Path) -> None:
    refused(written(tmp_path / "x.tif", data))


def test_a_tiff_of_endless_pages_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiff_directory, "MOST_PAGES", 4000)
    one = directory(*((tag, 4, 1, value) for tag, value in ((256, 8), (257, 8), (258, 8), (273, 8), (279, 64))))
    data = bytearray(b"II*\0" + struct.pack("<I", 8))
    for _ in range(4_100):
        data += one[:-4] + struct.pack("<I", len(data) + len(one))
    tracemalloc.start()
    with pytest.raises(EndoctError, match="more than 4000 pages"):
        open_stack(written(tmp_path / "x.tif", bytes(data)))
    assert tracemalloc.get_traced_memory()[1] < MOST_BYTES / 16
    tracemalloc.stop()


def test_ome_xml_is_not_believed(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "x.ome.tif", STACK, photometric="minisblack", ome=True)
    data = (tmp_path / "x.ome.tif").read_bytes()
    huge = (
        data.replace(b'SizeC="5"', b'SizeC="9"').replace(b'SizeT="5"', b'SizeT="9"').replace(b'SizeZ="5"', b'SizeZ="9"')
    )
    assert huge != data
    assert "found 5 pages; expected 9 frames" in refused(written(tmp_path / "y.tif", huge))
    several = (
        data.replace(b'SizeC="1"', b'SizeC="7"').replace(b'SizeT="1"', b'SizeT="7"').replace(b'SizeZ="1"', b'SizeZ="7"')
    )
    assert "has the wrong dimensions" in refused(written(tmp_path / "z.tif", several))


def test_a_stack_of_several_axes_is_refused(tmp_path: Path) -> None:
    volume = np.zeros((2, 3, 24, 32), np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", volume, photometric="minisblack")
    tifffile.imwrite(tmp_path / "b.tif", volume, imagej=True, metadata={"axes": "TCYX"})
    for name in ("a.tif", "b.tif"):
        assert "has the wrong dimensions" in refused(tmp_path / name)


@pytest.mark.parametrize("images", ["images=999999999", "images=9", "slices=9"])
def test_imagej_cannot_tell_of_more_than_the_file_holds(images: str, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "x.tif", STACK, imagej=True, truncate=True)
    np.testing.assert_array_equal(read_all(tmp_path / "x.tif"), STACK)
    data = (tmp_path / "x.tif").read_bytes()
    start = data.index(b"ImageJ=")
    end = data.index(b"\0", start)
    told = f"ImageJ=1.5\n{images}\n".encode()
    refused(written(tmp_path / "x.tif", data[:start] + told.ljust(end - start, b"\n") + data[end:]))


@pytest.mark.parametrize("compression", ["zlib", "lzw", "zstd", "packbits", "jpeg"])
@pytest.mark.parametrize("tile", [None, (16, 16)])
def test_compressed_pages_are_those_of_the_library(
    compression: str, tile: tuple[int, int] | None, tmp_path: Path
) -> None:
    colour = np.random.default_rng(6).integers(0, 256, (3, 40, 56, 3), dtype=np.uint8)
    tifffile.imwrite(tmp_path / "x.tif", colour, photometric="rgb", compression=compression, tile=tile)
    np.testing.assert_array_equal(read_all(tmp_path / "x.tif"), tifffile.imread(tmp_path / "x.tif"))


def header(text: str, version: bytes = b"\x01\x00") -> bytes:
    size = struct.pack("<H" if version[0] == 1 else "<I", len(text))
    return b"\x93NUMPY" + version + size + text.encode("latin-1") + bytes(800)


@pytest.mark.parametrize(
    "text",
    [
        "{'descr': '|u1', 'fortran_order': False, 'shape': (9999999999, 99999, 99999), }",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (4611686018427387904, 4, 4), }",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (-1, 24, 32), }",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (True, 24, 32), }",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 0, 32), }",
        "{'descr': '|u1', 'fortran_order': True, 'shape': (1, 24, 32), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1, 24, 32), }",
        "{'descr': [('a', '|u1')], 'fortran_order': False, 'shape': (1, 24, 32), }",
        "{'descr': '|V9999999999', 'fortran_order': False, 'shape': (1, 24, 32), }",
        "{'descr': '<M8[ns]', 'fortran_order': False, 'shape': (1, 2, 3), }",
        "{'descr': '|u1', 'fortran_order': False}",
        "(" * 5000,
        "{'descr': '|u1', 'fortran_order': False, 'shape': (" + "9" * 5000 + ",), }",
        "x" * 60000,
    ],
)
@pytest.mark.parametrize("version", [b"\x01\x00", b"\x02\x00", b"\x09\x00"])
def test_headers_of_arrays_that_cannot_be_are_refused(text: str, version: bytes, tmp_path: Path) -> None:
    refused(written(tmp_path / "x.npy", header(text, version)))


def video(path: Path, side: int = 64) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = side, side, "yuvj420p"
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((side, side), np.uint8), format="gray")))
        container.mux(stream.encode(None))
    return path


def test_a_video_of_enormous_frames_is_refused(tmp_path: Path) -> None:
    data = video(tmp_path / "x.avi").read_bytes()
    begin = b"\xff\xc0\x00\x11\x08"
    patched = data.replace(begin + struct.pack(">HH", 64, 64), begin + struct.pack(">HH", 60000, 60000))
    assert patched != data
    refused(written(tmp_path / "y.avi", patched))
    patched = patched.replace(struct.pack("<ii", 64, 64), struct.pack("<ii", 60000, 60000))
    refused(written(tmp_path / "z.avi", patched))
    # no codec corrects the size of raw frames
    patched = data.replace(b"MJPG", b"Y800").replace(struct.pack("<ii", 64, 64), struct.pack("<ii", 60000, 60000))
    refused(written(tmp_path / "raw.avi", patched))


def test_a_name_is_no_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.2)
        path = Path(f"http:/127.0.0.1:{server.getsockname()[1]}/x.avi")  # a Path has single slashes; FFmpeg takes them
        path.parent.mkdir(parents=True)
        path.write_bytes(video(tmp_path / "x.avi").read_bytes())
        assert ReadVideo(path).n_frames == 3
        with pytest.raises(TimeoutError):
            server.accept()


@pytest.mark.parametrize(
    "start", [b"#EXTM3U\n#EXT-X-VERSION:3\n", b"ffconcat version 1.0\n", b"v=0\r\no=- 0 0 IN IP4 "]
)
def test_a_list_of_other_files_is_no_video(start: bytes, tmp_path: Path) -> None:
    video(tmp_path / "other.avi")
    for name, before in {"x.mkv": b"", "y.mkv": b"\x1a\x45\xdf\xa3", "z.mp4": b"\0\0\0\x08free"}.items():
        assert "no readable video" in refused(
            written(tmp_path / name, before + start + b"file 'other.avi'\nother.avi\n")
        )


@pytest.mark.parametrize("kind", ["tiff", "png", "jpeg", "bmp", "npy", "avi"])
def test_random_damage_says_one_line_or_nothing(kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    makers: dict[str, Callable[[], Path]] = {
        "tiff": lambda: (tifffile.imwrite(tmp_path / "a.tif", STACK, compression="zlib"), tmp_path / "a.tif")[1],
        "npy": lambda: (np.save(tmp_path / "a.npy", STACK), tmp_path / "a.npy")[1],
        "avi": lambda: video(tmp_path / "a.avi"),
        **{
            name: lambda suffix=suffix: (cv2.imwrite(str(tmp_path / f"a{suffix}"), STACK[0]), tmp_path / f"a{suffix}")[
                1
            ]
            for name, suffix in {"png": ".png", "jpeg": ".jpg", "bmp": ".bmp"}.items()
        },
    }
    path = makers[kind]()
    whole = path.read_bytes()
    rng = random.Random(7)
    for _ in range(150):
        data = bytearray(whole)
        for _ in range(rng.choice((1, 2, 5))):
            at = rng.randrange(min(len(data), rng.choice((64, 600, len(data)))))
            size = rng.choice((1, 2, 4, 8))
            data[at : at + size] = rng.choice((0, 1, 2**63, 2**32 - 1, rng.randrange(2**64))).to_bytes(8, "little")[
                :size
            ]
        path.write_bytes(data)
        with contextlib.suppress(EndoctError):  # and nothing else
            read_all(path)
    assert capfd.readouterr() == ("", "")


def test_names_with_digits_that_are_no_numbers(tmp_path: Path) -> None:
    names = ["1²0.png", "٣.png", "10.png", "9.png", "9" * 200 + ".png"]
    for name in names:
        (tmp_path / name).touch()
    files = [name.path for name in read_names(sorted(tmp_path.iterdir()))[0]]
    found = [path.name for path in files]
    assert sorted(found) == sorted(names)
    assert found.index("9.png") < found.index("10.png") < found.index("9" * 200 + ".png")
    assert positions_by_number(files, 0.2) is None
    counted = [Path(f"{'9' * 60}{k}.png") for k in (0, 1, 2, 3, 5)]
    assert positions_by_number(counted, 0.2) is None
    assert positions_by_number([Path(f"٣{k}.png") for k in (0, 1, 2, 3, 4, 6)], 1.0) == (0, 1, 2, 3, 4, 6)


def test_a_file_name_that_is_no_text_is_told(tmp_path: Path) -> None:
    name = os.fsdecode(b"frame_\xff1.png")
    said = refused(written(tmp_path / name, b"nothing"))
    said.encode("utf-8")


def test_a_folder_that_cannot_be_listed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(self: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", denied)
    assert "Permission denied" in refused(tmp_path)
    with pytest.raises(EndoctError, match="Permission denied"):
        recognise(tmp_path)


def test_links_in_a_circle_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.png").symlink_to(tmp_path / "b.png")
    (tmp_path / "b.png").symlink_to(tmp_path / "a.png")
    assert "symbolic links" in refused(tmp_path)
    with pytest.raises(EndoctError, match="does not exist"):
        recognise(tmp_path / "a.png")


@pytest.mark.parametrize(
    "keys",
    [
        {"pullback_pitch_mm": 10.0, "positions_mm": (0.0, 1e4, -1e4, 3.0, 40000.0)},
        {"axial_pixel_mm": 1e-4, "bore_diameter_mm": 100.0, "capillary_outer_diameter_mm": 0.05},
    ],
)
def test_keys_that_are_each_possible_must_be_so_together(keys: dict[str, object], tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", np.zeros((5, 64, 64), np.uint8))
    usual = {"axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2, "bore_diameter_mm": 2.5}
    acquisition = OctAcquisition.model_construct(
        **{"modality": "oct", "capillary_outer_diameter_mm": 1.7, "medium_index": 1.0, "travel": "in", **usual, **keys}
    )
    with pytest.raises(EndoctError, match="far"):
        Pullback(tmp_path / "x.npy", acquisition)


def test_a_panorama_that_would_not_fit_is_refused() -> None:
    with pytest.raises(EndoctError, match="too much memory"):
        SurfaceGrid.full_circle(10**9, 2048, z0_mm=0.0, dz_mm=1e-4, radius_mm=1.25)


def test_a_manifest_loads_no_decoder() -> None:
    modules = "endoct.modalities.oct.manifest, endoct.modalities.reading.recording"
    code = f"import sys, {modules}; print(*{{'cv2', 'av', 'PIL'}} & {{*sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""
