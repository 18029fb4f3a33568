"""A page of a TIFF: where it lies as it is in memory, or decoded by tifffile, alone and checked before."""

import io
import logging
import re
import struct
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular
from endoct.modalities.dicom.decoding import check_scans, stream_of
from endoct.modalities.reading.arrays_on_disk import ReadBlocks
from endoct.modalities.reading.tiff_directory import (
    COMPRESSIONS,
    JPEG,
    MOST_TABLE_BYTES,
    RGB,
    YCBCR,
    Layout,
    Page,
    page_at,
    taken,
)

COPIES = 2
"""Decoding holds at most this many times the page: the page and a copy in another byte order."""
_ADOBE_YCBCR = re.compile(rb"\xff\xee..Adobe.{6}\x01", re.DOTALL)
"""This in a JPEG says that its colours are YCbCr."""
DECODING_TAGS = (256, 257, 258, 259, 262, 266, 277, 278, 284, 317, 322, 323, 338, 339, 530)

# What is wrong with a file is said once, by an EndoctError, not also by the library that reads it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


@dataclass(frozen=True, eq=False)
class ReadPages:
    """Reads one page a frame, of those at ``places``; picklable."""

    path: Path
    places: "array[int]"
    layout: Layout

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame as it is stored. Raises :class:`EndoctError` where it is damaged."""
        layout = self.layout
        said = f"page {index} of {self.path} cannot be read"
        with refusing(said, remedy="copy or export it again"), open_regular(self.path) as file:
            page = page_at(self.path, file, self.places[index])
            if page.layout(file) != layout:
                raise EndoctError(said, found="another kind of page than when it was opened")
            offset = page.plain_offset(file, layout)
            if offset is not None:
                return ReadBlocks(self.path, offset, layout.dtype.newbyteorder(page.order), layout.shape)(0)
            check_array_size((COPIES, *layout.shape), layout.dtype.itemsize, f"a page of {self.path}")
            with tifffile.TiffFile(io.BytesIO(_alone(page, file, layout))) as tiff:
                frame = np.asarray(tiff.pages[0].asarray())
        if frame.shape != layout.shape or frame.dtype.newbyteorder("=") != layout.dtype:
            raise EndoctError(said, found=f"{frame.dtype} {frame.shape}", expected=f"{layout.dtype} {layout.shape}")
        return frame


def _alone(page: Page, file: BinaryIO, layout: Layout) -> bytes:
    """Return a page as a BigTIFF of its own: what its decoding takes, and its compressed samples.

    So the library that decodes sees nothing else of the file, and nothing that was not checked.
    """
    compression = page.number(file, 259, 1)
    if compression not in COMPRESSIONS:
        raise EndoctError(
            f"{page.path} is compressed in a way that is not read",
            found=f"compression {compression}",
            expected=", ".join(dict.fromkeys(COMPRESSIONS.values())),
            remedy="export it again without compression",
        )
    offsets, counts = page.segments(file, layout)
    check_array_size((sum(counts),), 1, f"a page of {page.path}")
    segments = [taken(page.path, file, *segment) for segment in zip(offsets, counts, strict=True)]
    tables = b""
    if compression == JPEG:
        if 347 in page.tags:
            _, count, place = page.tags[347]
            tables = taken(page.path, file, place, min(count, MOST_TABLE_BYTES))
        for segment in segments:
            _check_jpeg(segment, (*page.segment_shape(file, layout), *layout.shape[2:]), page.path)
    tags = {tag: page.numbers(file, tag, most=64) for tag in DECODING_TAGS if tag in page.tags}
    if layout.photometric == RGB and any(_ADOBE_YCBCR.search(segment[:MOST_TABLE_BYTES]) for segment in segments):
        tags[262] = (YCBCR,)  # the stream knows better
    word = f"{page.order}u8"
    places, sizes = (324, 325) if 322 in page.tags else (273, 279)
    values = {tag: np.array(of, word).tobytes() for tag, of in (tags | {sizes: counts}).items()}
    if tables:
        values[347] = tables
    behind = 24 + 20 * (len(values) + 1) + 8
    begin = behind + sum(map(len, values.values())) + 8 * len(counts)
    values[places] = np.cumsum([begin, *counts])[:-1].astype(word).tobytes()
    head = struct.pack(page.order + "2sHHHQQ", b"II" if page.order == "<" else b"MM", 43, 8, 0, 16, len(values))
    entries, data = b"", b""
    for tag, value in sorted(values.items()):
        kind, count = (7, len(value)) if tag == 347 else (16, len(value) // 8)
        within = value.ljust(8, b"\0") if len(value) <= 8 else struct.pack(page.order + "Q", behind + len(data))
        entries += struct.pack(page.order + "HHQ", tag, kind, count) + within
        data += value
    return b"".join([head, entries, bytes(8), data, *segments])


def _check_jpeg(data: bytes, shape: tuple[int, ...], path: Path) -> None:
    """Raise :class:`EndoctError` where a JPEG is larger than ``shape``, (row, column, …), or coded in many scans."""
    stream = stream_of(data)
    if stream is None or stream.shape[1:] != shape[1:] or stream.shape[0] > shape[0]:
        found = "no JPEG" if stream is None else f"a JPEG of {' × '.join(map(str, stream.shape))}"
        expected = " × ".join(map(str, shape))
        raise EndoctError(f"a page of {path} is damaged", found=found, expected=expected)
    check_scans(data)
