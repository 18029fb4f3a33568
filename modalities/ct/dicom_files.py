"""The DICOM files in a folder, or one of them: which belong to a volume, and their headers, by pydicom.

Why not highdicom, which makes volumes too (0.28)? It takes slices for even where their distances vary by up to 1 %,
0.6 mm over a head. It says only that they are no volume, and not which slice is wrong. It knows no tilted gantry.
"""

import stat
from collections import Counter
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from endoct.base.errors import EndoctError, some_of
from endoct.base.files.files import is_left_by_system, read_start
from endoct.modalities.ct.stored import EXPECTED
from endoct.modalities.dicom.dicom_file import DIRECTORY, DicomFile, check_parts, is_dicom, kind_of, name_of, read_file
from endoct.modalities.dicom.image import LAYOUT, check_samples

NO_DICOM_SUFFIXES = frozenset(
    (".txt", ".md", ".json", ".xml", ".csv", ".tsv", ".htm", ".html", ".pdf", ".ini", ".inf", ".log", ".toml", ".yaml",
     ".yml", ".jpg", ".jpeg", ".png", ".gif", ".bmp", ".tif", ".tiff", ".zip", ".exe", ".dll", ".ctbl", ".label",
     ".fcsv", ".nii", ".gz", ".nrrd", ".mha", ".mhd", ".raw", ".py", ".sh")
)  # fmt: skip
"""Files with these suffixes may lie next to slices. Any other file that is no DICOM may be a damaged slice."""
LOOKED_AT, MOST_BELOW = 50, 200
"""Number of files, in a folder and those below, that are looked at before it counts as one without DICOM."""
SCOUT = "LOCALIZER"
KEYWORDS = (
    *LAYOUT, "SpecificCharacterSet", "ImageType", "SOPInstanceUID", "SeriesDescription",
    "PatientID", "StudyInstanceUID", "SeriesInstanceUID", "FrameOfReferenceUID", "AcquisitionNumber",
    "TemporalPositionIdentifier", "TemporalPositionIndex", "ConvolutionKernel", "SliceThickness", "KVP",
    "ReconstructionDiameter", "GantryDetectorTilt", "InstanceNumber", "ImagePositionPatient",
    "ImageOrientationPatient", "PixelSpacing", "PixelPaddingValue", "PixelPaddingRangeLimit", "RescaleSlope",
    "RescaleIntercept", "RescaleType", "ModalityLUTSequence", "LossyImageCompression", "SegmentSequence",
    "SegmentationType",
)  # fmt: skip


def _is_scout(file: DicomFile) -> bool:
    """Say whether a file says of itself that it is a scout (localizer, topogram)."""
    return SCOUT in file.text("ImageType")


def _is_image(file: DicomFile) -> bool:
    """Say whether a file should hold an image: not a report, a plan, a directory or the like."""
    return "Rows" in file.header or not file.sop_class or "Image" in name_of(file.sop_class)


def dicom_in(folder: Path) -> bool:
    """Say whether a folder holds DICOM that is no recording, by its first files."""
    files = (
        entry for entry in sorted(folder.iterdir())[:LOOKED_AT] if entry.is_file() and not entry.name.startswith(".")
    )
    kinds = (kind_of(entry) for entry in files if is_dicom(entry))
    return any(kind.sop_class != DIRECTORY and not kind.is_recording for kind in kinds)


def dicom_files(path: Path) -> tuple[list[DicomFile], tuple[str, ...]]:
    """Return the images of one series, in a folder or a file, with their headers, and notes on what was left out.

    Scouts, and what is no image, are left out. Raises :class:`EndoctError` where a file may be a damaged slice or
    cannot be read, and where there is no series or more than one.
    """
    paths, aside = _candidates(path) if path.is_dir() else ([path], [])
    files = [read_file(entry, KEYWORDS) for entry in paths]
    images = [file for file in files if _is_image(file)]
    scouts = [file for file in images if _is_scout(file)]
    slices = [file for file in images if not _is_scout(file)]
    if not slices:
        none = "DICOM without images" if files else "no DICOM"
        found = f"{len(scouts)} scouts only" if scouts else none
        raise EndoctError(f"{path} is no volume", found=found, expected=EXPECTED, remedy=_where_else(path))
    for file in slices:
        check_samples(file)
    _check_one_series(path, slices)
    check_parts(slices, path)
    notes = [f"left out as {'scouts' if len(scouts) > 1 else 'a scout'}: {some_of(_names(scouts))}"] if scouts else []
    if others := [file for file in files if not _is_image(file)]:
        notes.append(f"left out as no images: {some_of(_names(others))}")
    if aside:
        notes.append(f"left out as no DICOM: {some_of(aside)}")
    return slices, tuple(notes)


def _names(files: Sequence[DicomFile]) -> list[str]:
    return [file.path.name for file in files]


def _candidates(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the DICOM files in a folder, and the names of files that are surely none."""
    found, aside = [], []
    for path in sorted(folder.iterdir()):
        if path.is_dir() or path.name.startswith(".") or is_left_by_system(path.name):
            continue
        try:
            mode = path.stat().st_mode
        except OSError as error:
            nowhere = "a link that leads nowhere" if path.is_symlink() else ""
            raise _unreadable(path, nowhere or error.strerror or str(error)) from error
        if not stat.S_ISREG(mode):
            raise _unreadable(path, "a pipe, or the like")
        if is_dicom(path):
            found.append(path)
            continue
        start = read_start(path, 512)
        if not start:
            raise _unreadable(path, "an empty file")
        if path.suffix.lower() not in NO_DICOM_SUFFIXES and not _is_text(start):
            raise _unreadable(path, "a file that is no DICOM, or a damaged one")
        aside.append(path.name)
    return found, aside


def _is_text(start: bytes) -> bool:
    text = start.decode("utf-8", "ignore")
    return all(letter.isprintable() or letter in "\r\n\t" for letter in text) and len(text) > len(start) / 2


def _unreadable(path: Path, reason: str) -> EndoctError:
    return EndoctError(
        f"{path} is no slice", found=reason, expected="slices only", remedy="copy the series again, or remove that file"
    )


def _where_else(path: Path) -> str:
    below = islice(path.rglob("*"), MOST_BELOW) if path.is_dir() else ()
    there = any(entry.is_file() and is_dicom(entry) for entry in below)
    return "name the folder that holds the slices" if there else ""


def _check_one_series(path: Path, files: Sequence[DicomFile]) -> None:
    series = Counter(file.text("SeriesInstanceUID") for file in files)
    if len(series) == 1:
        return
    said = {file.text("SeriesInstanceUID"): file.text("SeriesDescription") for file in files}
    each = [f"'{said[uid] or uid[-12:]}' ({count} files)" for uid, count in series.most_common()]
    raise EndoctError(
        f"{path} is no volume",
        found=f"{len(series)} DICOM series: {some_of(each)}",
        expected="one DICOM series in a folder",
        remedy="put the series into a folder of its own",
    )
