"""Compressed pictures of DICOM: JPEG, JPEG-LS, JPEG 2000 and RLE, decoded by imagecodecs once their size is known."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError

_SYNTAX = "1.2.840.10008.1.2"
RLE = frozenset({f"{_SYNTAX}.5"})
JPEG = frozenset(f"{_SYNTAX}.4.{number}" for number in (50, 51))
JPEG_LOSSLESS = frozenset(f"{_SYNTAX}.4.{number}" for number in (57, 70))
JPEG_LS = frozenset(f"{_SYNTAX}.4.{number}" for number in (80, 81))
JPEG_2000 = frozenset(f"{_SYNTAX}.4.{number}" for number in (90, 91))
READ = "uncompressed DICOM, RLE, JPEG, JPEG-LS or JPEG 2000"
MOST_SCANS = 50
"""A progressive JPEG may have this many scans; usual ones have 10. Each goes over the whole image."""
_FRAMES_OF_JPEG = frozenset({*range(0xC0, 0xD0), 0xF7}) - {0xC4, 0xC8, 0xCC}
"""Segments with these markers state the size of a picture, JPEG-LS's included."""


@dataclass(frozen=True)
class Stated:
    """What a header says of each frame: ``rows`` × ``columns`` of ``samples``, each in ``bits``; ``photometric``."""

    rows: int
    columns: int
    samples: int = 1
    bits: int = 16
    photometric: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a frame as an array: (row, column), or (row, column, sample)."""
        return (self.rows, self.columns) if self.samples == 1 else (self.rows, self.columns, self.samples)


def decoder_of(syntax: str) -> Callable[[bytes, Stated], NDArray[Any]] | None:
    """Return what decodes one picture of a transfer syntax; None where that is not read."""
    return next((decode for syntaxes, decode in _DECODERS if syntax in syntaxes), None)


def decoded(syntax: str, picture: bytes, stated: Stated, place: str) -> NDArray[Any]:
    """Return a compressed picture, which lies at ``place``, (row, column) or (row, column, sample), in stored numbers.

    Raises :class:`EndoctError` for one of another size than ``stated``, for a damaged one what imagecodecs raises.
    """
    decode = decoder_of(syntax)
    if decode is None:
        raise EndoctError(f"{place} cannot be read", found=f"pictures compressed as {syntax}", expected=READ)
    size = (stated.rows, stated.columns) if syntax in RLE else _size(picture)
    numbers = decode(picture, stated) if size == (stated.rows, stated.columns) else None
    if numbers is None or numbers.shape != stated.shape:
        found = size if numbers is None else numbers.shape
        raise EndoctError(
            f"{place} has other pictures in it than it says", found=f"{found}", expected=f"{stated.shape}"
        )
    return numbers


def colours_after(syntax: str, photometric: str) -> str:
    """Return which colours a decoded picture has: those of JPEG and JPEG 2000 are decoded to RGB."""
    by_decoder = photometric.startswith("YBR") if syntax in JPEG else photometric in ("YBR_RCT", "YBR_ICT")
    return "RGB" if by_decoder else photometric


def _size(picture: bytes) -> tuple[int, int]:
    """Return rows and columns that a compressed picture says it has, (0, 0) where it does not."""
    if picture[:4] == b"\xff\x4f\xff\x51":  # JPEG 2000, whose second segment has the size
        right, bottom, left, top = struct.unpack_from(">4I", picture, 8)
        return int(bottom - top), int(right - left)
    at = 2
    while at + 9 <= len(picture) and picture[at] == 0xFF:
        marker, length = picture[at + 1], int.from_bytes(picture[at + 2 : at + 4], "big")
        if marker in _FRAMES_OF_JPEG:
            rows, columns = struct.unpack_from(">2H", picture, at + 5)
            return int(rows), int(columns)
        at += 1 if marker == 0xFF else 2 + length
    return 0, 0


def _jpeg(picture: bytes, stated: Stated) -> NDArray[Any]:
    if picture.count(b"\xff\xda") > MOST_SCANS:
        raise ValueError(f"a JPEG in more than {MOST_SCANS} scans")
    if stated.samples == 1:
        return np.asarray(imagecodecs.jpeg_decode(picture))
    stored = "YCBCR" if stated.photometric.startswith("YBR") else "RGB"
    return np.asarray(imagecodecs.jpeg8_decode(picture, colorspace=stored, outcolorspace="RGB"))


def _rle(picture: bytes, stated: Stated) -> NDArray[Any]:
    dtype = np.dtype(f"<u{stated.bits // 8}")
    room = bytearray(stated.rows * stated.columns * stated.samples * dtype.itemsize)
    imagecodecs.dicomrle_decode(picture, dtype, out=room)
    planes = np.frombuffer(room, dtype).reshape(stated.samples, stated.rows, stated.columns)
    return planes[0] if stated.samples == 1 else np.ascontiguousarray(np.moveaxis(planes, 0, -1))


_DECODERS: tuple[tuple[frozenset[str], Callable[[bytes, Stated], NDArray[Any]]], ...] = (
    (RLE, _rle),
    (JPEG, _jpeg),
    (JPEG_LOSSLESS, lambda picture, _: np.asarray(imagecodecs.jpeg_decode(picture))),
    (JPEG_LS, lambda picture, _: np.asarray(imagecodecs.jpegls_decode(picture))),
    (JPEG_2000, lambda picture, _: np.asarray(imagecodecs.jpeg2k_decode(picture))),
)
