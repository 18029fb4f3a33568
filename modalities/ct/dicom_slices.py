"""The slices in DICOM files, single or multi-frame: where each lies by its own header, and what its values mean.

Stored numbers are taken as they lie in the file, or decoded by imagecodecs once their own size is known.
"""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.ct.dicom_files import DicomFile, named
from endoct.modalities.dicom.decoding import READ, RLE, Stated, decoded, decoder_of
from endoct.modalities.dicom.dicom_file import opened, reading_dicom

if TYPE_CHECKING:
    from pydicom import Dataset

NOT_UNIT = 2e-3
"""A direction's length, or a right angle's cosine, may be off by this much, as of numbers with three digits."""
MOST_FRAMES = 20_000
FARTHEST_MM = 1e5
ALIKE = (
    "PatientID", "StudyInstanceUID", "FrameOfReferenceUID", "Modality", "ConvolutionKernel", "SliceThickness",
    "ReconstructionDiameter", "TemporalPositionIdentifier", "TemporalPositionIndex",
)  # fmt: skip
"""All slices of one volume have these in common."""
IN_BLOCKS = ("AcquisitionNumber", "ImageType", "KVP")
"""These may change along a volume, but not to and fro."""
NEEDED = (
    "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "PhotometricInterpretation", "BitsAllocated", "BitsStored",
    "HighBit", "PixelRepresentation", "PixelData",
)  # fmt: skip
MOST_OTHER_BYTES = 64_000_000
"""A file may have this many bytes besides its voxels."""


@dataclass(frozen=True, eq=False)
class Slice:
    """One slice: ``name`` of its file or frame; ``frame``: which of its file.

    ``position_mm`` of the middle of its first voxel; ``row``, ``column``: unit vectors along which columns and rows
    count up, LPS; ``spacing_mm`` between rows and between columns; ``shape`` rows × columns. ``decimals`` that its
    position is written with. ``slope``, ``intercept``: from stored numbers to values. ``number``: its InstanceNumber.
    ``alike``, ``in_blocks``: what it says of the volume it belongs to.
    """

    name: str
    file: DicomFile
    frame: int
    position_mm: Coordinates
    row: Coordinates
    column: Coordinates
    spacing_mm: tuple[float, float]
    shape: tuple[int, int]
    decimals: int
    slope: float
    intercept: float
    number: int | None
    alike: tuple[str, ...]
    in_blocks: tuple[str, ...]

    @property
    def normal(self) -> Coordinates:
        """The direction across the slice, (3,)."""
        return np.asarray(np.cross(self.row, self.column))

    @property
    def corners_mm(self) -> Coordinates:
        """The middles of its four corner voxels, (4, 3)."""
        last_j, last_i = self.shape[0] - 1, self.shape[1] - 1
        index = np.array([[0, 0], [0, last_i], [last_j, 0], [last_j, last_i]]) * self.spacing_mm
        return np.asarray(self.position_mm + index @ np.stack([self.column, self.row]))


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a file with its functional groups: its own, those of all frames, and the file's header."""

    of: tuple["Dataset", ...]

    def get(self, group: str, keyword: str) -> Any:
        """Return an element: from a functional group, or from the header itself; None where there is none."""
        for groups in self.of[:-1]:
            items = groups.get(group) or []
            if len(items) and (value := items[0].get(keyword)) is not None:
                return value
        return self.of[-1].get(keyword) if len(self.of) == 1 else None


def slices_of(file: DicomFile) -> list[Slice]:
    """Return the slices of a file. Raises :class:`EndoctError` where one does not say where it lies."""
    with reading_dicom(file.path):
        _check_numbers(file)
        return [_slice(file, index, frame) for index, frame in enumerate(frames_of(file))]


def frames_of(file: DicomFile) -> Iterator[Frame]:
    """Yield the frames of a file, in the order of its voxels."""
    header = file.header
    count = number_of_frames(file)
    own = header.get("PerFrameFunctionalGroupsSequence")
    if own is None:
        if count != 1:
            raise EndoctError(
                f"{file.path} does not say where its voxels lie",
                found=f"{count} frames without a position",
                expected="an enhanced CT, or a file a slice, with Image Position (Patient)",
                remedy="export it as CT, or save it in 3D Slicer as NRRD with its true geometry",
            )
        yield Frame((header,))
        return
    if len(own) != count:
        raise EndoctError(f"{file.path} cannot be read", found=f"{count} frames, {len(own)} of them described")
    shared = header.get("SharedFunctionalGroupsSequence") or []
    for groups in own:
        yield Frame((groups, *shared[:1], header))


def number_of_frames(file: DicomFile) -> int:
    """Return how many frames a file says it has. Raises :class:`EndoctError` for a number that cannot be."""
    count = int(file.header.get("NumberOfFrames") or 1)
    if not 1 <= count <= MOST_FRAMES:
        raise EndoctError(f"{file.path} cannot be read", found=f"{count} frames", expected=f"1 to {MOST_FRAMES}")
    return count


def position_of(frame: Frame, name: str) -> Coordinates:
    """Return the position of a frame, (3,) LPS. Raises :class:`EndoctError`, naming it, where it has none."""
    return _numbers(frame.get("PlanePositionSequence", "ImagePositionPatient"), 3, name, "Image Position (Patient)")


def axes_of(frame: Frame, name: str) -> tuple[Coordinates, Coordinates]:
    """Return the directions of a frame's rows and columns, unit vectors (3,), LPS."""
    numbers = _numbers(
        frame.get("PlaneOrientationSequence", "ImageOrientationPatient"), 6, name, "Image Orientation (Patient)"
    )
    row, column = numbers[:3], numbers[3:]
    lengths = float(np.linalg.norm(row)), float(np.linalg.norm(column))
    if max(abs(lengths[0] - 1), abs(lengths[1] - 1), abs(float(row @ column))) > NOT_UNIT:
        raise EndoctError(
            f"{name} has an orientation that cannot be",
            found=", ".join(f"{number:g}" for number in numbers),
            expected="two directions of length 1, at right angles",
        )
    return row / lengths[0], column / lengths[1]


def spacing_of(frame: Frame, name: str) -> tuple[float, float]:
    """Return the distances of a frame's rows and of its columns, mm."""
    stated = _numbers(frame.get("PixelMeasuresSequence", "PixelSpacing"), 2, name, "Pixel Spacing")
    between_rows, between_columns = float(stated[0]), float(stated[1])
    if not min(between_rows, between_columns) > 0:
        raise EndoctError(f"{name} has a Pixel Spacing that cannot be", found=f"{between_rows:g}, {between_columns:g}")
    return between_rows, between_columns


def _slice(file: DicomFile, index: int, frame: Frame) -> Slice:
    at = index if number_of_frames(file) > 1 else None
    name, header = named(file.path, at), file.header
    position = frame.get("PlanePositionSequence", "ImagePositionPatient")
    row, column = axes_of(frame, name)
    slope, intercept = _rescale(frame, name)
    number = header.get("InstanceNumber") if len(frame.of) == 1 else None
    thickness = frame.get("PixelMeasuresSequence", "SliceThickness")
    return Slice(
        name=named(file.path.name, at),
        file=file,
        frame=index,
        position_mm=position_of(frame, name),
        row=row,
        column=column,
        spacing_mm=spacing_of(frame, name),
        shape=(int(header.Rows), int(header.Columns)),
        decimals=max(_decimals(value) for value in position),
        slope=slope,
        intercept=intercept,
        number=None if number is None else int(number),
        alike=tuple(f"{thickness or 0:g}" if key == "SliceThickness" else file.text(key) for key in ALIKE),
        in_blocks=tuple(file.text(key) for key in IN_BLOCKS),
    )


def _rescale(frame: Frame, name: str) -> tuple[float, float]:
    of = "PixelValueTransformationSequence"
    slope, intercept = (frame.get(of, keyword) for keyword in ("RescaleSlope", "RescaleIntercept"))
    if frame.get(of, "ModalityLUTSequence"):
        raise EndoctError(f"{name} has values by a table (Modality LUT)", expected="Rescale Slope and Intercept")
    if slope is None and intercept is None:
        return 1.0, 0.0
    slope, intercept = (
        float(_numbers(value, 1, name, keyword)[0])
        for value, keyword in ((slope, "Rescale Slope"), (intercept, "Rescale Intercept"))
    )
    if slope == 0:
        raise EndoctError(f"{name} has a Rescale Slope of 0")
    return slope, intercept


def _numbers(value: Any, count: int, name: str, element: str) -> Coordinates:
    """Return the numbers of an element. Raises :class:`EndoctError` where these are not ``count`` finite ones."""
    if value is None or value == "":
        raise EndoctError(
            f"{name} does not say where its voxels lie" if count > 1 else f"{name} does not say what its values mean",
            found=f"no {element}",
            remedy="export the CT with its geometry" if count > 1 else "",
        )
    values: Sequence[Any] = [value] if isinstance(value, int | float | str) else list(value)
    numbers = [float(item) for item in values]
    if len(numbers) != count or not all(math.isfinite(item) and abs(item) <= FARTHEST_MM for item in numbers):
        raise EndoctError(f"{name} has a {element} that cannot be", found=", ".join(map(str, numbers[:6])))
    return np.array(numbers)


def _decimals(value: Any) -> int:
    """Return how many digits after the point a number is written with."""
    text = str(getattr(value, "original_string", value)).strip().lower()
    mantissa, _, exponent = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    return max(0, digits - int(exponent or 0))


def _check_numbers(file: DicomFile) -> None:
    """Raise :class:`EndoctError` where the voxels of a file are no grey values of a size that can be."""
    header = file.header
    colours = file.text("PhotometricInterpretation")
    samples = int(header.get("SamplesPerPixel", 1))
    if samples != 1 or colours not in ("MONOCHROME1", "MONOCHROME2"):
        raise EndoctError(
            f"{file.path} is no CT",
            found=f"{colours or 'no Photometric Interpretation'}, {samples} numbers a voxel",
            expected="grey values (MONOCHROME2)",
        )
    if not (int(header.get("Rows") or 0) > 0 and int(header.get("Columns") or 0) > 0):
        raise EndoctError(f"{file.path} cannot be read", found="no rows and columns")


def stored_numbers(file: DicomFile) -> NDArray[Any]:
    """Return the stored numbers of a file's frames, (frame, row, column), whole numbers.

    Raises :class:`EndoctError` where these are not all there, are compressed by an unknown method, or too many.
    """
    shape, bits = _stated_shape(file)
    check_array_size(shape, math.ceil(bits / 8), str(file.path))
    with opened(file.path) as stream:
        from pydicom import dcmread

        size = os.fstat(stream.fileno()).st_size
        if size > math.prod(shape) * math.ceil(bits / 8) + MOST_OTHER_BYTES:
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
