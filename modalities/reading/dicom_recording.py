"""The DICOM files of one recording: one of many frames, or a frame each, in the order that they state.

Files of a frame each are ordered by their instance numbers. Where they also say where, or when, each was taken, that
must agree.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from endoct.base.errors import EndoctError
from endoct.modalities.dicom.dicom_file import check_parts, reading_dicom
from endoct.modalities.dicom.image import DicomImage, open_image
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks, doubted, some_names

if TYPE_CHECKING:
    from pydicom import Dataset

ORDER = (
    "SeriesInstanceUID", "SeriesDescription", "InstanceNumber", "SliceLocation", "AcquisitionDateTime",
    "AcquisitionTime", "ContentTime",
)  # fmt: skip
"""These elements are read besides those of the samples."""
_CLOCK = re.compile(r"(?:[0-9]{8})?([0-9]{2})([0-9]{2})([0-9]{2}(?:\.[0-9]{1,6})?)(?:[+-][0-9]{4})?")
"""A time, or a date with a time, as DICOM writes them."""
APART = "put each recording into a folder of its own"


@dataclass(frozen=True, eq=False)
class DicomRecording:
    """``images`` in their order; ``along``: the numbers of files of one frame each."""

    images: tuple[DicomImage, ...]
    along: Along | None = None
    remarks: Remarks = NONE

    @property
    def header(self) -> "Dataset":
        """Of the first file."""
        return self.images[0].header

    @property
    def frames(self) -> list[tuple[DicomImage, int]]:
        """Every frame: its file, and its number there from 0."""
        return [(image, index) for image in self.images for index in range(image.n_frames)]

    def each(self, sequence: str, keyword: str) -> list[Any]:
        """Return an element of every frame, which lies in ``sequence`` of its functional groups; None where missing."""
        return [image.of_frame(index, sequence, keyword) for image, index in self.frames]

    def number(self, keyword: str) -> float | None:
        """Return a number of the header, None where there is none. Raises ``ValueError`` where it is none."""
        return as_number(self.header.get(keyword))

    def text(self, keyword: str) -> str:
        """Return a text of the header, "" where there is none."""
        return self.images[0].text(keyword)


@contextmanager
def opened_recording(files: Sequence[Path], keywords: tuple[str, ...]) -> Iterator[DicomRecording]:
    """Open the files of one recording, with their elements of ``keywords``; pydicom may be asked within the context.

    Raises :class:`EndoctError` where they are several recordings, or cannot be read.
    """
    with reading_dicom(files[0] if len(files) == 1 else files[0].parent):
        yield _ordered(files, [open_image(file, (*ORDER, *keywords)) for file in files])


def as_number(value: Any) -> float | None:
    """Return a value as a finite number, None where there is none. Raises ``ValueError`` where it is no number."""
    if value is None or value == "" or (hasattr(value, "__len__") and len(value) == 0):
        return None
    number = float(value)
    if not np.isfinite(number):
        raise ValueError(f"{value!r:.40}, which is no number")
    return number


def _ordered(files: Sequence[Path], images: list[DicomImage]) -> DicomRecording:
    folder = files[0].parent
    check_parts(images, files[0] if len(files) == 1 else folder)
    remarks = Remarks(doubts=tuple(dict.fromkeys(doubt for image in images for doubt in image.doubts)))
    if len(images) == 1:
        return DicomRecording((images[0],), remarks=remarks)
    series = {image.text("SeriesInstanceUID") for image in images}
    if len(series) == 1 and images[0].text("ConcatenationUID"):
        images = sorted(images, key=lambda image: int(image.header.InConcatenationNumber))
        return DicomRecording(tuple(images), remarks=remarks)
    if len(series) > 1 or any(image.n_frames > 1 for image in images):
        names = some_names([image.path.name for image in images])
        found = f"{len(series)} DICOM series" if len(series) > 1 else "several files of many frames"
        raise EndoctError(f"{folder} holds more than one recording", found=f"{found}: {names}", remedy=APART)
    numbers = [as_number(image.header.get("InstanceNumber")) for image in images]
    if None in numbers or len(set(numbers)) < len(numbers):
        raise EndoctError(
            f"the order of the slices in {folder} is not known",
            found="instance numbers that are missing" if None in numbers else "instance numbers that occur twice",
            expected="a number for each file",
            remedy="export the series again, with one series in a folder",
        )
    order = np.argsort(np.array(numbers, np.float64), kind="stable")
    ordered = tuple(images[k] for k in order)
    values = np.array(numbers, np.float64)[order]
    return DicomRecording(ordered, Along(values, "", "the instance numbers"), remarks + _on_order(ordered))


def _on_order(images: tuple[DicomImage, ...]) -> Remarks:
    """Return a doubt where places or times of files do not run as their instance numbers do."""
    for name, value in _PLACES:
        found = [value(image.header) for image in images]
        if None in found:
            continue
        steps = np.diff(np.array(found, np.float64))
        against = min(int((steps < 0).sum()), int((steps > 0).sum()))
        if against and (name != "times" or (steps < 0).any()):
            what = (
                f"By their instance numbers the slices lie in another order than by their {name}: {against} steps "
                "lead back. The instance numbers were trusted."
            )
            return doubted("frames-order", what, float(against), 0.0)
    return NONE


def _seconds(header: "Dataset") -> float | None:
    """Return at which second of the day a file was taken."""
    for keyword in ("AcquisitionDateTime", "AcquisitionTime", "ContentTime"):
        if (clock := _CLOCK.fullmatch(str(header.get(keyword) or "").strip())) is not None:
            hours, minutes, seconds = clock.groups()
            return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    return None


_PLACES: tuple[tuple[str, Callable[["Dataset"], float | None]], ...] = (
    ("places", lambda header: as_number(header.get("SliceLocation"))),
    ("times", _seconds),
)
