"""Drawings of others that are damaged, or made to do harm, are refused in one line."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roifile
import zarr

from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import is_label_store, read_drawing
from endoct.fusion.files.masks import read_mask
from endoct.fusion.files.outlines import fill

SHAPE = (40, 60)
HEAD = "index,shape-type,vertex-index,axis-0,axis-1\n"
PLANE = np.zeros(SHAPE, np.uint8)
PLANE[5:9, 50:] = 3


def refused(path: Path) -> str:
    with pytest.raises(EndoctError) as raised:
        read_drawing(path, SHAPE)
    assert "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.parametrize("compressor", [None, "blosc", "zlib", "gzip", "zstd", "lz4"])
def test_labels_of_zarr_2(compressor: str | None, tmp_path: Path) -> None:
    import numcodecs

    codec = compressor and numcodecs.get_codec({"id": compressor})
    array: Any = zarr.create_array(
        tmp_path / "a.zarr", shape=SHAPE, chunks=(16, 60), dtype="<i4", zarr_format=2, compressors=codec, order="F"
    )
    array[...] = PLANE
    assert np.array_equal(read_drawing(tmp_path / "a.zarr", None), PLANE > 0)


@pytest.mark.parametrize(
    "options",
    [
        {"compressors": zarr.codecs.BloscCodec()},
        {"compressors": zarr.codecs.GzipCodec()},
        {"compressors": [zarr.codecs.Crc32cCodec(), zarr.codecs.ZstdCodec()]},
        {"compressors": None},
        {"filters": zarr.codecs.TransposeCodec(order=(1, 0))},
        {"shards": (40, 60), "chunks": (20, 30)},
        {"chunk_key_encoding": {"name": "v2", "separator": "."}},
    ],
)
def test_labels_of_zarr_3(options: dict[str, Any], tmp_path: Path) -> None:
    array: Any = zarr.create_array(tmp_path / "a.zarr", **{"chunks": (20, 30), **options}, shape=SHAPE, dtype="u2")
    array[...] = PLANE
    chunks = [path for path in (tmp_path / "a.zarr").rglob("*") if path.is_file() and path.name != "zarr.json"]
    assert 0 < len(chunks) <= 2  # what is empty was not written, and is empty still
    assert np.array_equal(read_drawing(tmp_path / "a.zarr", None), PLANE > 0)


def metadata_2(**changed: Any) -> str:
    told = {"zarr_format": 2, "shape": list(SHAPE), "chunks": list(SHAPE), "dtype": "|u1", "compressor": None}
    return json.dumps({**told, "fill_value": 0, "filters": None, "order": "C", **changed})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"filters": [{"id": "vlen-utf8"}, {"id": "pickle"}], "dtype": "|O"}, "because of its filters"),
        ({"filters": [{"id": "delta", "dtype": "u1"}]}, "because of its filters"),
        ({"compressor": {"id": "pickle"}}, "because of its compressor"),
        ({"compressor": {"id": "lzma"}}, "because of its compressor"),
        ({"compressor": "zstd"}, "compressor"),
        ({"compressor": {"id": "zstd", "x": 1}}, "not compressed with zstd"),
        ({"dtype": "|O"}, "because of its data type"),
        ({"dtype": "<f4"}, "because of its data type"),
        ({"dtype": "<u3"}, "no Zarr array|data type"),
        ({"dtype": [["a", "<u1"]]}, "because of its data type"),
        ({"shape": [100_000, 100_000]}, "too much memory"),
        ({"chunks": [100_000, 100_000]}, "too much memory"),
        ({"dimension_separator": "/../"}, "separator"),
        ({"shape": None}, "no shape"),
    ],
)
def test_labels_that_ask_for_what_is_not_read(changed: dict[str, Any], message: str, tmp_path: Path) -> None:
    folder = tmp_path / "a.zarr"
    folder.mkdir()
    (folder / ".zarray").write_text(metadata_2(**changed))
    (folder / "0.0").write_bytes(PLANE.tobytes())
    with pytest.raises(EndoctError, match=message):
        read_drawing(folder, None)
    is_label_store(folder)  # and this raises nothing


def test_a_filter_runs_nothing(tmp_path: Path) -> None:
    import pickle

    class Evil:
        def __reduce__(self) -> tuple[object, ...]:
            return os.system, (f"touch {tmp_path / 'ran'}",)

    folder = tmp_path / "a.zarr"
    folder.mkdir()
    for filters in ([{"id": "pickle"}], [{"id": "vlen-utf8"}, {"id": "pickle"}]):
        (folder / ".zarray").write_text(metadata_2(dtype="|O", filters=filters))
        (folder / "0.0").write_bytes(pickle.dumps(Evil()))
        refused(folder)
        assert not is_label_store(folder)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("listed", ["../outside", "/etc", "", ".", 5, None, "a/../../outside", ["a"]])
def test_levels_lie_inside_their_store(listed: object, tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "outside", data=PLANE)
    attributes = {"multiscales": [{"datasets": [{"path": listed}]}]}
    zarr.create_group(tmp_path / "a.zarr", attributes={"ome": attributes})
    refused(tmp_path / "a.zarr")
    assert not is_label_store(tmp_path / "a.zarr")


def test_a_level_is_no_link(tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "outside", data=PLANE)
    zarr.create_group(tmp_path / "a.zarr", attributes={"ome": {"multiscales": [{"datasets": [{"path": "fine"}]}]}})
    (tmp_path / "a.zarr" / "fine").symlink_to(tmp_path / "outside")
    assert "a link" in refused(tmp_path / "a.zarr")


@pytest.mark.parametrize("codec", ["gzip", "zlib", "blosc", "lz4", "zstd"])
def test_a_small_chunk_of_eight_gigabytes(codec: str, tmp_path: Path) -> None:
    import gzip
    import struct
    import zlib

    folder = tmp_path / "a.zarr"
    folder.mkdir()
    side = [2000, 2000]  # so that the file itself is small enough for a chunk
    (folder / ".zarray").write_text(metadata_2(compressor={"id": codec}, shape=side, chunks=side))
    piece = bytes(1_000_000)
    if codec == "gzip":
        data = gzip.compress(piece * 20) * 50
    elif codec == "zlib":
        stream = zlib.compressobj(wbits=-15)
        part = stream.compress(piece * 20) + stream.flush(zlib.Z_FULL_FLUSH)  # what comes next does not rest on it
        data = b"\x78\x9c" + part * 50 + b"\x03\x00" + struct.pack(">HH", 10**9 % 65521, 1)
        assert len(zlib.decompress(data)) == 10**9
    elif codec == "zstd":
        blocks = (b"\x02\x00\x10\x00" * (8000 * 8))[:-4] + b"\x03\x00\x10\x00"  # 128 kB of one byte each, no size
        data = b"\x28\xb5\x2f\xfd\x00\x58" + blocks
    elif codec == "blosc":
        data = struct.pack("<BBBBIII", 2, 1, 0, 1, 2**31 - 1, 2**20, 16 + 100) + bytes(100)
    else:
        data = struct.pack("<I", 2**31 - 1) + bytes(100)
    (folder / "0.0").write_bytes(data)
    code = (
        "import resource, sys; from pathlib import Path\n"
        "from endoct.fusion.files.drawings import read_drawing; from endoct.base.errors import EndoctError\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: read_drawing(Path(sys.argv[1]), None)\n"
        "except EndoctError as error: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[0]) < 100_000
    assert "0.0 is no chunk of its array" in done.stdout


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,polygon,0,nan,1\n0,polygon,1,1,2\n0,polygon,2,3,4\n", "NaN or infinity"),
        ("0,polygon,0,inf,1\n0,polygon,1,1,2\n0,polygon,2,3,4\n", "NaN or infinity"),
        ("0,polygon,0,1,1e12\n0,polygon,1,1,2\n0,polygon,2,3,4\n", "far outside"),
        ("0,polygon,0,1e300,1\n0,polygon,1,1,2\n0,polygon,2,3,4\n", "far outside"),
        ("0,polygon,0,1,-239\n0,polygon,1,1,239\n0,polygon,2,3,4\n", "runs around"),
        ("0,ellipse,0,1,1\n", "encloses nothing"),
        ("0,polygon,0,1,1\n0,polygon,1,1,2\n", "encloses nothing"),
        ("0,polygon\n", "cannot be read"),
        ("\n0\n", "without its shape"),
        ("0,polygon,0,1," + "1" * 200_000 + "\n", "cannot be read"),
        ("0,[/x],0,1,1\n", "encloses nothing"),
    ],
)
def test_outlines_of_napari_that_enclose_nothing(rows: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(HEAD + rows)
    assert message in refused(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "outline", [np.zeros((2, 2)), np.zeros((3, 3)), np.full((4, 2), np.nan), np.full((3, 2), 1e12)]
)
def test_what_cannot_be_filled(outline: np.ndarray) -> None:
    with pytest.raises(EndoctError):
        fill(outline, SHAPE)


def test_a_zip_of_regions_expands_only_so_far(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as members:
        members.writestr("a.roi", bytes(65_000_000))
    assert "holds too much" in refused(tmp_path / "a.zip")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as members:
        for k in range(10_001):
            members.writestr(f"{k}.roi", b"")
    assert "holds too much" in refused(tmp_path / "a.zip")


def test_damaged_regions_of_fiji(tmp_path: Path) -> None:
    whole = roifile.ImagejRoi.frompoints(np.array([[30, 2], [40, 2], [40, 6], [30, 6]], np.float32)).tobytes()
    rng = np.random.default_rng(3)
    path = tmp_path / "a.roi"
    for _ in range(300):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), 3):
            data[place] = rng.integers(0, 256)
        path.write_bytes(bytes(data[: rng.integers(1, len(data) + 1)]))
        try:
            read_drawing(path, SHAPE)
        except EndoctError as error:
            assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize(
    "line", ["bore_diameter_mm = 1e9", "bore_diameter_mm = 0.01", "z0_mm = 1e5", "dz_mm = 1e-9", "dz_mm = 1e6",
             f'rater = "{"x" * 101}"', f'session = "{"x" * 101}"'],
)  # fmt: skip
def test_sidecars_that_cannot_be(line: str, tmp_path: Path) -> None:
    import cv2

    told = {"modality": '"mask"', "bore_diameter_mm": "2.5", "z0_mm": "0.0", "dz_mm": "0.05"}
    key, _, value = line.partition(" = ")
    (tmp_path / "m.toml").write_text("".join(f"{k} = {v}\n" for k, v in {**told, key: value}.items()))
    cv2.imwrite(str(tmp_path / "m.png"), PLANE * 80)
    with pytest.raises(EndoctError, match=f"'{key}'.*cannot be used"):
        read_mask(tmp_path / "m.png")


def test_a_pipe_is_no_drawing(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.roi")
    refused(tmp_path / "a.roi")
    folder = tmp_path / "a.zarr"
    folder.mkdir()
    (folder / ".zarray").write_text(metadata_2())
    os.mkfifo(folder / "0.0")
    refused(folder)
