"""Stacks of frames, read one at a time, in every file they come in."""

import pickle
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import open_stack

STACK = np.random.default_rng(5).integers(0, 65536, (5, 24, 32), dtype=np.uint16)
COLOUR = np.random.default_rng(6).integers(0, 256, (3, 24, 32, 3), dtype=np.uint8)

Write = Callable[[Path], Path]


def tiff(**options: object) -> Write:
    def write(folder: Path) -> Path:
        tifffile.imwrite(folder / "stack.tif", STACK, **options)
        return folder / "stack.tif"

    return write


def npy(stack: np.ndarray = STACK) -> Write:
    def write(folder: Path) -> Path:
        np.save(folder / "stack.npy", stack)
        return folder / "stack.npy"

    return write


def images(suffix: str, stack: np.ndarray = STACK) -> Write:
    def write(folder: Path) -> Path:
        for index, frame in enumerate(stack):
            bgr = frame if frame.ndim == 2 else np.ascontiguousarray(frame[..., ::-1])
            assert cv2.imwrite(str(folder / f"frame_{index + 8}{suffix}"), bgr)  # 8, 9, 10, …: sorted as numbers
        (folder / "notes.txt").write_text("not a frame")
        return folder

    return write


def in_folder(write: Write) -> Write:
    return lambda folder: write(folder).parent


WRITERS = {
    "tiff": tiff(photometric="minisblack"),
    "big-endian BigTIFF": tiff(photometric="minisblack", bigtiff=True, byteorder=">"),
    "compressed": tiff(photometric="minisblack", compression="zlib"),
    "ImageJ, one directory": tiff(imagej=True),
    "OME": tiff(photometric="minisblack", ome=True),
    "npy": npy(),
    "big-endian npy": npy(STACK.astype(">u2")),
    "PNGs": images(".png"),
    "TIFFs": images(".tif"),
    "a folder with one TIFF": in_folder(tiff(photometric="minisblack")),
    "a folder with one npy": in_folder(npy()),
}


def refused(path: Path) -> str:
    """Open and read all; return what was said."""

    def read_all() -> None:
        stack = open_stack(path)
        for index in range(len(stack)):
            stack[index]

    with pytest.raises(EndoctError) as caught:
        read_all()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS.keys())
def test_every_kind_of_file_gives_the_frames(write: Write, tmp_path: Path) -> None:
    stack = open_stack(write(tmp_path))
    assert len(stack) == 5
    for index in (3, 0, 4, 1, 2):
        np.testing.assert_array_equal(stack[index], STACK[index])
    assert stack[2].dtype == np.uint16
    assert stack[2].dtype.isnative
    assert not stack[2].flags.writeable
    again = pickle.loads(pickle.dumps(stack))
    np.testing.assert_array_equal(again[4], STACK[4])
    for outside in (5, -1):
        with pytest.raises(IndexError):
            stack[outside]


@pytest.mark.parametrize(
    "write",
    [
        images(".png", COLOUR),
        images(".bmp", COLOUR),
        lambda folder: (tifffile.imwrite(folder / "c.tif", COLOUR, photometric="rgb"), folder / "c.tif")[1],
        npy(COLOUR),
        npy(np.concatenate([COLOUR, COLOUR[..., :1]], axis=-1)),
    ],
    ids=["png", "bmp", "tiff", "npy", "transparency"],
)
def test_colour_is_red_green_blue(write: Write, tmp_path: Path) -> None:
    np.testing.assert_array_equal(open_stack(write(tmp_path))[1], COLOUR[1])


def test_a_single_image_is_a_stack_of_one(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one.png"), STACK[0])
    np.save(tmp_path / "one.npy", STACK[0])
    tifffile.imwrite(tmp_path / "one.tif", STACK[0])
    for name in ("one.png", "one.npy", "one.tif"):
        stack = open_stack(tmp_path / name)
        assert len(stack) == 1
        np.testing.assert_array_equal(stack[0], STACK[0])


def test_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for k, name in enumerate(("f10.png", "f9.png", "F2.PNG", ".f1.png", "f1.txt.png")):
        cv2.imwrite(str(tmp_path / name), STACK[k % 3])
    (tmp_path / "f1.txt.png").rename(tmp_path / "f1.txt")
    stack = open_stack(tmp_path)
    for k, index in enumerate((2, 1, 0)):
        np.testing.assert_array_equal(stack[k], STACK[index])
    assert len(stack) == 3


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS.keys())
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7])
def test_a_truncated_file_is_refused(write: Write, share: float, tmp_path: Path) -> None:
    path = write(tmp_path)
    file = path if path.is_file() else max(path.iterdir(), key=lambda f: (f.stat().st_size, f.name))
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    refused(path)


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".png", ".jpg"])
def test_empty_and_foreign_files_are_refused(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"x{suffix}"
    file.touch()
    assert "is empty" in refused(file)
    file.write_text("Dear reader, this is no image.")
    refused(file)


def test_broken_files_say_their_one_line_only(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for name, write in {"a": tiff(compression="zlib"), "b": images(".png"), "c": tiff(imagej=True)}.items():
        (tmp_path / name).mkdir()
        path = write(tmp_path / name)
        file = path if path.is_file() else max(path.glob("*.png"))
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        refused(path)
    assert capfd.readouterr() == ("", "")


def test_missing_and_empty_folders_are_refused(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "missing")
    assert "holds no recording" in refused(tmp_path)


def test_a_frame_of_another_size_is_refused_by_name(tmp_path: Path) -> None:
    images(".png")(tmp_path)
    cv2.imwrite(str(tmp_path / "frame_10.png"), STACK[0][:20])
    said = refused(tmp_path)
    assert "frame 2 of" in said
    assert "found uint16 (20, 32)" in said
    assert "expected uint16 (24, 32)" in said


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_tiff_with_a_page_of_another_size_is_refused(compression: str | None, tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "x.tif") as writer:
        writer.write(STACK, photometric="minisblack", compression=compression)
        writer.write(STACK[0][:20], photometric="minisblack", compression=compression)
    assert "mixes pages" in refused(tmp_path / "x.tif")


def test_several_recordings_in_one_folder_are_refused(tmp_path: Path) -> None:
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, STACK)
    assert "more than one recording" in refused(tmp_path)
    (tmp_path / "tiffs").mkdir()
    for number, name in enumerate(("a.tif", "b.tif")):
        tifffile.imwrite(tmp_path / "tiffs" / name, STACK + np.uint16(number), photometric="minisblack")
    assert "found 5 pages" in refused(tmp_path / "tiffs")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_by_frame(value: float, tmp_path: Path) -> None:
    stack = STACK.astype(np.float32)
    stack[3, 1, 1] = value
    assert "frame 3 of" in refused(npy(stack)(tmp_path))


@pytest.mark.parametrize(
    "stack",
    [
        np.zeros((0, 24, 32), np.uint8),
        np.zeros((3, 0, 32), np.uint8),
        np.zeros((2, 2, 2, 2, 3), np.uint8),
        np.zeros((), np.uint8),
        np.zeros((3, 4, 5), np.complex64),
        np.zeros((3, 4, 5), bool),
        np.array(["a", None], object),
        np.asfortranarray(np.zeros((3, 4, 5))),
    ],
    ids=["no frames", "no rows", "five dimensions", "a number", "complex", "bool", "objects", "Fortran order"],
)
def test_arrays_that_are_no_stack_are_refused(stack: np.ndarray, tmp_path: Path) -> None:
    refused(npy(stack)(tmp_path))


def test_an_archive_named_npy_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "pullback.npy").open("wb") as file:
        np.savez(file, a=np.zeros(3))
    with pytest.raises(EndoctError, match="an archive of arrays"):
        open_stack(tmp_path / "pullback.npy")


def test_a_jpeg_with_a_film_behind_it_is_an_image(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one.jpg"), COLOUR[0])
    alone = open_stack(tmp_path / "one.jpg")[0]
    with (tmp_path / "one.jpg").open("ab") as file:
        file.write(bytes(10_000) + b"\xff\xda..\xff\xd9" * 60)
    np.testing.assert_array_equal(open_stack(tmp_path / "one.jpg")[0], alone)
    data = (tmp_path / "one.jpg").read_bytes()
    (tmp_path / "one.jpg").write_bytes(data[: data.rfind(b"\xff\xd9") - 20])
    assert "without its end" in refused(tmp_path / "one.jpg")


def test_three_equal_colours_are_grey_where_every_frame_has_them(tmp_path: Path) -> None:
    grey = np.repeat(COLOUR[..., :1], 3, axis=3)
    opened = open_stack(npy(grey)(tmp_path)).grey()
    assert opened.frame_shape == (24, 32)
    np.testing.assert_array_equal(opened[2], grey[2, ..., 0])
    for stack in (COLOUR, np.zeros_like(grey), STACK):  # coloured, black, without colours
        opened = open_stack(npy(stack)(tmp_path))
        assert opened.grey() is opened
    late = np.concatenate([grey] * 4)
    late[10, 0, 0] = 1, 2, 3  # of twelve frames the first, the middle and the last are looked at
    opened = open_stack(npy(late)(tmp_path)).grey()
    with pytest.raises(EndoctError, match=r"frame 10 of .* has colours"):
        opened[10]
