"""DICOM files: told by their first bytes, and by what they are of; opened for pydicom such that no length runs away.

A file says what it holds by its SOP class (PS3.4, B.5). Recordings of OCT, ultrasound in vessels and endoscopes are
told from volumes by that.
"""

import logging
import os
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
WITHOUT_PREAMBLE = (
    b"\x08\x00\x05\x00",
    b"\x08\x00\x08\x00",
    b"\x08\x00\x16\x00",
    b"\x08\x00\x00\x00",
    b"\x02\x00\x00\x00",
)
"""DICOM without a preamble, as old archives wrote it, begins with one of these elements: little endian."""
DEFLATED = "1.2.840.10008.1.2.1.99"
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


@dataclass(frozen=True)
class Kind:
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

    @property
    def name(self) -> str:
        """The SOP class in words, or its UID, or "" where it does not say."""
        return name_of(self.sop_class)


UNKNOWN = Kind("", "")


def name_of(uid: str) -> str:
    """Return what DICOM calls a UID, or the UID itself."""
    from pydicom.config import IGNORE
    from pydicom.uid import UID

    return str(UID(uid, validation_mode=IGNORE).name)[:80]


def is_dicom(path: Path) -> bool:
    """Say whether a file begins as DICOM does."""
    start = read_start(path, START_BYTES)
    return start[PREAMBLE:] == MAGIC or start.startswith(WITHOUT_PREAMBLE)


def kind_of(path: Path) -> Kind:
    """Return what a DICOM file holds, by its first elements; unknown for another file, or a damaged one."""
    try:
        state = path.stat()
    except (OSError, ValueError):
        return UNKNOWN
    return _kind_of(path, (state.st_ino, state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=4096)  # a folder of hundreds of files is asked again and again
def _kind_of(path: Path, _state: tuple[int, int, int]) -> Kind:
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
            return Kind(str(start.get("SOPClassUID") or ""), str(start.get("Modality") or ""))
    except (EndoctError, OSError):
        return UNKNOWN


def read_elements(file: BufferedReader, path: Path, keywords: Sequence[str]) -> "Dataset":
    """Return those elements of an opened file that lie before its samples; the file is at the samples then.

    Raises :class:`EndoctError` where there is no header, or the file is deflated as a whole.
    """
    from pydicom import dcmread

    header = dcmread(file, stop_before_pixels=True, force=True, specific_tags=list(keywords))
    if syntax_of(header) == DEFLATED:
        raise EndoctError(
            f"{path} cannot be read", found="DICOM that is deflated as a whole", remedy="export it uncompressed"
        )
    if not len(header):
        raise EndoctError(f"{path} cannot be read", found="no header of DICOM, or a damaged one")
    return header


def syntax_of(header: "Dataset") -> str:
    """Return the UID of the transfer syntax, "" where the file does not say."""
    return str(header.file_meta.get("TransferSyntaxUID") or "") if hasattr(header, "file_meta") else ""


class _Bounded(BufferedReader):
    """A file that is asked for no more bytes than it has: a damaged length would have 4 GB of memory taken."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to ``size`` bytes."""
        left = max(0, os.fstat(self.fileno()).st_size - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


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
