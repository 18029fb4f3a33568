"""One frame of a DICOM file: its numbers as stored, or a picture as it is meant to be seen.

CTs and recordings are read by this alone. Uncompressed frames are taken from the file by pydicom; which bits of words
are numbers it does not ask (HighBit). Compressed ones lie in fragments, and tables say which of these are one frame.

Why not pydicom's ``encaps``? It takes a file that is cut off for whole, takes any number of fragments, guesses where
frames end by two bytes that may stand anywhere, and goes through all fragments again for each frame.
"""

import os
from array import array
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.dicom.decoding import CODESTREAM

if TYPE_CHECKING:
    from pydicom import Dataset
from dataclasses import field
from typing import Any

from endoct.base.errors import refusing
from endoct.base.files.files import open_regular
from endoct.modalities.dicom.decoding import Stated, Stream, decoded, decoded_rle, stream_of

ITEM, END = b"\xfe\xff\x00\xe0", b"\xfe\xff\xdd\xe0"
MOST_TABLE_BYTES = 8_000_000
MOST_FRAMES = 1_000_000
COPY = "copy it again"
STARTS = (b"\xff\xd8\xff", CODESTREAM[:3])


@dataclass(frozen=True, eq=False)
class FragmentPlaces:
    """Where compressed frames lie: ``pieces`` (n, 2), start and length in bytes; frame i has ``first[i]`` and on."""

    pieces: NDArray[np.int64]
    first: NDArray[np.int64]

    def joined(self, file: BufferedReader, index: int, name: str) -> bytes:
        """Return the bytes of a frame. Raises ``ValueError`` where the file, called ``name``, ends before they do."""
        pieces = self.pieces[self.first[index] : self.first[index + 1]].tolist()
        total = sum(length for _, length in pieces)
        check_array_size((total,), 1, f"a frame of {name}")
        data = bytearray()
        for start, length in pieces:
            file.seek(start)
            data += file.read(length)
        if len(data) != total:
            raise ValueError("a file that is cut off")
        return bytes(data)


def places_of(file: BufferedReader, path: Path, start: int, header: "Dataset", n_frames: int) -> FragmentPlaces:
    """Return where compressed frames lie. Raises :class:`EndoctError` where they are not all there."""
    table, pieces = np.split(fragments_of(file, path, start), [1])
    n = len(pieces)
    offsets = _table(file, header, *table[0].tolist()) if n else np.empty(0, np.int64)
    if n == n_frames or (
        n_frames == 1 and n and len(offsets) < 2 and not any(_begins(file, at) for at in pieces[1:, 0].tolist())
    ):
        return FragmentPlaces(pieces, np.linspace(0, n, n_frames + 1, dtype=np.int64))
    if len(offsets) != n_frames:
        found = f"{n} fragments" + ("" if n < n_frames else ", which nothing assigns to frames")
        raise EndoctError(f"{path} is not whole", found=found, expected=f"{n_frames} frames", remedy=COPY)
    first = np.searchsorted(pieces[:, 0] - pieces[0, 0], offsets)
    if (
        first[0] != 0
        or first[-1] >= n
        or (np.diff(first) < 1).any()
        or (pieces[first, 0] - pieces[0, 0] != offsets).any()
    ):
        raise EndoctError(f"{path} is damaged", found="a table of frames that leads nowhere", remedy=COPY)
    return FragmentPlaces(pieces, np.append(first, n))


def _begins(file: BufferedReader, at: int) -> bool:
    """Say whether a JPEG, or JPEG 2000, begins at a place."""
    file.seek(at)
    return file.read(3) in STARTS


def fragments_of(file: BufferedReader, path: Path, start: int) -> NDArray[np.int64]:
    """Return all items (n, 2), start and length in bytes, the table of offsets first."""
    found = array("q")
    size, at = os.fstat(file.fileno()).st_size, start
    while at + 8 <= size and len(found) < 2 * MOST_FRAMES:
        file.seek(at)
        head = file.read(8)
        if head[:4] == END:
            at = size
            break
        length = int.from_bytes(head[4:], "little")
        if head[:4] != ITEM or at + 8 + length > size:
            break
        found.extend((at + 8, length))
        at += 8 + length
    if at != size:
        raise EndoctError(f"{path} is cut off or damaged", found=f"{len(found) // 2} whole fragments", remedy=COPY)
    return np.array(found, np.int64).reshape(-1, 2)


def _table(file: BufferedReader, header: "Dataset", start: int, length: int) -> NDArray[np.int64]:
    """Return where frames begin, from the first fragment on, as a table says; none where there is none."""
    extended = header.get("ExtendedOffsetTable")
    if isinstance(extended, bytes) and len(extended) % 8 == 0 and len(extended) <= MOST_TABLE_BYTES:
        return np.frombuffer(extended, "<i8").astype(np.int64)
    if length % 4 or length > MOST_TABLE_BYTES:
        return np.empty(0, np.int64)
    file.seek(start)
    return np.frombuffer(file.read(length), "<u4").astype(np.int64)


@dataclass(frozen=True, eq=False)
class ReadSamples:
    """Reads one frame's stored numbers, (row, column) or (row, column, sample); picklable, safe among threads.

    Whole numbers, without the bits that are not used. ``signed``: what they are taken for; ``photometric``: their
    colours. Uncompressed samples begin at ``start``, and pydicom takes a frame from them by ``options``. ``coded``:
    what the first compressed frame says of itself, None of RLE; ``in_ybr``: whether it holds YBR.
    """

    path: Path
    syntax: str
    stated: Stated
    n_frames: int
    stored: int
    high_bit: int
    signed: bool
    photometric: str
    start: int
    options: dict[str, Any] = field(repr=False)
    places: FragmentPlaces | None = None
    coded: Stream | None = None
    in_ybr: bool = False
    palette: NDArray[Any] | None = field(default=None, repr=False)
    """Of every number that the bits which are used can be, (n, 3)."""

    def __len__(self) -> int:
        return self.n_frames

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame. Raises :class:`EndoctError` where it is damaged, or not there."""
        with refusing(f"frame {index} of {self.path} cannot be read", remedy=COPY), open_regular(self.path) as file:
            if self.places is None:
                return self._numbers(self._plain(file, index))
            picture = self.places.joined(file, index, str(self.path))
            if self.coded is None:
                return self._numbers(decoded_rle(picture, self.stated))
            stream = checked_stream(picture, self.stated, self.path)
            if stream != self.coded:
                raise ValueError("a frame that is coded in another way than the first")
            return self._of_stream(decoded(picture, stream, in_ybr=self.in_ybr).reshape(self.stated.shape), stream)

    def _plain(self, file: BufferedReader, index: int) -> NDArray[Any]:
        from pydicom.pixels.decoders.base import get_decoder

        stated = self.stated
        if stated.bits == 1:  # a frame may begin within a byte
            count = stated.rows * stated.columns
            first, within = divmod(index * count, 8)
            file.seek(self.start + first)
            data = np.frombuffer(file.read((within + count + 7) // 8), np.uint8)
            return np.unpackbits(data, bitorder="little")[within : within + count].reshape(stated.shape)
        file.seek(self.start)
        frame, _ = get_decoder(self.syntax).as_array(file, index=index, raw=True, validate=False, **self.options)
        return np.ascontiguousarray(frame, frame.dtype.newbyteorder("="))

    def _numbers(self, words: NDArray[Any]) -> NDArray[Any]:
        """Return the numbers in those bits of ``words`` that are used."""
        shift, bits = self.high_bit + 1 - self.stored, 1 if self.stated.bits == 1 else 8 * words.dtype.itemsize
        if shift and (words & words.dtype.type((1 << shift) - 1)).any():
            raise EndoctError(
                f"{self.path} has its numbers in other bits than it says",
                found="bits in use below the lowest",
                expected=f"{self.stored} bits up to bit {self.high_bit}",
            )
        if self.stored < bits:
            words = (words >> shift) & words.dtype.type((1 << self.stored) - 1)
        return _with_sign(words, self.stored) if self.signed else words

    def _of_stream(self, numbers: NDArray[Any], stream: Stream) -> NDArray[Any]:
        """Return the numbers of a picture: in the bits that it has, where these are not those that the header says."""
        bits = stream.bits
        if bits > self.high_bit >= self.stored:  # words were compressed, their unused bits with them
            numbers, bits = numbers >> (self.high_bit + 1 - self.stored), bits - (self.high_bit + 1 - self.stored)
        if stream.signed:
            return numbers
        if bits > self.stored and not stream.lossy:
            above = numbers >> (self.stored - self.signed)
            if above.any() and not (self.signed and np.isin(above, (0, (1 << (bits - self.stored + 1)) - 1, 1)).all()):
                raise EndoctError(
                    f"{self.path} has larger numbers than it says",
                    found=f"up to {int(numbers.max())}",
                    expected=f"numbers of {self.stored} bits",
                )
        return _with_sign(numbers, min(bits, self.stored)) if self.signed else numbers


def _with_sign(numbers: NDArray[Any], bits: int) -> NDArray[Any]:
    """Return unsigned numbers whose lowest ``bits`` are two's complements as the signed ones that they are."""
    spare = 8 * numbers.dtype.itemsize - bits
    return np.asarray((numbers << spare).view(f"i{numbers.dtype.itemsize}") >> spare)


def checked_stream(picture: bytes, stated: Stated, path: Path) -> Stream:
    """Return what a compressed picture says of itself. Raises :class:`EndoctError` for another size than ``stated``."""
    stream = stream_of(picture)
    if stream is None or stream.shape != stated.shape:
        found = f"{(0, 0) if stream is None else stream.shape}"
        raise EndoctError(f"{path} has other pictures in it than it says", found=found, expected=f"{stated.shape}")
    if stream.signed and stated.samples > 1:
        raise EndoctError(f"{path} cannot be read", found="colours with signs", remedy="export it as RGB")
    return stream


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
