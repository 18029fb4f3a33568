"""The slices in DICOM files, single or multi-frame: where each lies by its own header, and what its values mean."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.dicom.dicom_file import DicomFile
from endoct.modalities.dicom.image import GREY, DicomImage, image_of

NOT_UNIT = 2e-3
"""A direction's length, or a right angle's cosine, may be off by this much, as of numbers with three digits."""
FARTHEST_MM = 1e5
ALIKE = (
    "PatientID", "StudyInstanceUID", "FrameOfReferenceUID", "Modality", "ConvolutionKernel", "SliceThickness",
    "ReconstructionDiameter", "TemporalPositionIdentifier", "TemporalPositionIndex",
)  # fmt: skip
"""All slices of one volume have these in common."""


@dataclass(frozen=True, eq=False)
class Slice:
    """One slice: ``name`` of its file or frame; ``frame``: which of its file.

    ``position_mm`` of the middle of its first voxel; ``row``, ``column``: unit vectors along which columns and rows
    count up, LPS; ``spacing_mm`` between rows and between columns; ``shape`` rows × columns. ``decimals`` that its
    position is written with. ``slope``, ``intercept``: from stored numbers to values. ``number``: its InstanceNumber.
    ``alike``: what it says of the volume it belongs to.
    """

    name: str
    file: DicomImage
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

    @property
    def normal(self) -> Coordinates:
        """The direction across the slice, (3,)."""
        return np.asarray(np.cross(self.row, self.column))

    @property
    def corners_mm(self) -> Coordinates:
        """The middles of its four corner voxels, (4, 3)."""
        index = np.array(list(np.ndindex(2, 2))) * np.subtract(self.shape, 1) * self.spacing_mm
        return np.asarray(self.position_mm + index @ np.stack([self.column, self.row]))


def slices_of(file: DicomFile) -> list[Slice]:
    """Return the slices of a file. Raises :class:`EndoctError` where one does not say where it lies, or is cut off."""
    _check_grey(file)
    image = image_of(file)
    if image.n_frames > 1 and "PerFrameFunctionalGroupsSequence" not in image.header:
        raise EndoctError(
            f"{image.path} does not say where its voxels lie",
            found=f"{image.n_frames} frames without a position",
            expected="an enhanced CT, or a file a slice, with Image Position (Patient)",
            remedy="export it as CT, or save it in 3D Slicer as NRRD with its true geometry",
        )
    return [_slice(image, index) for index in range(image.n_frames)]


def position_of(image: DicomImage, frame: int) -> Coordinates:
    """Return the position of a frame, (3,) LPS. Raises :class:`EndoctError`, naming it, where it has none."""
    stated = image.of_frame(frame, "PlanePositionSequence", "ImagePositionPatient")
    return _numbers(stated, 3, named(image, frame), "Image Position (Patient)")


def axes_of(image: DicomImage, frame: int) -> tuple[Coordinates, Coordinates]:
    """Return the directions of a frame's rows and columns, unit vectors (3,), LPS."""
    stated = image.of_frame(frame, "PlaneOrientationSequence", "ImageOrientationPatient")
    numbers = _numbers(stated, 6, named(image, frame), "Image Orientation (Patient)")
    row, column = numbers[:3], numbers[3:]
    lengths = float(np.linalg.norm(row)), float(np.linalg.norm(column))
    if max(abs(lengths[0] - 1), abs(lengths[1] - 1), abs(float(row @ column))) > NOT_UNIT:
        raise EndoctError(
            f"{named(image, frame)} has an orientation that cannot be",
            found=", ".join(f"{number:g}" for number in numbers),
            expected="two directions of length 1, at right angles",
        )
    return row / lengths[0], column / lengths[1]


def spacing_of(image: DicomImage, frame: int) -> tuple[float, float]:
    """Return the distances of a frame's rows and of its columns, mm."""
    name = named(image, frame)
    stated = _numbers(image.of_frame(frame, "PixelMeasuresSequence", "PixelSpacing"), 2, name, "Pixel Spacing")
    between_rows, between_columns = float(stated[0]), float(stated[1])
    if not min(between_rows, between_columns) > 0:
        raise EndoctError(f"{name} has a Pixel Spacing that cannot be", found=f"{between_rows:g}, {between_columns:g}")
    return between_rows, between_columns


def named(image: DicomImage, frame: int, *, short: bool = False) -> str:
    """Return how a message calls a slice, ``short``: by its file's name."""
    path = image.path.name if short else image.path
    return f"frame {frame + 1} of {path}" if image.n_frames > 1 else str(path)


def _slice(file: DicomImage, frame: int) -> Slice:
    position = file.of_frame(frame, "PlanePositionSequence", "ImagePositionPatient")
    row, column = axes_of(file, frame)
    slope, intercept = _rescale(file, frame)
    number = None if "PerFrameFunctionalGroupsSequence" in file.header else file.header.get("InstanceNumber")
    thickness = file.of_frame(frame, "PixelMeasuresSequence", "SliceThickness")
    return Slice(
        name=named(file, frame, short=True),
        file=file,
        frame=frame,
        position_mm=position_of(file, frame),
        row=row,
        column=column,
        spacing_mm=spacing_of(file, frame),
        shape=(int(file.header.Rows), int(file.header.Columns)),
        decimals=max(_decimals(value) for value in position),
        slope=slope,
        intercept=intercept,
        number=None if number is None else int(number),
        alike=tuple(f"{thickness or 0:g}" if key == "SliceThickness" else file.text(key) for key in ALIKE),
    )


def _rescale(image: DicomImage, frame: int) -> tuple[float, float]:
    of, name = "PixelValueTransformationSequence", named(image, frame)
    slope, intercept = (image.of_frame(frame, of, keyword) for keyword in ("RescaleSlope", "RescaleIntercept"))
    if image.of_frame(frame, of, "ModalityLUTSequence"):
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


def _check_grey(file: DicomFile) -> None:
    """Raise :class:`EndoctError` where the voxels of a file are no grey values."""
    colours, samples = file.text("PhotometricInterpretation"), int(file.header.get("SamplesPerPixel", 1))
    if samples != 1 or colours not in GREY:
        raise EndoctError(
            f"{file.path} is no CT",
            found=f"{colours or 'no Photometric Interpretation'}, {samples} numbers a voxel",
            expected="grey values (MONOCHROME2)",
        )


def numbers_of(image: DicomImage, frame: int) -> NDArray[Any]:
    """Return the stored numbers of a frame, (row, column), whole numbers. Raises :class:`EndoctError` for a video."""
    if image.read is None:
        raise EndoctError(f"{image.path} is no volume", found="a video")
    return image.read(frame)


def padding_of(image: DicomImage) -> tuple[int, int] | None:
    """Return the least and the largest stored number that mean that nothing was seen there (PS3.3 C.7.5.1.1.2).

    A header may write them without the sign that stored numbers have, and the other way round.
    """
    stated = [image.header.get(key) for key in ("PixelPaddingValue", "PixelPaddingRangeLimit")]
    if stated[0] is None or image.read is None:
        return None
    most = 1 << image.read.stored
    numbers = [int(value) % most for value in stated if value is not None]
    ends = sorted(number - most * (image.read.signed and number >= most // 2) for number in numbers)
    return ends[0], ends[-1]
