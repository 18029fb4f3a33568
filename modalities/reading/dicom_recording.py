"""DICOM recordings: one file of many frames, or files of a frame each, in the order that they state.

Files of a frame each are ordered by their instance numbers. Where they also say where, or when, each was taken, that
must agree.

Of an endoscope there are images (PS3.3 A.32.1), a video (A.32.5), or secondary captures of many frames (A.8). Pictures
are returned as they are meant to be seen: RGB, black as 0. A video lies in the file as one stream, in fragments; it is
read in place, by what reads videos, where it is an MP4. The traps: MONOCHROME1 has white as 0; of uncompressed YBR two
pixels may share their colours; frames have one time (FrameTime, ms) or each its own (FrameTimeVector), and where both
are there, FrameIncrementPointer says which counts; CineRate is at which rate they were taken,
RecommendedDisplayFrameRate only how they are shown.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.dicom.dicom_file import ENDOSCOPIC, check_parts, kind_of, reading_dicom
from endoct.modalities.dicom.image import DicomImage, open_image
from endoct.modalities.dicom.samples import ReadSamples, as_seen
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks, doubted, some_names
from endoct.modalities.reading.video import STAMP_JITTER, ReadVideo
from endoct.modalities.reading.video_container import FilePart, container_of

if TYPE_CHECKING:
    from pydicom import Dataset

KEYWORDS = ("FrameTime", "FrameTimeVector", "FrameIncrementPointer", "CineRate", "BurnedInAnnotation")
FRAME_TIME = 0x0018_1063
ALIKE = 0.02
"""Two frame rates may differ by this share and count as the same."""
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


@dataclass(frozen=True, eq=False)
class _ReadPictures:
    """Reads one picture as it is meant to be seen; picklable."""

    frames: tuple[tuple[ReadSamples, int], ...]

    @property
    def remarks(self) -> Remarks:
        """What was done to all pictures."""
        note = "The header says that 0 is white (MONOCHROME1); pictures were turned over, so that 0 is black."
        turned_over = self.frames[0][0].stated.photometric == "MONOCHROME1"
        return Remarks(notes=(note,)) if turned_over else NONE

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one picture."""
        read, number = self.frames[index]
        return as_seen(read(number), read)


def _open(files: Files) -> Frames:
    with opened_recording(files, KEYWORDS) as recording:
        times, on_times = _times(recording)
        remarks = recording.remarks + on_times
        if recording.text("BurnedInAnnotation") == "YES":
            note = "The header says that texts are burnt into the pictures; they may identify the patient."
            remarks += Remarks(notes=(note,))
        if any(image.read is None for image in recording.images):
            return _video(recording.images, remarks)
        read = _ReadPictures(tuple((image.read, index) for image, index in recording.frames if image.read is not None))
        return Frames(len(read.frames), read, times or recording.along, remarks)


def _states(files: Files) -> Stated:
    with opened_recording(files, KEYWORDS) as recording:
        keys: dict[str, Any] = {}
        if kind_of(files[0]).sop_class in ENDOSCOPIC:
            keys["modality"] = "endoscope"
        if rates_hz := _rates(recording):
            keys["frame_rate_hz"] = rates_hz[0][1]
        return Stated(keys, f"the DICOM header of {files[0].name if len(files) == 1 else files[0].parent.name}")


def _video(images: tuple[DicomImage, ...], remarks: Remarks) -> Frames:
    path, stream = images[0].path, images[0].stream
    if stream is None or len(images) > 1:
        raise EndoctError(f"{path} is one of several videos", remedy="put each into a folder of its own")
    part = FilePart(path, tuple(map(tuple, stream.tolist())))
    if not container_of(part):
        raise EndoctError(
            f"{path} cannot be read",
            found="a video that is no MP4: a transport stream, or one without a container",
            remedy="take it out, `gdcmraw -i IN -o OUT.ts`, and convert it: ffmpeg -i OUT.ts -c:v ffv1 OUT.mkv",
        )
    read = ReadVideo(part)
    if read.n_frames != images[0].n_frames:
        what = f"The header states {images[0].n_frames} frames; its video has {read.n_frames}, which were taken."
        doubt = Doubt("video-against-header", what, value=float(read.n_frames), expected=float(images[0].n_frames))
        remarks += Remarks(doubts=(doubt,))
    along = Along(read.times_s, "s", "the time stamps of the video", within=STAMP_JITTER)
    return Frames(read.n_frames, read, along, remarks)


def _vector(recording: DicomRecording) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Return the time of every frame in s, None where the header has not one for each, or another element counts."""
    steps = recording.header.get("FrameTimeVector")
    if steps is None or not hasattr(steps, "__len__") or len(steps) != len(recording.frames) or len(steps) < 2:
        return None
    if recording.header.get("FrameIncrementPointer") == FRAME_TIME:
        return None
    numbers = np.array([float(step) for step in steps])
    if not np.isfinite(numbers).all() or (numbers[1:] <= 0).any():
        raise ValueError("times of frames that do not rise")
    return np.cumsum(np.concatenate([[0.0], numbers[1:]])) / 1000


def _times(recording: DicomRecording) -> tuple[Along | None, Remarks]:
    """Return when frames were taken, and a doubt where the header says so twice, and differently."""
    remarks = NONE
    (by, rate_hz), *others = _rates(recording) or [("", 0.0)]
    if differing := [other for other in others if abs(rate_hz / other[1] - 1) > ALIKE]:
        other, other_hz = differing[0]
        what = f"By the header's {by} there are {rate_hz:.4g} frames a second, by its {other} {other_hz:.4g}."
        remarks = doubted("frame-rate-against-cine", what, rate_hz, other_hz, "Hz")
    times = _vector(recording)
    along = None if times is None else Along(times, "s", "the frame times of the header", within=STAMP_JITTER)
    return along, remarks


def _rates(recording: DicomRecording) -> list[tuple[str, float]]:
    """Return the frame rates that elements state: times of frames, one time for all, the rate of the cine."""
    times, milliseconds = _vector(recording), recording.number("FrameTime")
    stated = (
        ("frame times", None if times is None else float(1 / np.median(np.diff(times)))),
        ("frame time", 1000 / milliseconds if milliseconds else None),
        ("CineRate", recording.number("CineRate")),
    )
    return [(by, rate_hz) for by, rate_hz in stated if rate_hz is not None and rate_hz > 0]


PICTURES = Format("DICOM of an endoscope", lambda path: kind_of(path).is_pictures, _open, _states, joins=True)
