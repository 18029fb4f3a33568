"""Images of a file each, TIFF among them: of a PNG, JPEG or BMP the size is checked before it is decoded."""

import io
import logging
import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular
from endoct.modalities.dicom.decoding import check_scans
from endoct.modalities.reading.orientation import UPRIGHT, on_orientation, orientation_in_exif, upright
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.reading.tiff import is_tiff, read_tiff

# What is wrong with a file is said once, by an EndoctError, not also by the library that reads it.
logging.getLogger("imagecodecs").addHandler(logging.NullHandler())

COPIES = 2
"""Decoding holds at most this many times the image: the image and one copy."""
CHANNELS = {0: 1, 2: 3, 3: 4, 4: 2, 6: 4}
"""The number of channels follows from a PNG's type of colour."""
_PNG, _JPEG, _BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM"
_PICTURE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")


class ReadImages:
    """Reads one file a frame, all of them stored in the same orientation.

    ``remarks`` and ``pixel_aspect`` are those of the first of them, once it was read.
    """

    def __init__(self, files: tuple[Path, ...]) -> None:
        self.files = files
        self._orientation = UPRIGHT
        self.remarks, self.pixel_aspect = NONE, 1.0

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one image, upright."""
        frame, orientation, pixel_aspect, remarks = read_single(self.files[index])
        if not index:
            self._orientation, self.pixel_aspect, self.remarks = orientation, pixel_aspect, remarks
        if orientation != self._orientation:
            raise EndoctError(
                f"{self.files[index]} is stored in another orientation than the first image",
                found=f"orientation {orientation}",
                expected=f"{self._orientation}, as {self.files[0].name} has",
                remedy="save all images upright, without that tag",
            )
        return frame


def read_single(path: Path) -> tuple[NDArray[Any], int, float, Remarks]:
    """Return the image in a file that holds one, its orientation, the aspect of its pixels, and what is to be said.

    Raises :class:`EndoctError` where it holds several, or none.
    """
    if not is_tiff(path):
        image, orientation, pixel_aspect = _read_image(path)
        return image, orientation, pixel_aspect, on_orientation(orientation)
    n_pages, read = read_tiff(path)
    if n_pages > 1:
        raise EndoctError(
            f"{path} is one of several images of a recording",
            found=f"{n_pages} pages",
            expected="1",
            remedy="keep each recording in a folder of its own",
        )
    return read(0), read.layout.orientation, read.pixel_aspect, read.remarks


def _read_image(path: Path) -> tuple[NDArray[Any], int, float]:
    """Return the image in a file, upright, the orientation in which it is stored, and the aspect of a pixel as stored.

    u8 or u16, (row, column) or (row, column, channel): RGB, or grey or RGB with transparency last. Raises
    :class:`EndoctError` where the file is none, is damaged, or asks for too much memory. The aspect is how many times
    as wide as high a pixel is, by the header.
    """
    said = f"{path} is no readable image"
    expected, remedy = "PNG, JPEG, BMP or TIFF", "copy or export the file again"
    with refusing(said, expected=expected, remedy=remedy):
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            check_array_size((size,), 1, f"{path}")
            data = file.read(size)
        for start, of in ((_PNG, _png), (_JPEG, _jpeg), (_BMP, _bmp)):
            if data.startswith(start):
                image, orientation, aspect = of(data, path)
                return upright(image, orientation), orientation, aspect
        raise EndoctError(said, found=f"{len(data)} bytes", expected=expected, remedy=remedy)


def _aspect(across: int, down: int) -> float:
    """Return the aspect of pixels of which there are so many in a length; 1 where that is not said."""
    return down / across if across and down else 1.0


def _png(data: bytes, path: Path) -> tuple[NDArray[Any], int, float]:
    chunks = list(_chunks(data))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != 25 or chunks[-1][0] != b"IEND":
        raise EndoctError(f"{path} is damaged or truncated", found="a PNG without its first or last part")
    columns, rows, bits, colour = struct.unpack(">IIBB", chunks[0][1][8:18])
    _check(rows, columns, CHANNELS.get(colour, 4), 2 if bits == 16 else 1, path)
    # texts, profiles and animations are of no use, and may be large when they are unpacked
    image = imagecodecs.png_decode(_PNG + b"".join(part for kind, part in chunks if kind in _PICTURE))
    exif = next((part[8:-4] for kind, part in chunks if kind == b"eXIf"), b"")
    sizes = next((part[8:16] for kind, part in chunks if kind == b"pHYs" and len(part) == 21), bytes(8))
    return np.asarray(image), orientation_in_exif(exif), _aspect(*struct.unpack(">II", sizes))


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and whole of every chunk of a PNG. Raises ``ValueError`` where one is damaged."""
    place = len(_PNG)
    while place < len(data):
        length = int.from_bytes(data[place : place + 4], "big")
        chunk = data[place : place + 12 + length]
        if len(chunk) < 12 + length or len(chunk) < 12:
            raise ValueError("the file ends within a part of the image")
        if zlib.crc32(memoryview(chunk)[4:-4]) != int.from_bytes(chunk[-4:], "big"):
            raise ValueError("its check sums differ")
        yield chunk[4:8], chunk
        if chunk[4:8] == b"IEND":
            return
        place += 12 + length


def _jpeg(data: bytes, path: Path) -> tuple[NDArray[Any], int, float]:
    from PIL import JpegImagePlugin  # here and below: a plug-in's manifest names suffixes without loading these

    with JpegImagePlugin.JpegImageFile(io.BytesIO(data)) as image:
        columns, rows = image.size
        channels, said = len(image.getbands()), image.info
    if channels not in (1, 3):
        raise ValueError(f"a JPEG of {channels} colours")
    if "progressive" in said:  # others have three scans at most
        check_scans(data)
    _check(rows, columns, channels, 1, path)
    if data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda"):  # cameras write more behind it: previews, depths, films
        raise EndoctError(f"{path} is damaged or truncated", found="a JPEG without its end")
    aspect = _aspect(*said.get("jfif_density", (1, 1)))
    return np.asarray(imagecodecs.jpeg8_decode(data)), orientation_in_exif(said.get("exif", b"")), aspect


def _bmp(data: bytes, path: Path) -> tuple[NDArray[Any], int, float]:
    from PIL import BmpImagePlugin

    with BmpImagePlugin.BmpImageFile(io.BytesIO(data)) as image:
        columns, rows = image.size
    _check(rows, columns, 4, 1, path)

    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None or decoded.shape[:2] != (rows, columns):
        raise ValueError(f"{len(data)} bytes")
    if decoded.ndim == 3:
        decoded = cv2.cvtColor(decoded, cv2.COLOR_BGRA2RGB if decoded.shape[2] == 4 else cv2.COLOR_BGR2RGB)
    return np.asarray(decoded), UPRIGHT, 1.0


def _check(rows: int, columns: int, channels: int, itemsize: int, path: Path) -> None:
    if min(rows, columns) < 1:
        raise EndoctError(f"{path} is no readable image", found=f"{rows} × {columns} pixels")
    check_array_size((COPIES, rows, columns, channels), itemsize, f"{path}")
