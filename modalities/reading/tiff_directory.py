"""The directories of a TIFF or BigTIFF, read with bounds: how many, how large, and where the samples of a page lie.

Nothing of what a vendor adds to a TIFF is interpreted: no OME-XML, no sub-directories, no other files.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal, NoReturn

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.reading.orientation import TAG as ORIENTATION_TAG
from endoct.modalities.reading.orientation import UPRIGHT, checked

Order = Literal["<", ">"]
MOST_PAGES = 65_536
MOST_TAGS = 256
MOST_SEGMENTS = 131_072
"""A page may have this many strips or tiles."""
MOST_TABLE_BYTES = 65_536
"""The JPEG tables that the segments of a page share may have this many bytes."""
COMPRESSIONS = {1: "none", 5: "LZW", 7: "JPEG", 8: "Deflate", 32773: "PackBits", 32946: "Deflate", 50000: "Zstandard"}
JPEG = 7
FOREIGN = {33629: "MetaMorph", 34412: "LSM", 34118: "SEM"}
"""Files with these tags have frames that lie by rules of their own."""

WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, YCBCR = 0, 1, 2, 3, 6
_NOT_READ = {4: "a mask of transparency", 5: "CMYK", 8: "CIE L*a*b*", 9: "ICC L*a*b*", 10: "ITU L*a*b*", 32803: "CFA"}
"""These photometric interpretations are not read."""

STARTS: Mapping[bytes, tuple[Order, bool]] = {
    b"II*\0": ("<", False),
    b"MM\0*": (">", False),
    b"II+\0": ("<", True),
    b"MM\0+": (">", True),
}
_INTEGERS = {1: "u1", 3: "u2", 4: "u4", 16: "u8"}  # BYTE, SHORT, LONG, LONG8
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}


@dataclass(frozen=True)
class Layout:
    """What the frames of a recording have in common: ``shape`` (row, column) or (row, column, sample), and dtype.

    As stored. ``photometric``: what samples mean, as the tag has it; ``bits`` of a sample; ``orientation``;
    ``pixel_aspect``: how many times as wide as high a pixel is, by the resolution.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    photometric: int = BLACK_IS_ZERO
    bits: int = 8
    orientation: int = UPRIGHT
    pixel_aspect: float = field(default=1.0, compare=False)


@dataclass(frozen=True)
class Page:
    """One directory, at ``place``. ``tags``: code → (type, count, place of its values in the file)."""

    path: Path
    order: Order
    place: int
    next_place: int
    tags: Mapping[int, tuple[int, int, int]]

    def numbers(self, file: BinaryIO, tag: int, default: int | None = None, most: int = 16) -> tuple[int, ...]:
        """Return the whole numbers of a tag.

        Raises :class:`EndoctError` where there are none, or more than ``most``.
        """
        if tag not in self.tags:
            if default is None:
                damaged(self.path, f"a page without tag {tag}")
            return (default,)
        kind, count, place = self.tags[tag]
        if kind not in _INTEGERS or not 1 <= count <= most:
            damaged(self.path, f"{count} values of type {kind} in tag {tag}")
        dtype = np.dtype(self.order + _INTEGERS[kind])
        return tuple(np.frombuffer(taken(self.path, file, place, count * dtype.itemsize), dtype).tolist())

    def number(self, file: BinaryIO, tag: int, default: int | None = None) -> int:
        """Return the first number of a tag."""
        return self.numbers(file, tag, default)[0]

    def text(self, file: BinaryIO, tag: int, most: int) -> str:
        """Return the beginning of a text, at most ``most`` letters, empty where there is none."""
        kind, count, place = self.tags.get(tag, (0, 0, 0))
        return taken(self.path, file, place, min(count, most)).decode("latin-1") if kind in (1, 2, 7) else ""

    def layout(self, file: BinaryIO) -> Layout:
        """Return shape and dtype. Raises :class:`EndoctError` where they are no image's, or ask for much memory."""
        rows, columns, samples = (
            self.number(file, tag, default) for tag, default in ((257, None), (256, None), (277, 1))
        )
        bits = set(self.numbers(file, 258, 1, most=64))
        kind = set(self.numbers(file, 339, 1, most=64))
        if min(rows, columns, samples) < 1 or self.number(file, 32997, 1) != 1 or not 1 <= samples <= 64:
            damaged(self.path, f"pages of {rows} × {columns} × {samples} samples")
        if samples > 1 and self.number(file, 284, 1) != 1:
            raise EndoctError(
                f"{self.path} has the wrong dimensions",
                found="colours in planes of their own",
                expected="colours side by side",
                remedy="export the recording again",
            )
        dtype = _dtype(bits, kind)
        if dtype is None:
            damaged(self.path, f"samples of {sorted(bits)} bits, format {sorted(kind)}")
        shape = (rows, columns) if samples == 1 else (rows, columns, samples)
        check_array_size(shape, dtype.itemsize, f"a page of {self.path}")
        photometric = self.number(file, 262, BLACK_IS_ZERO if samples < 3 else RGB)
        self._check_meaning(photometric, samples, dtype)
        if photometric == YCBCR and self.number(file, 259, 1) != JPEG:
            parts = self.numbers(file, 530, 2)
            found = "colours as YCbCr" + (f", one for {' × '.join(map(str, parts))} pixels" if max(parts) > 1 else "")
            raise EndoctError(
                f"{self.path} is not read",
                found=found,
                remedy="give the video itself, or export RGB: ffmpeg -i VIDEO -pix_fmt rgb24 %05d.tiff",
            )
        orientation = checked(self.number(file, ORIENTATION_TAG, UPRIGHT))
        across, down = (self._ratio(file, tag) for tag in (282, 283))
        aspect = down / across if across and down else 1.0
        return Layout(shape, dtype, photometric, next(iter(bits)), orientation, aspect)

    def _ratio(self, file: BinaryIO, tag: int) -> float:
        """Return a number that is a ratio; 0 where there is none, or none that can be."""
        kind, count, place = self.tags.get(tag, (0, 0, 0))
        if (kind, count) != (5, 1):
            return 0.0
        above, below = np.frombuffer(taken(self.path, file, place, 8), self.order + "u4").tolist()
        return above / below if below else 0.0

    def _check_meaning(self, photometric: int, samples: int, dtype: np.dtype[Any]) -> None:
        remedy = "export it as grey or RGB, black as 0"
        if photometric in _NOT_READ:
            raise EndoctError(f"{self.path} is not read", found=f"colours as {_NOT_READ[photometric]}", remedy=remedy)
        if photometric == PALETTE and (samples != 1 or dtype not in (np.uint8, np.uint16, np.bool_)):
            damaged(self.path, f"a palette for pages of {samples} samples of {dtype}")
        if photometric == WHITE_IS_ZERO and (samples > 2 or dtype.kind not in "ub"):
            found = f"white is 0 (WhiteIsZero) in samples of {dtype}"
            raise EndoctError(f"{self.path} does not say which value is black", found=found, remedy=remedy)

    def plain_offset(self, file: BinaryIO, layout: Layout) -> int | None:
        """Return where the samples begin if they lie as they are in memory, one behind the other; else None."""
        bits = self.number(file, 258, 1)
        coded = self.number(file, 259, 1), self.number(file, 317, 1), self.number(file, 266, 1)
        if coded != (1, 1, 1) or 322 in self.tags or bits != 8 * layout.dtype.itemsize:
            return None
        offsets, counts = self.segments(file, layout)
        ends = [offset + count for offset, count in zip(offsets, counts, strict=True)]
        return offsets[0] if list(offsets[1:]) == ends[:-1] else None

    def segment_shape(self, file: BinaryIO, layout: Layout) -> tuple[int, int]:
        """Return (rows, columns) of every tile, or of every strip but the last, which may have fewer rows."""
        rows, columns = layout.shape[:2]
        if 322 in self.tags:
            tile = self.number(file, 323), self.number(file, 322)
            if min(tile) < 1:
                damaged(self.path, f"tiles of {tile[0]} × {tile[1]}")
            check_array_size((*tile, *layout.shape[2:]), layout.dtype.itemsize, f"a tile of {self.path}")
            return tile
        return max(1, min(self.number(file, 278, rows), rows)), columns

    def segments(self, file: BinaryIO, layout: Layout) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return offsets and byte counts of the strips or tiles. Raises :class:`EndoctError` where they cannot be."""
        rows, columns = layout.shape[:2]
        high, wide = self.segment_shape(file, layout)
        needed = math.ceil(rows / high) * math.ceil(columns / wide)
        tags = (324, 325) if 322 in self.tags else (273, 279)
        if needed > MOST_SEGMENTS:
            damaged(self.path, f"{needed} strips or tiles in a page")
        offsets = self.numbers(file, tags[0], most=MOST_SEGMENTS)
        whole = layout.dtype.itemsize * math.prod(layout.shape)
        counts = self.numbers(file, tags[1], whole if needed == 1 else None, most=MOST_SEGMENTS)
        if not len(offsets) == len(counts) == needed:
            damaged(self.path, f"{len(offsets)} strips or tiles with {len(counts)} sizes in a page of {needed}")
        size = size_of(file)
        end = max(offset + count for offset, count in zip(offsets, counts, strict=True))
        if end > size:
            truncated(self.path, size, end)
        if min(counts) < 1 or sum(counts) > size:
            damaged(self.path, "strips or tiles that are empty or overlap")
        return offsets, counts


def pages(path: Path, file: BinaryIO) -> Iterator[Page]:
    """Yield the directories of a TIFF in their order. Raises :class:`EndoctError` for a chain that does not end."""
    place, seen = _form(path, file)[2], set[int]()
    while place:
        if place in seen or len(seen) >= MOST_PAGES:
            damaged(path, "directories in a circle" if place in seen else f"more than {MOST_PAGES} pages")
        seen.add(place)
        page = page_at(path, file, place)
        yield page
        place = page.next_place
    if not seen:
        damaged(path, "no page")


def page_at(path: Path, file: BinaryIO, place: int) -> Page:
    """Return the directory at ``place``. Raises :class:`EndoctError` where there is none."""
    order, big, _ = _form(path, file)
    head, entry, width = (8, 20, 8) if big else (2, 12, 4)
    first = place + head
    n_tags = _number(path, file, place, f"{order}u{head}")
    if not 1 <= n_tags <= MOST_TAGS:
        damaged(path, f"a page with {n_tags} tags")
    data = taken(path, file, first, n_tags * entry)
    fields = np.dtype(f"{order}u2,{order}u2,{order}u{width},{order}u{width}")
    tags: dict[int, tuple[int, int, int]] = {}
    for k, (tag, kind, count, value) in enumerate(np.frombuffer(data, fields, n_tags).tolist()):
        inside = _SIZES.get(kind, 1) * count <= width
        tags.setdefault(tag, (kind, count, first + (k + 1) * entry - width if inside else value))
    return Page(path, order, place, _number(path, file, first + n_tags * entry, f"{order}u{width}"), tags)


def _form(path: Path, file: BinaryIO) -> tuple[Order, bool, int]:
    """Return how numbers are written in a TIFF, whether it is a BigTIFF, and where its first directory lies."""
    start = taken(path, file, 0, 4)
    if start not in STARTS:
        raise EndoctError(f"{path} is no readable TIFF", remedy="copy or export it again")
    order, big = STARTS[start]
    return order, big, _number(path, file, 8 if big else 4, f"{order}u{8 if big else 4}")


def _number(path: Path, file: BinaryIO, place: int, dtype: str) -> int:
    return int(np.frombuffer(taken(path, file, place, np.dtype(dtype).itemsize), dtype)[0])


def taken(path: Path, file: BinaryIO, place: int, count: int) -> bytes:
    """Return ``count`` bytes at ``place``. Raises :class:`EndoctError` where the file ends before them."""
    size = size_of(file)
    if place + count > size:
        truncated(path, size, place + count)
    file.seek(place)
    return file.read(count)


def size_of(file: BinaryIO) -> int:
    """Return the size of an open file."""
    return os.fstat(file.fileno()).st_size


def damaged(path: Path, reason: str) -> NoReturn:
    """Raise :class:`EndoctError` for a directory that cannot be."""
    raise EndoctError(f"{path} is damaged, or no TIFF of images", found=reason, remedy="copy or export it again")


def truncated(path: Path, size: int, needed: int) -> NoReturn:
    """Raise :class:`EndoctError` for a file that is shorter than its own content says."""
    raise EndoctError(
        f"{path} is damaged or truncated", found=f"{size} bytes", expected=f"{needed}", remedy="copy or export it again"
    )


def _dtype(bits: set[int], kind: set[int]) -> np.dtype[Any] | None:
    if len(bits) != 1 or len(kind) != 1:
        return None
    n, letter = next(iter(bits)), {1: "u", 2: "i", 3: "f", 4: "u"}.get(next(iter(kind)))
    if letter is None or not 1 <= n <= 64 or (letter == "f" and n not in (16, 32, 64)):
        return None
    if n == 1:
        return np.dtype(np.bool_)
    return np.dtype(f"{letter}{next(size for size in (1, 2, 4, 8) if n <= 8 * size)}")
