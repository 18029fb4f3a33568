"""An opened DICOM file: what its header says of frames, held against where they lie and what they say of themselves."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size, open_regular
from endoct.modalities.dicom.decoding import COMPRESSED, READ, RLE, Stated, Stream
from endoct.modalities.dicom.dicom_file import (
    BIG_ENDIAN,
    PLAIN,
    UNDEFINED,
    DicomFile,
    name_of,
    read_file,
    reading_dicom,
)
from endoct.modalities.dicom.samples import COPY, MOST_FRAMES, ReadSamples, checked_stream, fragments_of, places_of

if TYPE_CHECKING:
    from pydicom import Dataset

LAYOUT = (
    "SOPClassUID", "Modality", "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "PhotometricInterpretation",
    "PlanarConfiguration", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation", "ExtendedOffsetTable",
    "RedPaletteColorLookupTableDescriptor", "GreenPaletteColorLookupTableDescriptor",
    "BluePaletteColorLookupTableDescriptor", "RedPaletteColorLookupTableData", "GreenPaletteColorLookupTableData",
    "BluePaletteColorLookupTableData", "ConcatenationUID", "InConcatenationNumber", "InConcatenationTotalNumber",
    "SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence",
)  # fmt: skip
"""Samples cannot be read without these elements, nor told of which frame others are."""
STREAMS = tuple(f"1.2.840.10008.1.2.4.{number}{end}" for number in range(100, 109) for end in ("", ".1"))
"""These transfer syntaxes are those of videos."""
GREY = ("MONOCHROME1", "MONOCHROME2")
COLOURS = ("RGB", "YBR_FULL", "YBR_FULL_422", "YBR_RCT", "YBR_ICT")
HALF_WIDTH = "YBR_FULL_422"
"""Where these colours are not compressed, two pixels share their two: Y Y Cb Cr."""
PALETTE = "PALETTE COLOR"


@dataclass(frozen=True, eq=False)
class DicomImage(DicomFile):
    """A file with its frames and what reads them, None where they are a video, which lies at ``stream``.

    ``doubts``: where the header and compressed frames contradict each other.
    """

    n_frames: int = 1
    read: ReadSamples | None = None
    stream: NDArray[np.int64] | None = None
    doubts: tuple[Doubt, ...] = ()

    @cached_property
    def _groups(self) -> "list[Sequence[Dataset]]":
        return [self.header.get(f"{of}FunctionalGroupsSequence") or [] for of in ("PerFrame", "Shared")]

    def of_frame(self, index: int, group: str, keyword: str) -> Any:
        """Return an element of a frame: of its own functional ``group``, that of all, or the header; None: nowhere."""
        own, shared = self._groups
        for groups in (*own[index : index + 1], *shared[:1]):
            items = groups.get(group) or []
            if len(items) and (value := items[0].get(keyword)) is not None:
                return value
        return self.header.get(keyword)


def open_image(path: Path, keywords: tuple[str, ...] = ()) -> DicomImage:
    """Open a DICOM file: its elements of ``keywords`` besides those of the layout, and where its frames lie.

    Raises :class:`EndoctError` where there are no frames, not all of them, or coded in a way that is not read.
    """
    return image_of(read_file(path, (*LAYOUT, *keywords)))


def image_of(of: DicomFile) -> DicomImage:
    """Return the frames of a file that was read with the elements of ``LAYOUT``. Raises as :func:`open_image`."""
    path, header, syntax = of.path, of.header, of.syntax
    with reading_dicom(path), open_regular(path) as file:
        n_frames = int(header.get("NumberOfFrames") or 1)
        check_samples(of)
        if not 0 < n_frames <= MOST_FRAMES:
            raise EndoctError(f"{path} holds no frames", found=f"{n_frames} by its header")
        if (described := len(header.get("PerFrameFunctionalGroupsSequence") or ())) not in (0, n_frames):
            raise EndoctError(f"{path} cannot be read", found=f"{n_frames} frames, {described} of them described")
        if syntax in STREAMS:
            return DicomImage(**vars(of), n_frames=n_frames, stream=fragments_of(file, path, of.start)[1:])
        stated, stored, high_bit = _stated(path, header, syntax)
        if syntax not in (*PLAIN, *COMPRESSED) or (stated.bits == 1 and syntax not in PLAIN):
            raise EndoctError(
                f"{path} cannot be read",
                found=f"samples compressed as {name_of(syntax)}",
                expected=READ,
                remedy="export it uncompressed, or decompress it: gdcmconv --raw IN OUT",
            )
        signed = stated.photometric in GREY and bool(int(header.get("PixelRepresentation") or 0))
        photometric = "YBR_FULL" if stated.photometric == HALF_WIDTH else stated.photometric
        places = stream = None
        in_ybr = False
        doubts: tuple[Doubt, ...] = ()
        if syntax in PLAIN:
            _check_length(of, file, stated, n_frames)
        else:
            places = places_of(file, path, of.start, header, n_frames)
        if places is not None and syntax != RLE:
            stream = checked_stream(places.joined(file, 0, str(path)), stated, path)
            in_ybr, doubts = _against(stream, stated, stored, signed=signed)
            signed = signed or bool(stream.signed)
            if stated.samples > 1:
                photometric = "YBR_FULL" if in_ybr and stream.codec != "jpeg8" else "RGB"
        palette = _palette(header, stored) if stated.photometric == PALETTE else None
        read = ReadSamples(
            path, syntax, stated, n_frames, stored, high_bit, signed, photometric, of.start,
            _options(of, stated, n_frames), places, stream, in_ybr, palette,
        )  # fmt: skip
        return DicomImage(**vars(of), n_frames=n_frames, read=read, doubts=doubts)


def check_samples(file: DicomFile) -> None:
    """Raise :class:`EndoctError` where a file has no samples."""
    if not file.start:
        found = "a file that ends before them, or no image"
        raise EndoctError(f"{file.path} holds no samples", found=found, remedy=COPY)


def _options(of: DicomFile, stated: Stated, n_frames: int) -> dict[str, Any]:
    """Return what pydicom needs to know of uncompressed frames. It returns views where it need not rewrite them."""
    return {
        "rows": stated.rows, "columns": stated.columns, "samples_per_pixel": stated.samples,
        "number_of_frames": n_frames, "bits_allocated": stated.bits, "bits_stored": stated.bits,
        "pixel_representation": 0, "pixel_keyword": "PixelData",
        "planar_configuration": int(of.header.get("PlanarConfiguration") or 0),
        "photometric_interpretation": stated.photometric, "pixel_vr": "OW" if of.in_words else "OB",
        "correct_unused_bits": False, "view_only": stated.photometric != HALF_WIDTH and of.syntax != BIG_ENDIAN,
    }  # fmt: skip


def _against(stream: Stream, stated: Stated, stored: int, *, signed: bool) -> tuple[bool, tuple[Doubt, ...]]:
    """Return whether a picture's colours are YBR, and a doubt for each thing that it says otherwise than the header.

    It is believed before the header. But what writers lose is the sign: numbers have one where either says so.
    """
    said = []
    ybr, whole = stated.photometric.startswith("YBR"), stated.photometric.startswith("YBR_FULL")
    if stream.codec == "jpeg2k":  # colours that it turns back, or that lie in it as they are
        in_ybr, apart = whole and not stream.colours, ybr and whole == bool(stream.colours)
    else:
        in_ybr = stream.colours == "YBR" or (ybr and not stream.colours)
        apart = in_ybr != ybr
    if stated.samples > 1 and apart:
        said.append(f"colours are {stated.photometric}, and the pictures that they are {'YBR' if in_ybr else 'RGB'}")
    if stream.signed not in (None, signed):
        said.append(
            f"numbers have {'a' if signed else 'no'} sign, and the pictures otherwise; they were taken to have one"
        )
    elif signed and stream.signed is None and stream.bits < stored:
        said.append(f"numbers have {stored} bits with their sign, and the pictures that they have {stream.bits}")
    doubts = (Doubt("dicom-header-against-pictures", f"The header says that {one}.") for one in said)
    return in_ybr and stated.samples > 1, tuple(doubts)


def _check_length(of: DicomFile, file: BufferedReader, stated: Stated, n_frames: int) -> None:
    """Raise :class:`EndoctError` where uncompressed samples are not as many as a header says."""
    pixels = stated.rows * stated.columns
    count = 2 * pixels if stated.photometric == HALF_WIDTH else pixels * stated.samples
    needed, size = math.ceil(n_frames * count * stated.bits / 8), os.fstat(file.fileno()).st_size
    least = min(count // stated.rows, count // stated.columns)  # a row or a column less
    if of.length == UNDEFINED:
        raise EndoctError(f"{of.path} cannot be read", found="samples of a length that is not known")
    if of.length >= needed > size - of.start:
        raise EndoctError(f"{of.path} is cut off", found=f"{size} bytes", expected=f"{of.start + needed}", remedy=COPY)
    if not needed <= of.length < needed + max(2, least * stated.bits // 8):  # some writers pad
        raise EndoctError(
            f"{of.path} has other samples than its header says",
            found=f"{of.length} bytes",
            expected=f"{needed}, {n_frames} × {stated.rows} × {stated.columns} of {stated.bits} bits",
        )


def _stated(path: Path, header: "Dataset", syntax: str) -> tuple[Stated, int, int]:
    """Return what the header says of frames, bits stored, and the highest of them."""
    photometric = str(header.get("PhotometricInterpretation") or "").strip()
    samples, bits = int(header.get("SamplesPerPixel") or 1), int(header.get("BitsAllocated") or 0)
    stated = Stated(int(header.get("Rows") or 0), int(header.get("Columns") or 0), samples, bits, photometric)
    stored = int(header.get("BitsStored") or bits)
    high_bit = int(header.get("HighBit") if header.get("HighBit") is not None else stored - 1)
    expected = {1: (*GREY, PALETTE), 3: COLOURS}.get(samples, ())
    if photometric not in expected or bits not in ((1, 8, 16, 32), (8, 16))[samples == 3]:
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
