"""One channel of a PNG is what a decoder of all of it gives, or is left to that decoder."""

import pickle
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.modalities.images import read_channel, read_image
from endoct.modalities.png_channel import one_channel
from endoct.modalities.recording import open_stack
from endoct.stitching.errors import EndoctError

RNG = np.random.default_rng(5)
SMOOTH = cv2.GaussianBlur(RNG.integers(0, 256, (37, 41, 4), np.uint8), (0, 0), 2)
FILTERS = {"none": 8, "sub": 16, "up": 32, "average": 64, "Paeth": 128, "all": 248}


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def filtered(image: np.ndarray, how: list[int]) -> bytes:
    """Return rows as a PNG stores them, each by its way."""
    rows, columns, channels = image.shape
    padded = np.zeros((rows + 1, columns + 1, channels), np.int64)
    padded[1:, 1:] = image
    here, left, above, between = padded[1:, 1:], padded[1:, :-1], padded[:-1, 1:], padded[:-1, :-1]
    near = np.stack([abs(above - between), abs(left - between), abs(left + above - 2 * between)])
    nearest = np.choose(np.argmin(near, axis=0), (left, above, between))  # the first of those as near
    by_way = [0 * here, left, above, (left + above) // 2, nearest]
    stored = [((here - by_way[way])[i] % 256).astype(np.uint8).tobytes() for i, way in enumerate(how)]
    return b"".join(bytes([way]) + row for way, row in zip(how, stored, strict=True))


def png(image: np.ndarray, how: list[int], *more: bytes, packed: bytes | None = None, interlaced: int = 0) -> bytes:
    rows, columns, channels = image.shape
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, {3: 2, 4: 6}[channels], 0, 0, interlaced))
    data = zlib.compress(filtered(image, how)) if packed is None else packed
    parts = [data[k : k + 500] for k in range(0, len(data), 500)]
    return b"\x89PNG\r\n\x1a\n" + head + b"".join([*more, *(chunk(b"IDAT", p) for p in parts)]) + chunk(b"IEND", b"")


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("ways", [[0], [1], [2], [3], [4], [4, 0, 3, 1, 2]], ids=str)
@pytest.mark.parametrize("image", [SMOOTH, RNG.integers(0, 256, SMOOTH.shape, np.uint8)], ids=["smooth", "noise"])
def test_every_way_of_storing_a_row_is_undone(
    image: np.ndarray, ways: list[int], channels: int, tmp_path: Path
) -> None:
    image = np.ascontiguousarray(image[..., :channels])
    how = [ways[i % len(ways)] for i in range(len(image))]
    path = written(tmp_path / "x.png", png(image, how, chunk(b"tEXt", b"Comment\0x")))
    np.testing.assert_array_equal(read_image(path), image)
    for channel in range(3):
        read = read_channel(path, channel)
        assert read is not None
        np.testing.assert_array_equal(read, image[..., channel])


@pytest.mark.parametrize("filters", FILTERS.values(), ids=FILTERS)
def test_files_of_a_library_are_read_alike(filters: int, tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    cv2.imwrite(str(path), SMOOTH[..., :3], [cv2.IMWRITE_PNG_FILTER, filters])
    np.testing.assert_array_equal(read_channel(path, 1), read_image(path)[..., 1])


def test_what_is_no_such_png_is_left_to_its_decoder(tmp_path: Path) -> None:
    colour = SMOOTH[..., :3].copy()
    files = {
        "grey.png": SMOOTH[..., 0],
        "deep.png": colour.astype(np.uint16) * 100,
        "colour.jpg": colour,
    }
    for name, image in files.items():
        cv2.imwrite(str(tmp_path / name), image)
        assert read_channel(tmp_path / name, 1) is None
    assert read_channel(tmp_path / "missing.png", 1) is None
    laced = png(colour, [0] * len(colour), interlaced=1)
    assert read_channel(written(tmp_path / "laced.png", laced), 1) is None


def test_a_damaged_png_gives_no_channel(tmp_path: Path) -> None:
    colour = SMOOTH[..., :3].copy()
    how = [1] * len(colour)
    rows = filtered(colour, how)
    wrong = {
        "short": zlib.compress(rows[:-50]),
        "long": zlib.compress(rows + bytes(50)),
        "sum": zlib.compress(rows)[:-4] + b"abcd",
        "way": zlib.compress(bytes([5]) + rows[1:]),
        "packing": b"not packed at all",
        "empty": b"",
    }
    for name, packed in wrong.items():
        assert read_channel(written(tmp_path / f"{name}.png", png(colour, how, packed=packed)), 1) is None, name
        assert one_channel(packed, colour.shape, 1) is None, name
    whole = png(colour, how)
    for at in (20, 60, len(whole) - 20):
        assert read_channel(written(tmp_path / "x.png", whole[:at] + b"\xff\xfe" + whole[at + 2 :]), 1) is None
        assert read_channel(written(tmp_path / "x.png", whole[:at]), 1) is None


def test_a_stack_gives_a_channel_as_it_gives_the_frame(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"frame_{k}.png"), np.roll(SMOOTH, k, axis=0))
    stack = pickle.loads(pickle.dumps(open_stack(tmp_path)))
    for k in range(3):
        green = stack.channel(k, 1)
        assert not green.flags.writeable
        np.testing.assert_array_equal(green, stack[k][..., 1])
    with pytest.raises(IndexError):
        stack.channel(3, 1)
    with pytest.raises(IndexError):
        stack.channel(-1, 1)
    cv2.imwrite(str(tmp_path / "frame_1.png"), SMOOTH[:20])
    with pytest.raises(EndoctError, match="differs from the first"):
        stack.channel(1, 1)
    (tmp_path / "frame_2.png").write_bytes((tmp_path / "frame_0.png").read_bytes()[:-300])
    with pytest.raises(EndoctError, match="no readable image"):
        stack.channel(2, 1)
