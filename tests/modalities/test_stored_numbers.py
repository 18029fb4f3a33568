"""What stored numbers of images mean: white as 0, palettes, equal colours, transparency, orientation."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageOps

from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import read_drawing
from endoct.modalities.oct.pullback_stream import open_pages
from endoct.modalities.reading.orientation import upright
from endoct.modalities.reading.recording import open_stack

GREY = np.random.default_rng(1).integers(0, 256, (24, 40), dtype=np.uint8)
CELLS = np.zeros((24, 40), np.bool_)
CELLS[4:8, 10:16] = True


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_white_as_zero_is_turned_over(dtype: type[np.unsignedinteger], compression: str | None, tmp_path: Path) -> None:
    bright = np.stack([GREY, GREY[::-1]]).astype(dtype)
    stored = np.iinfo(dtype).max - bright
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="miniswhite", compression=compression)
    stack = open_stack(tmp_path / "a.tif")
    np.testing.assert_array_equal(stack[1], bright[1])
    assert "WhiteIsZero" in stack.remarks.notes[0]


def test_white_as_zero_of_other_numbers_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY.astype(np.float32), photometric="miniswhite")
    with pytest.raises(EndoctError, match="WhiteIsZero"):
        open_stack(tmp_path / "a.tif")


def test_colours_for_print_are_refused_by_name(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.stack([GREY] * 4, axis=-1), photometric="separated")
    with pytest.raises(EndoctError, match="CMYK"):
        open_stack(tmp_path / "a.tif")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".tif", ".png", ".jpg"])
def test_images_are_upright_as_pillow_has_them(orientation: int, suffix: str, tmp_path: Path) -> None:
    smooth = np.add.outer(np.arange(24) * 3, np.arange(40) * 2).astype(np.uint8)
    path = tmp_path / f"a{suffix}"
    exif = Image.Exif()
    exif[274] = orientation
    if suffix == ".tif":
        extra = [(274, "H", 1, orientation, True)]
        tifffile.imwrite(path, smooth, photometric="minisblack", extratags=extra)
    else:
        Image.fromarray(smooth).save(path, exif=exif, **({"quality": 100} if suffix == ".jpg" else {}))
    as_png = tmp_path / "expected.png"
    Image.fromarray(smooth).save(as_png, exif=exif)
    with Image.open(as_png) as opened:
        expected = np.asarray(ImageOps.exif_transpose(opened))
    stack = open_stack(path)
    assert stack.frame_shape == expected.shape
    np.testing.assert_allclose(stack[0].astype(int), expected, atol=2)
    assert len(stack.remarks.notes) == (orientation > 1)


def test_eight_orientations_differ() -> None:
    assert len({upright(GREY, k).tobytes() for k in range(1, 9)}) == 8


def test_an_image_stored_otherwise_than_the_first_is_refused(tmp_path: Path) -> None:
    for k in range(3):
        exif = Image.Exif()
        exif[274] = 3 if k == 1 else 1
        Image.fromarray(GREY).save(tmp_path / f"f{k}.png", exif=exif)
    stack = open_stack(tmp_path)
    with pytest.raises(EndoctError, match=r"f1.png is stored in another orientation"):
        stack[1]


@pytest.mark.parametrize("mode", ["P", "LA", "RGB", "RGBA"])
def test_grey_in_any_mode_is_read_as_bscans(mode: str, tmp_path: Path) -> None:
    grey = np.random.default_rng(2).integers(0, 256, (2, 64, 80), dtype=np.uint8)
    for k, page in enumerate(grey):
        Image.fromarray(page).convert("RGB" if mode == "P" else mode).convert(mode).save(tmp_path / f"f{k}.png")
    if mode == "P":
        pytest.importorskip("PIL")
        for k, page in enumerate(grey):
            image = Image.fromarray(255 - page, "P")
            image.putpalette([255 - value for value in range(256) for _ in range(3)])
            image.save(tmp_path / f"f{k}.png")
    stack = open_pages(tmp_path, None)
    np.testing.assert_array_equal(stack[1], grey[1])


def test_a_page_with_colours_among_grey_ones_is_refused_by_number(tmp_path: Path) -> None:
    pages = np.repeat(np.random.default_rng(3).integers(0, 256, (5, 64, 80, 1), dtype=np.uint8), 3, axis=3)
    pages[3, 5, 5, 0] ^= 1
    tifffile.imwrite(tmp_path / "a.tif", pages, photometric="rgb")
    stack = open_pages(tmp_path / "a.tif", None)
    with pytest.raises(EndoctError, match=r"frame 3 of .* has colours"):
        stack[3]


def test_frames_of_equal_samples_are_doubted_once_they_are_read(tmp_path: Path) -> None:
    frames = np.random.default_rng(4).integers(0, 256, (6, 64, 80), dtype=np.uint8)
    frames[4] = frames[1]
    frames[2] = frames[3] = 7  # dark ones repeat nothing
    np.save(tmp_path / "a.npy", frames)
    stack = open_stack(tmp_path / "a.npy")
    for index in range(6):
        stack[index]
    (doubt,) = stack.remarks.doubts
    assert (doubt.code, doubt.value) == ("frames-repeated", 1.0)
    assert "4 as 1" in doubt.what


@pytest.mark.parametrize("under", [0, 255])
@pytest.mark.parametrize("colour", [(255, 0, 0), (0, 0, 0), (255, 255, 255)], ids=str)
def test_a_transparent_ground_is_no_cell(under: int, colour: tuple[int, int, int], tmp_path: Path) -> None:
    image = np.full((*CELLS.shape, 4), under, np.uint8)
    image[..., 3] = 0
    image[CELLS] = (*colour, 255)
    Image.fromarray(image).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_drawing(tmp_path / "m.png", CELLS.shape), CELLS)


def test_a_mask_that_is_transparent_and_black_is_refused(tmp_path: Path) -> None:
    image = np.zeros((*CELLS.shape, 4), np.uint8)
    image[2:, :, 3] = 255
    image[CELLS, :3] = 255
    Image.fromarray(image).save(tmp_path / "m.png")
    with pytest.raises(EndoctError, match="does not say what is cell"):
        read_drawing(tmp_path / "m.png", CELLS.shape)


def test_numbers_of_a_palette_are_labels_unless_its_colours_contradict(tmp_path: Path) -> None:
    colours = np.zeros((3, 256), np.uint16)
    colours[:, 0], colours[:, 1] = 65535, (65535, 0, 0)
    labels = CELLS.astype(np.uint8)
    tifffile.imwrite(tmp_path / "m.tif", labels, photometric="palette", colormap=colours)
    np.testing.assert_array_equal(read_drawing(tmp_path / "m.tif", CELLS.shape), CELLS)
    colours[:, 1] = 0
    tifffile.imwrite(tmp_path / "m.tif", labels, photometric="palette", colormap=colours)
    with pytest.raises(EndoctError, match="palette in which 0 is not black"):
        read_drawing(tmp_path / "m.tif", CELLS.shape)


def test_a_mask_with_losses_is_refused(tmp_path: Path) -> None:
    Image.fromarray(CELLS.astype(np.uint8) * 255).save(tmp_path / "m.jpg", quality=80)
    with pytest.raises(EndoctError, match="a JPEG"):
        read_drawing(tmp_path / "m.jpg", CELLS.shape)


@pytest.mark.parametrize("photometric", ["miniswhite", "minisblack"])
def test_a_mask_of_one_bit(photometric: str, tmp_path: Path) -> None:
    stored = ~CELLS if photometric == "miniswhite" else CELLS
    tifffile.imwrite(tmp_path / "m.tif", stored, photometric=photometric)
    np.testing.assert_array_equal(read_drawing(tmp_path / "m.tif", CELLS.shape), CELLS)


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_a_mask_with_the_inverting_table_of_fiji_is_refused(suffix: str, tmp_path: Path) -> None:
    image = Image.fromarray(CELLS.astype(np.uint8) * 255, "P")
    image.putpalette([value for value in range(255, -1, -1) for _ in range(3)])
    image.save(tmp_path / f"m{suffix}")
    with pytest.raises(EndoctError, match="palette in which 0 is not black, and another number is"):
        read_drawing(tmp_path / f"m{suffix}", CELLS.shape)


@pytest.mark.parametrize("transparent", [{}, {"transparency": 0}])
def test_labels_with_a_colour_each_in_a_png_that_is_stored_turned(transparent: dict[str, int], tmp_path: Path) -> None:
    labels = CELLS.astype(np.uint8)
    labels[12:16, 30:35] = 2
    exif = Image.Exif()
    exif[274] = 3
    image = Image.fromarray(labels[::-1, ::-1].copy(), "P")
    image.putpalette([*((255, 255, 255) if transparent else (0, 0, 0)), 128, 0, 0, 0, 128, 0, 9, 9, 9])
    image.save(tmp_path / "m.png", exif=exif, **transparent)
    np.testing.assert_array_equal(read_drawing(tmp_path / "m.png", CELLS.shape), labels > 0)


def test_most_of_a_mask_as_white_where_0_is_white_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "m.tif", CELLS.astype(np.uint8) * 255, photometric="miniswhite")
    with pytest.raises(EndoctError, match="of it white, in a file that changes"):
        read_drawing(tmp_path / "m.tif", CELLS.shape)


def test_a_transparent_colour_of_two_is_the_ground(tmp_path: Path) -> None:
    image = Image.fromarray(CELLS.astype(np.uint8), "P")
    image.putpalette([255, 255, 255, 200, 0, 0])
    image.save(tmp_path / "m.png", transparency=0)
    np.testing.assert_array_equal(read_drawing(tmp_path / "m.png", CELLS.shape), CELLS)


IMAGEJ = "ImageJ=1.54f\nimages=2\nslices=2\n{}\n"


@pytest.mark.parametrize(
    ("said", "values"),
    [
        ("cf=0\nc0=-32768.0\nc1=1.0", lambda stored: stored.astype(np.float32) - 32768),
        ("cf=0\nc0=5\nc1=-0.5", lambda stored: (5 - 0.5 * stored.astype(np.float64)).astype(np.float32)),
        ("cf=0\nc0=0.0\nc1=1.0", lambda stored: stored),
        ("cf=20\nc0=7\nc1=2", lambda stored: stored),
        ("unit=pixel", lambda stored: stored),
    ],
)
def test_the_line_of_imagej_is_applied(said: str, values: Callable[[Any], Any], tmp_path: Path) -> None:
    stored = np.random.default_rng(4).integers(0, 65536, (2, 40, 48), dtype=np.uint16)
    tifffile.imwrite(
        tmp_path / "a.tif", stored, photometric="minisblack", description=IMAGEJ.format(said), metadata=None
    )
    stack, expected = open_stack(tmp_path / "a.tif"), values(stored)
    assert stack.dtype == expected.dtype
    np.testing.assert_array_equal(stack[1], expected[1])
    assert any("ImageJ's calibration" in note for note in stack.remarks.notes) == (expected.dtype == np.float32)
    (tmp_path / "folder").mkdir()
    single = IMAGEJ.format(said).replace("=2\n", "=1\n")
    for k, frame in enumerate(stored):
        tifffile.imwrite(tmp_path / "folder" / f"{k}.tif", frame, description=single, metadata=None)
    one_by_one = open_stack(tmp_path / "folder")
    np.testing.assert_array_equal(one_by_one[1], expected[1])
    assert one_by_one.remarks.notes == stack.remarks.notes


@pytest.mark.parametrize(
    "said", ["cf=1\nc0=0\nc1=1\nc2=3", "cf=21", "cf=0\nc0=1", "cf=0\nc0=x\nc1=1", "cf=0\nc0=1\nc1=0"]
)
def test_a_curve_of_imagej_is_refused(said: str, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((2, 8, 8), np.uint16), description=IMAGEJ.format(said), metadata=None)
    with pytest.raises(EndoctError, match="calibrated in a way that is not read"):
        open_stack(tmp_path / "a.tif")


@pytest.mark.parametrize("compression", [None, "packbits", "zlib"])
@pytest.mark.parametrize(("parts", "said"), [((1, 1), r"YCbCr;"), ((2, 2), r"YCbCr, one for 2 × 2 pixels;")])
def test_colours_as_ycbcr_are_refused_by_name(
    compression: str | None, parts: tuple[int, int], said: str, tmp_path: Path
) -> None:
    colours = np.random.default_rng(5).integers(0, 256, (16, 24, 3), dtype=np.uint8)
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, colours, photometric="ycbcr", compression=compression, metadata=None)
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags[530].overwrite(parts)
    with pytest.raises(EndoctError, match=said):
        open_stack(path)


def test_colours_of_a_jpeg_in_a_tiff_are_those_that_its_stream_has(tmp_path: Path) -> None:
    colour = np.full((16, 24, 3), (200, 40, 90), np.uint8)
    plain = imagecodecs.jpeg8_encode(colour)  # YCbCr
    adobe = plain[:2] + b"\xff\xee\0\x0eAdobe\0d\0\0\0\0\1" + plain[20:]
    as_rgb = imagecodecs.jpeg8_encode(colour, colorspace="RGB", outcolorspace="RGB")
    for stream in (plain, adobe, as_rgb):
        for meaning in (2, 6):
            path = tmp_path / "a.tif"
            with tifffile.TiffWriter(path) as writer:
                how: Any = {"shape": colour.shape, "dtype": np.uint8, "rowsperstrip": 16, "compression": "jpeg"}
                writer.write(iter([stream]), photometric="ycbcr", metadata=None, **how)
            with tifffile.TiffFile(path, mode="r+") as tiff:
                tiff.pages[0].tags[262].overwrite(meaning)
            assert np.abs(open_stack(path)[0].astype(int) - colour).max() <= 3
