"""The stored numbers of DICOM files: as they lie there, or decoded by imagecodecs once their own size is known."""

import math
import os
import struct
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.ct.dicom_files import DicomFile, opened
from endoct.modalities.ct.dicom_slices import number_of_frames

if TYPE_CHECKING:
    from pydicom import Dataset

NEEDED = (
    "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "PhotometricInterpretation", "BitsAllocated", "BitsStored",
    "HighBit", "PixelRepresentation", "PixelData",
)  # fmt: skip
RLE = "1.2.840.10008.1.2.5"
JPEG = {f"1.2.840.10008.1.2.4.{number}" for number in (50, 51, 57, 70)}
JPEG_LS = {f"1.2.840.10008.1.2.4.{number}" for number in (80, 81)}
JPEG_2000 = {f"1.2.840.10008.1.2.4.{number}" for number in (90, 91)}
BESIDE_VOXELS = 64_000_000
"""Bytes that a file may have besides its voxels."""
_FRAMES_OF_JPEG = frozenset({*range(0xC0, 0xD0), 0xF7}) - {0xC4, 0xC8, 0xCC}
"""Markers whose segments state the size of a picture, JPEG-LS's included."""


def stored_numbers(file: DicomFile) -> NDArray[Any]:
    """Return the stored numbers of a file's frames, (frame, row, column), whole numbers.

    Raises :class:`EndoctError` where these are not all there, are compressed by an unknown method, or too many.
    """
    shape, bits = _stated_shape(file)
    check_array_size(shape, math.ceil(bits / 8), str(file.path))
    with opened(file.path) as stream:
        from pydicom import dcmread

        size = os.fstat(stream.fileno()).st_size
        if size > math.prod(shape) * math.ceil(bits / 8) + BESIDE_VOXELS:
            raise EndoctError(f"{file.path} is larger than its header says", found=f"{size / 1e6:.0f} MB")
        data = dcmread(stream, force=True, specific_tags=list(NEEDED))
        if "PixelData" not in data:
            raise EndoctError(f"{file.path} has no voxels", found="a file that ends before them, or no image")
        numbers = _decoded(file, data, shape)
    if numbers.shape != shape:
        raise EndoctError(f"{file.path} has other voxels than it says", found=f"{numbers.shape}", expected=f"{shape}")
    return numbers


def _stated_shape(file: DicomFile) -> tuple[tuple[int, int, int], int]:
    header = file.header
    bits = int(header.get("BitsAllocated") or 0)
    if bits not in (1, 8, 16, 32):
        raise EndoctError(f"{file.path} cannot be read", found=f"{bits} bits a voxel", expected="1, 8, 16 or 32")
    return (number_of_frames(file), int(header.Rows), int(header.Columns)), bits


def _decoded(file: DicomFile, data: "Dataset", shape: tuple[int, int, int]) -> NDArray[Any]:
    syntax = data.file_meta.get("TransferSyntaxUID") if hasattr(data, "file_meta") else None
    if syntax is None or not syntax.is_encapsulated or str(syntax) == RLE:
        if syntax is None:
            from pydicom.uid import ImplicitVRLittleEndian

            data.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian
        expected = math.ceil(math.prod(shape) * int(data.BitsAllocated) / 8)
        if (syntax is None or not syntax.is_encapsulated) and len(data.PixelData) < expected:
            raise EndoctError(
                f"{file.path} is cut off",
                found=f"{len(data.PixelData)} bytes of voxels",
                expected=f"{expected}",
                remedy="copy the series again",
            )
        return np.asarray(data.pixel_array).reshape(shape)
    decode = next((function for names, function in _DECODERS.items() if str(syntax) in names), None)
    if decode is None:
        raise EndoctError(
            f"{file.path} cannot be read",
            found=f"voxels compressed as {syntax.name}",
            expected="uncompressed DICOM, RLE, JPEG, JPEG-LS or JPEG 2000",
            remedy="export it uncompressed",
        )
    return _frames(file, data, shape, decode)


def _frames(
    file: DicomFile, data: "Dataset", shape: tuple[int, int, int], decode: Callable[[bytes], NDArray[Any]]
) -> NDArray[Any]:
    from pydicom.encaps import generate_frames

    signed, stored = bool(data.PixelRepresentation), int(data.BitsStored)
    if not 2 <= stored <= 16 or int(data.HighBit) != stored - 1:
        raise EndoctError(f"{file.path} cannot be read", found=f"{stored} bits stored, up to {data.HighBit}")
    numbers = np.empty(shape, np.int32)
    count = 0
    for frame in generate_frames(data.PixelData, number_of_frames=shape[0]):
        if count == shape[0] or _stated_size(frame) != shape[1:]:
            raise EndoctError(f"{file.path} has other pictures in it than it says", found=f"{_stated_size(frame)}")
        numbers[count] = decode(frame).astype(np.int32) & ((1 << stored) - 1)
        count += 1
    if count < shape[0]:
        raise EndoctError(f"{file.path} is cut off", found=f"{count} frames", expected=f"{shape[0]}")
    if signed:
        numbers -= (numbers >> (stored - 1)) << stored
    return numbers.astype(np.int16 if signed else np.uint16)


def _stated_size(frame: bytes) -> tuple[int, int]:
    """Return rows and columns that a compressed picture says it has, (0, 0) where it does not."""
    if frame[:4] == b"\xff\x4f\xff\x51":  # JPEG 2000, whose second segment has the size
        right, bottom, left, top = struct.unpack_from(">4I", frame, 8)
        return int(bottom - top), int(right - left)
    at = 2
    while at + 9 <= len(frame) and frame[at] == 0xFF:
        marker, length = frame[at + 1], int.from_bytes(frame[at + 2 : at + 4], "big")
        if marker in _FRAMES_OF_JPEG:
            rows, columns = struct.unpack_from(">2H", frame, at + 5)
            return int(rows), int(columns)
        at += 1 if marker == 0xFF else 2 + length
    return 0, 0


def _jpeg(frame: bytes) -> NDArray[Any]:
    import imagecodecs

    return np.asarray(imagecodecs.jpeg_decode(frame))


def _jpeg_ls(frame: bytes) -> NDArray[Any]:
    import imagecodecs

    return np.asarray(imagecodecs.jpegls_decode(frame))


def _jpeg_2000(frame: bytes) -> NDArray[Any]:
    import imagecodecs

    return np.asarray(imagecodecs.jpeg2k_decode(frame))


_DECODERS: Mapping[frozenset[str], Callable[[bytes], NDArray[Any]]] = {
    frozenset(JPEG): _jpeg,
    frozenset(JPEG_LS): _jpeg_ls,
    frozenset(JPEG_2000): _jpeg_2000,
}
