"""Vectors with one value a sample, as a rig's programs write them next to its spectra."""

import re
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import inside, read_small, text_of

TEXT_SUFFIXES = (".txt", ".csv")
_TEXT = re.compile(rb"(?:\xef\xbb\xbf|\xff\xfe|\xfe\xff)?[0-9eEnNaAiIfF+\-.,;\s\0]*")
"""Bytes of numbers as text, also in UTF-16; binary numbers hardly consist of these alone."""
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+(?:[eE][-+]?[0-9]+)?")
_BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_vector(folder: Path, name: str, key: str, n: int) -> Coordinates:
    """Return the ``n`` values in the file ``name`` of ``folder``, float64 (n,); ``key`` of the sidecar names it.

    Raises :class:`EndoctError` where it is missing, or as :func:`vector_of` does.
    """
    path = inside(folder, name, f"'{key}' in the sidecar")
    return vector_of(read_small(path), path, key, n)


def vector_of(data: bytes, path: Path, key: str, n: int) -> Coordinates:
    """Return the ``n`` values that the bytes of the file ``path`` hold, float64 (n,).

    They are text with a number a line, which the bytes tell, or little-endian float64 or float32, which their number
    tells apart. Raises :class:`EndoctError` where there are more or fewer values, or one is not finite.
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
    """Return the numbers of a text, float64. Raises :class:`EndoctError` where it holds others than numbers."""
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
