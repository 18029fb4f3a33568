"""The frames of a DICOM file, read one at a time: numbers as stored, or pictures as they are meant to be seen.

Where their bytes lie is known before any is read: one frame behind the other, or in fragments of compressed ones.
"""

import os
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular
from endoct.modalities.dicom.decoding import READ, Stated, colours_after, decoded, decoder_of
from endoct.modalities.dicom.dicom_file import name_of, opened, read_elements, syntax_of

if TYPE_CHECKING:
    from pydicom import Dataset

SAMPLES, ITEM, END = 0x7FE0_0010, b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
UNDEFINED = 0xFFFF_FFFF
LONG = (b"OB", b"OW", b"UN", b"OF", b"OD", b"OL", b"OV")
"""The length of values of these kinds has four bytes."""
MOST_FRAGMENTS = 1_000_000
MOST_TABLE_BYTES = 8_000_000
BIG_ENDIAN, IMPLICIT = "1.2.840.10008.1.2.2", ("", "1.2.840.10008.1.2")
COPY = "copy it again"
Fragment = tuple[int, int]
"""A fragment is its start and length, in bytes of the file."""
LAYOUT = (
    "SOPClassUID", "Modality", "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "PhotometricInterpretation",
    "PlanarConfiguration", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation", "ExtendedOffsetTable",
    "RedPaletteColorLookupTableDescriptor", "GreenPaletteColorLookupTableDescriptor",
    "BluePaletteColorLookupTableDescriptor", "RedPaletteColorLookupTableData", "GreenPaletteColorLookupTableData",
    "BluePaletteColorLookupTableData",
)  # fmt: skip
"""Samples cannot be read without these elements."""
PLAIN = (*IMPLICIT, "1.2.840.10008.1.2.1", BIG_ENDIAN)
STREAMS = tuple(f"1.2.840.10008.1.2.4.{number}{end}" for number in range(100, 109) for end in ("", ".1"))
"""These transfer syntaxes are those of videos."""
GREY = ("MONOCHROME1", "MONOCHROME2")
COLOURS = ("RGB", "YBR_FULL", "YBR_FULL_422", "YBR_RCT", "YBR_ICT")
HALF_WIDTH = "YBR_FULL_422"
"""Where these colours are not compressed, two pixels share their two: Y Y Cb Cr."""
PALETTE = "PALETTE COLOR"
MOST_FRAMES = 1_000_000


@dataclass(frozen=True, eq=False)
class Places:
    """Where frames lie: ``starts`` and ``lengths`` of fragments; those from ``first[i]`` on are frame i's.

    Without ``first`` all fragments are one stream.
    """

    starts: Sequence[int]
    lengths: Sequence[int]
    first: Sequence[int] = ()

    @property
    def n_frames(self) -> int:
        """How many frames there are; -1 of a stream."""
        return len(self.first) - 1

    def of(self, index: int) -> list[Fragment]:
        """Return the fragments of a frame."""
        begin, end = self.first[index], self.first[index + 1]
        return list(zip(self.starts[begin:end], self.lengths[begin:end], strict=True))

    @property
    def every(self) -> list[Fragment]:
        """All fragments."""
        return list(zip(self.starts, self.lengths, strict=True))


def samples_at(file: BufferedReader, path: Path, encoding: tuple[bool | None, bool | None]) -> tuple[int, int]:
    """Return where the samples begin, whose element the file is at, and how many bytes they have, or ``UNDEFINED``.

    ``encoding``: whether kinds of values are implicit, and whether numbers are little endian. Raises
    :class:`EndoctError` where the file ends before them.
    """
    implicit, order = encoding[0], "little" if encoding[1] else "big"
    head = file.read(8)
    tag = int.from_bytes(head[:2], order) << 16 | int.from_bytes(head[2:4], order)  # type: ignore[arg-type]
    if len(head) < 8 or tag != SAMPLES:
        raise EndoctError(f"{path} holds no samples", found="a file that ends before them, or no image", remedy=COPY)
    long = not implicit and head[4:6] in LONG
    length = file.read(4) if long else head[4:8] if implicit else head[6:8]
    return file.tell(), int.from_bytes(length, order)  # type: ignore[arg-type]


def size_of(file: BufferedReader) -> int:
    """Return how many bytes an opened file has."""
    return os.fstat(file.fileno()).st_size


def places_of_plain(file: BufferedReader, path: Path, start: int, n_frames: int, frame_bytes: int) -> Places:
    """Return where uncompressed frames lie. Raises :class:`EndoctError` where the file ends before they do."""
    needed = start + n_frames * frame_bytes
    if size_of(file) < needed:
        raise EndoctError(f"{path} is cut off", found=f"{size_of(file)} bytes", expected=f"{needed}", remedy=COPY)
    starts = range(start, needed, frame_bytes)
    return Places(starts, [frame_bytes] * n_frames, range(n_frames + 1))


def places_of_fragments(file: BufferedReader, path: Path, start: int, header: "Dataset", n_frames: int) -> Places:
    """Return where the fragments of compressed frames lie. Raises :class:`EndoctError` where they are not all there."""
    starts, lengths = _fragments(file, path, start)
    n = len(starts) - 1
    if n < 1:
        raise EndoctError(f"{path} is cut off", found="no compressed frame", expected=f"{n_frames}", remedy=COPY)
    table = _table(file, header, starts[0], lengths[0])
    starts, lengths = starts[1:], lengths[1:]
    if n == n_frames:
        return Places(starts, lengths, range(n + 1))
    if n_frames == 1:
        return Places(starts, lengths, (0, n))
    if len(table) != n_frames:
        found = f"{n} fragments" + ("" if n < n_frames else ", which nothing assigns to frames")
        raise EndoctError(f"{path} is not whole", found=found, expected=f"{n_frames} frames", remedy=COPY)
    number = {place - starts[0]: k for k, place in enumerate(starts)}
    first = [number.get(offset, -1) for offset in table]
    if -1 in first or first[0] != 0 or sorted(set(first)) != first:
        raise EndoctError(f"{path} is damaged", found="a table of frames that leads nowhere", remedy=COPY)
    return Places(starts, lengths, (*first, n))


def places_of_stream(file: BufferedReader, path: Path, start: int) -> Places:
    """Return where the fragments of a video lie."""
    starts, lengths = _fragments(file, path, start)
    return Places(starts[1:], lengths[1:])


def _fragments(file: BufferedReader, path: Path, start: int) -> "tuple[array[int], array[int]]":
    """Return starts and lengths of all items, the table of offsets among them."""
    starts, lengths = array("q"), array("q")
    size, at = size_of(file), start
    while at + 8 <= size and len(starts) < MOST_FRAGMENTS:
        file.seek(at)
        head = file.read(8)
        if head[:4] == END:
            return starts, lengths
        length = int.from_bytes(head[4:], "little")
        if head[:4] != ITEM or at + 8 + length > size:
            break
        starts.append(at + 8)
        lengths.append(length)
        at += 8 + length
    if at != size:
        raise EndoctError(f"{path} is cut off or damaged", found=f"{len(starts)} whole fragments", remedy=COPY)
    return starts, lengths


def _table(file: BufferedReader, header: "Dataset", start: int, length: int) -> list[int]:
    """Return where frames begin, from the first fragment on, as a table says; none where there is none."""
    extended = header.get("ExtendedOffsetTable")
    if isinstance(extended, bytes) and len(extended) % 8 == 0 and len(extended) <= MOST_TABLE_BYTES:
        return [int(offset) for offset in np.frombuffer(extended, "<u8")]
    if length % 4 or length > MOST_TABLE_BYTES:
        return []
    file.seek(start)
    return [int(offset) for offset in np.frombuffer(file.read(length), "<u4")]


@dataclass(frozen=True, eq=False)
class DicomImage:
    """An opened file: its header up to the samples, and what reads frames, None where the samples are a video.

    ``stream``: where a video lies.
    """

    path: Path
    header: "Dataset"
    n_frames: int
    read: "ReadSamples | None"
    stream: Places | None = None


@dataclass(frozen=True, eq=False)
class ReadSamples:
    """Reads one frame's stored numbers, (row, column) or (row, column, sample); picklable, safe among threads.

    Integers of 8, 16 or 32 bits, without the bits that are not used. Colours of JPEG and JPEG 2000 are RGB:
    ``photometric`` is that of what is returned.
    """

    path: Path
    syntax: str
    stated: Stated
    places: Places
    stored: int
    high_bit: int
    signed: bool
    planar: bool
    palette: NDArray[Any] | None = field(default=None, repr=False)
    """Of every number that the bits which are used can be, (n, 3)."""

    @property
    def photometric(self) -> str:
        """Of the numbers that are returned."""
        after = colours_after(self.syntax, self.stated.photometric)
        return "YBR_FULL" if after == HALF_WIDTH else after

    def __len__(self) -> int:
        return self.places.n_frames

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame. Raises :class:`EndoctError` where it is damaged, or not there."""
        said = f"frame {index} of {self.path} cannot be read"
        with refusing(said, remedy=COPY), open_regular(self.path) as file:
            pieces = self.places.of(index)
            check_array_size((sum(length for _, length in pieces),), 1, f"a frame of {self.path}")
            check_array_size(self.stated.shape, 4, f"a frame of {self.path}")
            data = bytearray()
            for start, length in pieces:
                file.seek(start)
                data += file.read(length)
            if len(data) != sum(length for _, length in pieces):
                raise EndoctError(said, found="the file is cut off", remedy=COPY)
            if self.syntax in PLAIN:
                return self._numbers(self._plain(data))
            return self._numbers(decoded(self.syntax, bytes(data), self.stated, str(self.path)))

    def _plain(self, data: bytearray) -> NDArray[Any]:
        dtype = np.dtype(f"{'>' if self.syntax == BIG_ENDIAN else '<'}u{self.stated.bits // 8}")
        rows, columns, samples = self.stated.rows, self.stated.columns, self.stated.samples
        flat = np.frombuffer(data, dtype, plain_count(self.stated))
        if self.stated.photometric == HALF_WIDTH:
            pairs = flat.reshape(rows, columns // 2, 4)
            whole = pairs[:, :, [0, 2, 3, 1, 2, 3]]
            return whole.reshape(rows, columns, 3)
        if samples == 1:
            return flat.reshape(rows, columns)
        if self.planar:
            return np.moveaxis(flat.reshape(samples, rows, columns), 0, -1)
        return flat.reshape(rows, columns, samples)

    def _numbers(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Return the numbers in the bits that are used."""
        kind = np.dtype(f"u{max(samples.dtype.itemsize, 1)}")
        numbers = np.ascontiguousarray(samples).astype(kind, copy=False)
        shift = self.high_bit + 1 - self.stored if self.syntax in PLAIN else 0
        if shift or self.stored < 8 * kind.itemsize:
            numbers = (numbers >> shift) & kind.type((1 << self.stored) - 1)
        if not self.signed:
            return numbers
        wide = numbers.astype(np.int64)
        wide -= (wide >> (self.stored - 1)) << self.stored
        return wide.astype(f"i{kind.itemsize}")


def plain_count(stated: Stated) -> int:
    """Return how many numbers an uncompressed frame has."""
    pixels = stated.rows * stated.columns
    return 2 * pixels if stated.photometric == HALF_WIDTH else pixels * stated.samples


def open_image(path: Path, keywords: tuple[str, ...] = ()) -> DicomImage:
    """Open a DICOM file: its elements of ``keywords`` besides those of the layout, and where its frames lie.

    Raises :class:`EndoctError` where there are no frames, not all of them, or coded in a way that is not read.
    """
    with opened(path) as file:
        header = read_elements(file, path, (*LAYOUT, *keywords))
        syntax = syntax_of(header)
        start, length = samples_at(file, path, header.original_encoding)
        n_frames = int(header.get("NumberOfFrames") or 1)
        if not 0 < n_frames <= MOST_FRAMES:
            raise EndoctError(f"{path} holds no frames", found=f"{n_frames} by its header")
        if syntax in STREAMS:
            return DicomImage(path, header, n_frames, None, places_of_stream(file, path, start))
        stated, stored, high_bit = _stated(path, header, syntax)
        if syntax in PLAIN:
            if length == UNDEFINED:
                raise EndoctError(f"{path} cannot be read", found="samples of a length that is not known")
            frame_bytes = plain_count(stated) * stated.bits // 8
            places = places_of_plain(file, path, start, n_frames, frame_bytes)
        elif decoder_of(syntax) is None:
            raise EndoctError(
                f"{path} cannot be read",
                found=f"samples compressed as {name_of(syntax)}",
                expected=READ,
                remedy="export it uncompressed, or decompress it: gdcmconv --raw IN OUT",
            )
        else:
            places = places_of_fragments(file, path, start, header, n_frames)
        read = ReadSamples(
            path,
            syntax,
            stated,
            places,
            stored,
            high_bit,
            signed=stated.photometric in GREY and bool(int(header.get("PixelRepresentation") or 0)),
            planar=bool(int(header.get("PlanarConfiguration") or 0)),
            palette=_palette(header, stored) if stated.photometric == PALETTE else None,
        )
        return DicomImage(path, header, n_frames, read)


def _stated(path: Path, header: "Dataset", syntax: str) -> tuple[Stated, int, int]:
    """Return what the header says of frames, bits stored, and the highest of them."""
    photometric = str(header.get("PhotometricInterpretation") or "").strip()
    samples, bits = int(header.get("SamplesPerPixel") or 1), int(header.get("BitsAllocated") or 0)
    stated = Stated(int(header.get("Rows") or 0), int(header.get("Columns") or 0), samples, bits, photometric)
    stored = int(header.get("BitsStored") or bits)
    high_bit = int(header.get("HighBit") if header.get("HighBit") is not None else stored - 1)
    expected = {1: (*GREY, PALETTE), 3: COLOURS}.get(samples, ())
    if photometric not in expected or bits not in (8, 16, 32) or (samples == 3 and bits > 16):
        raise EndoctError(
            f"{path} cannot be read",
            found=f"{samples} samples a pixel of {bits} bits, '{photometric[:20]}'",
            expected=f"one sample ({', '.join((*GREY, PALETTE))}) or three ({', '.join(COLOURS)}) of 8, 16 or 32 bits",
            remedy="export it as uncompressed RGB or MONOCHROME2",
        )
    if not 1 <= stored <= high_bit + 1 <= bits or (photometric == PALETTE and stored > 16):
        raise EndoctError(f"{path} cannot be read", found=f"{stored} bits stored, up to {high_bit}, of {bits}")
    if min(stated.rows, stated.columns) < 1 or (photometric == HALF_WIDTH and syntax in PLAIN and stated.columns % 2):
        raise EndoctError(f"{path} cannot be read", found=f"frames of {stated.rows} × {stated.columns}")
    check_array_size(stated.shape, 4, f"a frame of {path}")
    return stated, stored, high_bit


def _palette(header: "Dataset", stored: int) -> NDArray[Any]:
    """Return the colours that numbers stand for, (n, 3), u8, or u16 where they need more bits."""
    from pydicom.pixels.processing import apply_color_lut

    colours = np.asarray(apply_color_lut(np.arange(1 << stored, dtype=np.uint16), header))
    if colours.dtype == np.uint16 and ((colours % 257 == 0).all() or (colours % 256 == 0).all()):
        colours = (colours >> 8).astype(np.uint8)
    return colours


def as_seen(numbers: NDArray[Any], read: ReadSamples) -> NDArray[Any]:
    """Return stored numbers as they are meant to be seen: 0 is black, colours are RGB, (row, column, 3)."""
    if read.palette is not None:
        return np.asarray(read.palette[numbers.astype(np.intp)])
    if read.photometric == "MONOCHROME1":
        top = numbers.dtype.type((1 << (read.stored - read.signed)) - 1)
        return top - numbers if not read.signed else -1 - numbers
    if read.photometric == "YBR_FULL":
        from pydicom.pixels.processing import convert_color_space

        if numbers.dtype != np.uint8:
            raise EndoctError(f"{read.path} cannot be read", found="YBR of more than 8 bits", remedy="export it as RGB")
        return np.asarray(convert_color_space(numbers, "YBR_FULL", "RGB"))
    return numbers
