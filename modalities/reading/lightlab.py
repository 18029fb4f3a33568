"""LightLab, St. Jude, Abbott (C7, Ilumien): ``.oct``, a TIFF of many pages, a turn a page.

No specification is public. By papers that used such files, samples are linear, of 16 bits. A row is an A-scan, so that
pages are turned here. Their tags hold no usable sizes. By its first bytes such a file is a TIFF like any other. It is
recognised by those, by its suffix, and by pages of one sample of 16 bits. Any other TIFF that is called ``.oct`` is
read as a TIFF.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.tiff import of_first_page, read_tiff
from endoct.modalities.reading.tiff_directory import Page

SUFFIX = ".oct"


@dataclass(frozen=True, eq=False)
class _ReadTurned:
    """Reads a page and turns it: rows are depth then."""

    read: Any

    @property
    def remarks(self) -> Remarks:
        """What is to be said of all frames."""
        note = "An .oct file of 16 bits was taken for LightLab's: rows of its pages for A-scans, samples for linear."
        of_tiff: Remarks = self.read.remarks
        return Remarks(notes=(note,)) + of_tiff

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one B-scan, (depth, A-scan)."""
        return np.ascontiguousarray(self.read(index).T)


def _claims(path: Path) -> bool:
    layout = of_first_page(path, Page.layout) if path.suffix.lower() == SUFFIX else None
    return layout is not None and len(layout.shape) == 2 and layout.dtype == np.uint16


def _open(files: Files) -> Frames:
    n_frames, read = read_tiff(files[0])
    return Frames(n_frames, _ReadTurned(read))


def _states(files: Files) -> Stated:
    return Stated({"modality": "oct", "intensity": "linear"}, f"the format of {files[0].name}")


LIGHTLAB = Format("LightLab .oct", _claims, _open, _states)
