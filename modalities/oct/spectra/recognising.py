"""What looks like raw spectra before a sidecar says so: a file of samples next to a chirp."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import entries, is_folder, read_start
from endoct.modalities.oct.spectra.keys import LEAST_ASCANS, LEAST_SAMPLES, MOST_SAMPLES
from endoct.modalities.oct.spectra.vectors import is_text, numbers_of

_MOST_BYTES = 24 * MOST_SAMPLES
"""Of a chirp: 8 a sample, more as text."""
ENDS = 0.05
"""Share of the samples by which a chirp may begin and end beside the first and the last of them."""


def seems_spectra(path: Path) -> str | None:
    """Return why a folder, or a file in one, seems to hold raw spectra; None where it does not."""
    folder = path if is_folder(path) else path.parent
    with suppress(EndoctError, OSError):
        files = [file for file in entries(folder) if file.is_file()]
        for chirp in files:
            if not (n := _chirp_length(chirp)):
                continue
            sizes = {file: file.stat().st_size for file in (files if is_folder(path) else [path])}
            spectra = [file for file, size in sizes.items() if size >= 2 * n * LEAST_ASCANS and size % (2 * n) == 0]
            if len(spectra) == 1:
                return f"{chirp.name} looks like a chirp, and {spectra[0].name} could hold raw spectra of {n} samples"
    return None


def _chirp_length(file: Path) -> int:
    """Return of how many samples the file is a chirp, 0 where it is none."""
    data = read_start(file, _MOST_BYTES)
    if is_text(data):
        return _text_length(data, file)
    for itemsize, kind in ((8, "<f8"), (4, "<f4")):
        n = len(data) // itemsize
        if len(data) % itemsize == 0 and LEAST_SAMPLES <= n <= MOST_SAMPLES and _rises(np.frombuffer(data, kind)):
            return n
    return 0


def _text_length(data: bytes, file: Path) -> int:
    """Return of how many samples a text with a number a line is a chirp, 0 where it is none."""
    if len(data) == _MOST_BYTES:
        return 0
    try:
        values = numbers_of(data, file)
    except EndoctError:
        return 0
    return values.size if LEAST_SAMPLES <= values.size <= MOST_SAMPLES and _rises(values) else 0


@np.errstate(invalid="ignore", over="ignore")
def _rises(values: Coordinates) -> bool:
    ends = abs(values[0]), abs(values[-1] - (values.size - 1))
    return bool((np.diff(values) > 0).all() and max(ends) <= ENDS * values.size)
