"""DICOM files: told by their first bytes, and by what they are of; opened for pydicom such that no length runs away.

A file says what it holds by its SOP class (PS3.4, B.5). Recordings of OCT, ultrasound in vessels and endoscopes are
told from volumes by that.
"""

import logging
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import open_regular, read_start

if TYPE_CHECKING:
    from pydicom import Dataset

PREAMBLE, MAGIC = 128, b"DICM"
START_BYTES = PREAMBLE + len(MAGIC)
_KINDS_OF_VALUES = b"AE|AS|CS|DA|DS|DT|IS|LO|LT|OB|OW|PN|SH|SQ|ST|TM|UI|UL|UN|US|UT"
_BARE = re.compile(
    rb"[\x02\x08]\0[\0-\x60]\0(?:%b|..\0\0)|\0[\x02\x08]\0[\0-\x60](?:%b)" % (2 * (_KINDS_OF_VALUES,)), re.DOTALL
)
"""DICOM without a preamble, as old archives wrote it, begins with an element of group 2 or 8."""
IMPLICIT, BIG_ENDIAN = "1.2.840.10008.1.2", "1.2.840.10008.1.2.2"
PLAIN = (IMPLICIT, EXPLICIT := f"{IMPLICIT}.1", BIG_ENDIAN)
SAMPLES, UNDEFINED = 0x7FE0_0010, 0xFFFF_FFFF
OTHER_SAMPLES = frozenset({0x7FE0_0008, 0x7FE0_0009})
"""These elements hold samples that are no whole numbers."""
DIRECTORY = "1.2.840.10008.1.3.10"
"""The class of a DICOMDIR, which stands in its meta header alone."""
_STORAGE = "1.2.840.10008.5.1.4.1.1"
OCT_FOR_PRESENTATION, OCT_FOR_PROCESSING = f"{_STORAGE}.14.1", f"{_STORAGE}.14.2"
ULTRASOUND = frozenset(f"{_STORAGE}.{end}" for end in ("3", "3.1", "6", "6.1"))
ENDOSCOPIC = frozenset(f"{_STORAGE}.{end}" for end in ("77.1.1", "77.1.1.1"))
"""These are the classes of images, and of a video."""
CAPTURES = frozenset(f"{_STORAGE}.{end}" for end in ("7.2", "7.3", "7.4"))
"""These are the classes of secondary captures of many frames."""
OF_CAMERAS = ("ES", "XC", "GM", "OT", "SC", "")
"""Captures of these modalities are pictures: endoscopy, photographs, microscopy, others. Those of a CT are a volume."""
IN_VESSELS = ("IVOCT", "IVUS", "OCT")
"""Catheters that turn in vessels have these modalities; ophthalmic OCT is "OPT"."""
_LAST_OF_KIND = 0x0008_0060


@dataclass(frozen=True, eq=False)
class DicomFile:
    """A file with its header up to the samples, the UID of its transfer syntax, and where the samples lie.

    ``start``: at which byte they begin, 0 where there are none; ``length`` in bytes, or ``UNDEFINED``. ``in_words``:
    whether they are words of 16 bits (OW), whatever the bits of a sample.
    """

    path: Path
    header: "Dataset"
    syntax: str
    start: int = 0
    length: int = 0
    in_words: bool = False

    def text(self, keyword: str) -> str:
        """Return the text of an element, "" where there is none."""
        value = self.header.get(keyword)
        return "" if value is None else str(value).strip()

    @property
    def sop_class(self) -> str:
        """The UID of its SOP class, "" where it does not say."""
        return _class_of(self.header)


@dataclass(frozen=True)
class DicomContent:
    """What a file holds: the UID of its SOP class and its modality, "" where it does not say."""

    sop_class: str
    modality: str

    @property
    def is_catheter(self) -> bool:
        """Whether it is a recording of a catheter that turns: OCT or ultrasound."""
        oct_ = self.sop_class in (OCT_FOR_PRESENTATION, OCT_FOR_PROCESSING)
        drawn = self.sop_class in CAPTURES | ULTRASOUND
        return oct_ or (drawn and self.modality in IN_VESSELS)

    @property
    def is_pictures(self) -> bool:
        """Whether it holds pictures or a video of an endoscope, or of another camera."""
        return self.sop_class in ENDOSCOPIC or (self.sop_class in CAPTURES and self.modality in OF_CAMERAS)

    @property
    def is_recording(self) -> bool:
        """Whether it is a recording, and no volume."""
        return self.is_catheter or self.is_pictures


UNKNOWN = DicomContent("", "")


def name_of(uid: str) -> str:
    """Return what DICOM calls a UID, or the UID itself."""
    from pydicom.config import IGNORE
    from pydicom.uid import UID

    return str(UID(uid, validation_mode=IGNORE).name)[:80]


def is_dicom(path: Path) -> bool:
    """Say whether a file begins as DICOM does."""
    start = read_start(path, START_BYTES)
    return start[PREAMBLE:] == MAGIC or _BARE.match(start) is not None


def kind_of(path: Path) -> DicomContent:
    """Return what a DICOM file holds, by its first elements; unknown for another file, or a damaged one."""
    try:
        state = path.stat()
    except (OSError, ValueError):
        return UNKNOWN
    return _kind_of(path, (state.st_ino, state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=4096)  # a folder of hundreds of files is asked again and again
def _kind_of(path: Path, _state: tuple[int, int, int]) -> DicomContent:
    if not is_dicom(path):
        return UNKNOWN
    try:
        with opened(path) as file:
            from pydicom.filereader import read_partial

            start = read_partial(
                file,
                stop_when=lambda tag, _vr, _length: tag > _LAST_OF_KIND,
                force=True,
                specific_tags=[0x0008_0016, _LAST_OF_KIND],
            )
            return DicomContent(_class_of(start), str(start.get("Modality") or ""))
    except (EndoctError, OSError):
        return UNKNOWN


def _class_of(header: "Dataset") -> str:
    return str(header.get("SOPClassUID") or header.file_meta.get("MediaStorageSOPClassUID") or "")


def read_file(path: Path, keywords: tuple[str, ...]) -> DicomFile:
    """Return a file with its elements of ``keywords``.

    Raises :class:`EndoctError` where there is no header, or the file is deflated as a whole.
    """
    from pydicom.filereader import read_partial

    found: list[tuple[int, int, str | None]] = []
    with opened(path) as file:

        def at_samples(tag: int, kind: str | None, length: int) -> bool:
            if tag == SAMPLES:
                found.append((file.tell(), length, kind))
            return tag == SAMPLES or tag in OTHER_SAMPLES

        header = read_partial(file, at_samples, force=True, specific_tags=_tags_of(keywords))
        if not len(header) and not len(header.file_meta):
            raise EndoctError(f"{path} cannot be read", found="no header of DICOM, or a damaged one")
        implicit, little = header.original_encoding
        plain = BIG_ENDIAN if not little else IMPLICIT if implicit else EXPLICIT
        syntax = str(header.file_meta.get("TransferSyntaxUID") or plain)
        start, length, kind = found[0] if found else (0, 0, None)
        return DicomFile(path, header, syntax, start, length, kind == "OW")


def check_parts(files: Sequence[DicomFile], path: Path) -> None:
    """Raise :class:`EndoctError` where files are parts of a whole (PS3.3 C.7.6.16.2.2.4), and some may be missing."""
    keys = "InConcatenationNumber", "InConcatenationTotalNumber"
    parts, totals = (sorted(int(file.header.get(key) or 0) for file in files) for key in keys)
    if not any((*parts, *totals, *(file.text("ConcatenationUID") for file in files))) or totals == parts == [1]:
        return
    if parts != list(range(1, len(files) + 1)) or set(totals) != {len(files)}:
        numbers = ", ".join(str(part) for part in parts[:3])
        raise EndoctError(
            f"{path} is a part of a recording or volume",
            found=f"part {numbers} of {totals[-1] or 'a number that it does not say'}",
            remedy="put all of its parts into one folder",
        )


@lru_cache
def _tags_of(keywords: Sequence[str]) -> list[int]:
    from pydicom.datadict import tag_for_keyword

    return [tag for keyword in keywords if (tag := tag_for_keyword(keyword)) is not None]


class _Bounded(BufferedReader):
    """A file that is asked for no more bytes than it has: a damaged length would have 4 GB of memory taken."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to ``size`` bytes."""
        if size is None or size < 0:  # to be inflated, and nobody knows how far that grows
            raise ValueError("DICOM that is deflated as a whole; export it uncompressed")
        return super().read(min(size, max(0, os.fstat(self.fileno()).st_size - self.tell())))


@contextmanager
def reading_dicom(path: Path) -> Iterator[None]:
    """Have pydicom read in silence; whatever it raises about ``path`` becomes one :class:`EndoctError`.

    It turns values into numbers only as they are asked for, so this is around all that asks.
    """
    from pydicom.config import disable_value_validation

    logging.getLogger("pydicom").setLevel(logging.CRITICAL)  # what is wrong is an error here, or is no matter
    with (
        warnings.catch_warnings(),
        disable_value_validation(),
        refusing(f"{path} cannot be read", expected="DICOM that is whole"),
    ):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def opened(path: Path) -> Iterator[BufferedReader]:
    """Open a DICOM file for pydicom."""
    with open_regular(path) as file, reading_dicom(path):
        yield _Bounded(file.raw)
