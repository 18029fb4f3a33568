"""The stored numbers of DICOM files: as they lie there, or decoded by imagecodecs once their own size is known."""

import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.ct.dicom_files import DicomFile
from endoct.modalities.ct.dicom_slices import number_of_frames
from endoct.modalities.dicom.decoding import READ, RLE, Stated, decoded, decoder_of
from endoct.modalities.dicom.dicom_file import opened

if TYPE_CHECKING:
    from pydicom import Dataset

NEEDED = (
    "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "PhotometricInterpretation", "BitsAllocated", "BitsStored",
    "HighBit", "PixelRepresentation", "PixelData",
)  # fmt: skip
BESIDE_VOXELS = 64_000_000
"""Bytes that a file may have besides its voxels."""


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
    if syntax is None or not syntax.is_encapsulated or str(syntax) in RLE:
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
    if decoder_of(str(syntax)) is None:
        raise EndoctError(
            f"{file.path} cannot be read",
            found=f"voxels compressed as {syntax.name}",
            expected=READ,
            remedy="export it uncompressed",
        )
    return _frames(file, data, shape)


def _frames(file: DicomFile, data: "Dataset", shape: tuple[int, int, int]) -> NDArray[Any]:
    from pydicom.encaps import generate_frames

    signed, stored = bool(data.PixelRepresentation), int(data.BitsStored)
    if not 2 <= stored <= 16 or int(data.HighBit) != stored - 1:
        raise EndoctError(f"{file.path} cannot be read", found=f"{stored} bits stored, up to {data.HighBit}")
    syntax, stated = str(data.file_meta.TransferSyntaxUID), Stated(*shape[1:])
    numbers = np.empty(shape, np.int32)
    count = 0
    for frame in generate_frames(data.PixelData, number_of_frames=shape[0]):
        if count == shape[0]:
            raise EndoctError(f"{file.path} has other pictures in it than it says", found=f"more than {count} frames")
        numbers[count] = decoded(syntax, frame, stated, str(file.path)).astype(np.int32) & ((1 << stored) - 1)
        count += 1
    if count < shape[0]:
        raise EndoctError(f"{file.path} is cut off", found=f"{count} frames", expected=f"{shape[0]}")
    if signed:
        numbers -= (numbers >> (stored - 1)) << stored
    return numbers.astype(np.int16 if signed else np.uint16)
