"""Vectors with one value a sample, as a rig's programs write them next to its spectra.

A file of samples next to a chirp looks like raw spectra before a sidecar says so.
"""

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import entries, inside, is_folder, read_small, read_start, text_of
from endoct.modalities.oct.spectra.keys import LEAST_ASCANS, LEAST_SAMPLES, MOST_SAMPLES

TEXT_SUFFIXES = (".txt", ".csv")
_TEXT = re.compile(rb"(?:\xef\xbb\xbf|\xff\xfe|\xfe\xff)?[0-9eEnNaAiIfF+\-.,;\s\0]*")
"""Bytes of numbers as text, also in UTF-16; binary numbers hardly consist of these alone."""
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+(?:[eE][-+]?[0-9]+)?")
_BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")
_MOST_BYTES = 24 * MOST_SAMPLES
"""A chirp has no more: 8 a sample, more as text."""
ENDS = 0.05
"""A chirp begins and ends at most this part of the samples away from the first and the last of them."""


def read_vector(folder: Path, name: str, key: str, n: int) -> Coordinates:
    """Return the ``n`` values in the file ``name`` of ``folder``, float64 (n,); ``key`` of the sidecar names it.

    Raises :class:`EndoctError` where it is missing, or as :func:`vector_of` does.
    """
    path = inside(folder, name, f"'{key}' in the sidecar")
    return vector_of(read_small(path), path, key, n)


def vector_of(data: bytes, path: Path, key: str, n: int) -> Coordinates:
    """Return the ``n`` values that the bytes of the file ``path`` hold, float64 (n,).

    They are text with a number a line, as the bytes show, or little-endian float64 or float32, which their number
    distinguishes. Raises :class:`EndoctError` where there are more or fewer values, or one is not finite.
    """
    if path.suffix.lower() in TEXT_SUFFIXES or is_text(data):
        values = numbers_of(data, path)
    else:
        kind = {8 * n: "<f8", 4 * n: "<f4"}.get(len(data))
        if kind is None:
            raise EndoctError(
                f"{path}, '{key}' in the sidecar, has the wrong length",
                found=f"{len(data)} bytes",
                expected=f"{8 * n} bytes (float64) or {4 * n} (float32) for {n} samples a spectrum, or text",
                remedy="check 'samples' in the sidecar, and the file",
            )
        values = np.frombuffer(data, kind).astype(np.float64)
    if values.size != n:
        raise EndoctError(
            f"{path}, '{key}' in the sidecar, has the wrong length",
            found=f"{values.size} numbers",
            expected=f"{n}, one a sample",
            remedy="check 'samples' in the sidecar, and the file",
        )
    if not np.isfinite(values).all():
        raise EndoctError(
            f"{path}, '{key}' in the sidecar, is not finite",
            found=f"value {int(np.flatnonzero(~np.isfinite(values))[0])} is NaN or infinite",
            remedy="check that it holds little-endian float64 or float32, or text",
        )
    return values


def is_text(data: bytes) -> bool:
    """Say whether bytes are numbers written as text, with digits among them, not binary ones."""
    if (b"\0" in data and not data.startswith(_BYTE_ORDER_MARKS)) or not re.search(rb"[0-9]", data):
        return False
    return _TEXT.fullmatch(data) is not None


def numbers_of(data: bytes, path: Path) -> Coordinates:
    """Return the numbers of a text, float64. Raises :class:`EndoctError` where it holds anything else."""
    try:
        words = text_of(data).split()
        if words and all(map(_DECIMAL_COMMA.fullmatch, words)):
            raise EndoctError(
                f"{path} holds no numbers", found=f"{words[0][:40]}", remedy="write numbers with a point, one a line"
            )
        listed = (part for word in words for part in re.split("[,;]", word) if part)
        return np.array([float(part) for part in listed], dtype=np.float64)
    except ValueError as error:
        raise EndoctError(f"{path} holds no numbers", found=str(error), expected="one number a line") from error


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
    """Return for how many samples the file is a chirp, with a number a line where it is text; 0 where it is none."""
    data = read_start(file, _MOST_BYTES)
    readings: list[NDArray[Any]] = []
    if not is_text(data):
        kinds = [(8, "<f8"), (4, "<f4")]
        readings = [np.frombuffer(data, kind) for itemsize, kind in kinds if len(data) % itemsize == 0]
    elif len(data) < _MOST_BYTES:
        with suppress(EndoctError):
            readings = [numbers_of(data, file)]
    return next((each.size for each in readings if LEAST_SAMPLES <= each.size <= MOST_SAMPLES and _rises(each)), 0)


@np.errstate(invalid="ignore", over="ignore")
def _rises(values: Coordinates) -> bool:
    ends = abs(values[0]), abs(values[-1] - (values.size - 1))
    return bool((np.diff(values) > 0).all() and max(ends) <= ENDS * values.size)
