"""Compressed pictures of DICOM: JPEG, JPEG-LS, JPEG 2000 and RLE, decoded by imagecodecs once their size is known.

What a stream says of itself is asked before what the header says (PS3.5 A.4 has both agree; many files do not). Why
not pydicom's decoders? Of what is installed they use Pillow, which reads no lossless JPEG and no JPEG-LS, and for RLE a
loop in Python. They bring JPEG 2000 to the sign of the header, whatever the stream says.
"""

import struct
from dataclasses import dataclass, field
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

_SYNTAX = "1.2.840.10008.1.2"
RLE = f"{_SYNTAX}.5"
COMPRESSED = frozenset((RLE, *(f"{_SYNTAX}.4.{number}" for number in (50, 51, 57, 70, 80, 81, 90, 91))))
READ = "uncompressed DICOM, RLE, JPEG, JPEG-LS or JPEG 2000"
MOST_SCANS = 50
"""A progressive JPEG may have this many scans; usual ones have 10. Each goes over the whole image."""
CODESTREAM, BOXES = b"\xff\x4f\xff\x51", b"\0\0\0\x0cjP  "
"""JPEG 2000 begins as the first; in boxes, as it should not be in DICOM, as the second."""
_LOSSLESS = (0xC3, 0xC7, 0xCB, 0xCF)
_JPEG_LS = 0xF7
_FRAMES_OF_JPEG = frozenset({*range(0xC0, 0xD0), _JPEG_LS}) - {0xC4, 0xC8, 0xCC}
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
        return _shape(self.rows, self.columns, self.samples)


def _shape(rows: int, columns: int, samples: int) -> tuple[int, ...]:
    return (rows, columns) if samples == 1 else (rows, columns, samples)


@dataclass(frozen=True)
class Stream:
    """What a picture says of itself: its ``shape``, ``bits`` of a sample, ``signed`` where its coding knows signs.

    ``colours``: "RGB" (of JPEG 2000: they become RGB as it is decoded), "YBR", or "" where it does not say. ``lossy``:
    whether numbers may have changed. ``codec``: what decodes it; "jpeg8" is a lossy JPEG of three colours in 8 bits.
    """

    shape: tuple[int, ...]
    bits: int
    signed: bool | None
    colours: str
    codec: str
    lossy: bool = field(compare=False)


def stream_of(picture: bytes) -> Stream | None:
    """Return what a picture says of itself, None where it is neither JPEG, JPEG-LS nor JPEG 2000, or cut off."""
    try:
        if picture.startswith((CODESTREAM, BOXES)):
            return _of_jpeg_2000(picture, picture.index(CODESTREAM))
        return _of_jpeg(picture)
    except (struct.error, IndexError, ValueError):
        return None


def _of_jpeg_2000(picture: bytes, at: int) -> Stream:
    right, bottom, left, top = struct.unpack_from(">4I", picture, at + 8)
    samples, size = int.from_bytes(picture[at + 40 : at + 42], "big"), picture[at + 42]
    at += 4 + int.from_bytes(picture[at + 4 : at + 6], "big")
    while picture[at + 1] != 0x52:  # the marker of how it is coded
        at += 2 + struct.unpack_from(">H", picture, at + 2)[0]
    colours, lossy = "RGB" if picture[at + 8] else "", picture[at + 13] == 0
    shape = _shape(bottom - top, right - left, samples)
    return Stream(shape, (size & 0x7F) + 1, size > 0x7F, colours, "jpeg2k", lossy)


def _of_jpeg(picture: bytes) -> Stream | None:
    at, colours = 2, ""
    while picture.startswith(b"\xff\xd8") and picture[at] == 0xFF:
        marker, (length,) = picture[at + 1], struct.unpack_from(">H", picture, at + 2)
        content = picture[at + 4 : at + 2 + length]
        if marker == 0xE0 and content.startswith(b"JFIF"):
            colours = "YBR"
        elif marker == 0xEE and content.startswith(b"Adobe") and not colours:
            colours = {0: "RGB", 1: "YBR"}.get(content[11], "")
        elif marker in _FRAMES_OF_JPEG:
            bits, rows, columns, samples = struct.unpack_from(">BHHB", content)
            if content[6::3].upper() == b"RGB":
                colours = "RGB"
            elif not colours and len({*content[7::3]}) > 1:  # only YBR has fewer samples of some
                colours = "YBR"
            lossy = marker not in _LOSSLESS
            if marker == _JPEG_LS:  # by how much numbers may be off stands behind the list of what a scan holds
                scan = picture.index(b"\xff\xda", at)
                lossy = picture[scan + 5 + 2 * picture[scan + 4]] > 0
            codec = "jpegls" if marker == _JPEG_LS else "jpeg8" if samples == 3 and lossy and bits == 8 else "jpeg"
            return Stream(_shape(rows, columns, samples), bits, None, colours if samples == 3 else "", codec, lossy)
        at += 1 if marker == 0xFF else 2 + length
    return None


def decoded(picture: bytes, stream: Stream, *, in_ybr: bool) -> NDArray[Any]:
    """Return a picture as an array (row, column) or (row, column, sample); colours of "jpeg8" are RGB.

    A damaged one raises what imagecodecs raises.
    """
    if stream.codec == "jpeg2k":
        return np.asarray(imagecodecs.jpeg2k_decode(picture))
    if stream.codec == "jpegls":
        return np.asarray(imagecodecs.jpegls_decode(picture))
    check_scans(picture)
    if stream.codec == "jpeg":
        return np.asarray(imagecodecs.jpeg_decode(picture))
    colours = "YCBCR" if in_ybr else "RGB"
    return np.asarray(imagecodecs.jpeg8_decode(picture, colorspace=colours, outcolorspace="RGB"))


def check_scans(picture: bytes) -> None:
    """Raise ``ValueError`` where a JPEG is coded in very many scans."""
    if picture.count(b"\xff\xda") > MOST_SCANS:
        raise ValueError(f"a JPEG in more than {MOST_SCANS} scans")


def decoded_rle(picture: bytes, stated: Stated) -> NDArray[Any]:
    """Return a picture of RLE; raises what imagecodecs does, and ``ValueError`` for other planes than stated."""
    dtype = np.dtype(f"<u{stated.bits // 8}")
    planes, expected = int.from_bytes(picture[:4], "little"), stated.samples * dtype.itemsize
    if planes != expected:
        raise ValueError(f"{planes} planes of bytes where the header has {expected}")
    room = bytearray(stated.rows * stated.columns * expected)
    count = len(imagecodecs.dicomrle_decode(picture, dtype, out=room))
    if count != len(room):
        raise ValueError(f"{count} bytes where the header has {len(room)}")
    samples = np.frombuffer(room, dtype).reshape(stated.samples, stated.rows, stated.columns)
    return samples[0] if stated.samples == 1 else np.ascontiguousarray(np.moveaxis(samples, 0, -1))
