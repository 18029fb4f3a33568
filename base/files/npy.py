"""NumPy's ``.npy`` and ``.npz`` as files: no pickles, and sizes checked before memory is taken.

ZIP files hold no more than they may: that is checked before anything in them is listed or expanded.
"""

import io
import math
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, largest_array_bytes, open_regular

_END, _END_BYTES, _LONGEST_COMMENT = b"PK\5\6", 22, 65_535
_LOCATOR, _LOCATOR_BYTES = b"PK\6\7", 20
_ENTRY_BYTES = 1000
"""The list of members may take this much for each. A member's name and its other fields rarely take 100."""
KINDS = "biufU"
MOST_AXES = 8
MOST_MEMBERS = 1000
_PIECE = 1 << 24
_MOST_HEADER = 10_000  # NumPy's own limit
_HEADER_READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


@contextmanager
def open_zip(path: Path, most_members: int, most_bytes: int, refusal: str) -> Iterator[zipfile.ZipFile]:
    """Open a ZIP file to read, stored or deflated; ``refusal`` is the message for one that cannot be read.

    Raises :class:`EndoctError` if it is not a ZIP file, has more than ``most_members``, expands to more than
    ``most_bytes`` in all, or is packed in another way. Whatever is raised while it is open becomes one too.
    """
    with refusing(refusal), open_regular(path) as file:
        _check_list(file, path, most_members, refusal)
        with zipfile.ZipFile(file) as members:
            listed = members.infolist()
            n_bytes = sum(member.file_size for member in listed)
            if len(listed) > most_members or n_bytes > most_bytes:
                raise EndoctError(
                    f"{path} holds too much",
                    found=f"{len(listed)} files of {n_bytes / 1e6:.3g} MB",
                    expected=f"{most_members} of {most_bytes / 1e6:g} MB at most",
                    remedy="check whether it is the right file",
                )
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in listed):
                raise EndoctError(f"{path} is packed in a way that is not read", expected="stored or deflated")
            yield members


def _check_list(file: IO[bytes], path: Path, most_members: int, refusal: str) -> None:
    """Check how long the list of members is, which is read whole when a ZIP file is opened."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _LONGEST_COMMENT - _END_BYTES - _LOCATOR_BYTES))
    end = file.read()
    file.seek(0)
    place = end.rfind(_END)
    if place < 0:
        raise EndoctError(refusal, found="no ZIP file, or one that is cut off")
    is_long = end[max(0, place - _LOCATOR_BYTES) :].startswith(_LOCATOR)
    if is_long or int.from_bytes(end[place + 12 : place + 16], "little") > most_members * _ENTRY_BYTES:
        raise EndoctError(f"{path} holds too many files", expected=f"{most_members} at most")


def read_npy(file: IO[bytes], subject: str, parts: int = 1) -> NDArray[Any]:
    """Return the array of an open ``.npy`` file: numbers, truth values or texts.

    Raises :class:`EndoctError`, naming ``subject``, if it is not such a file, is cut off, or is larger than ``parts``
    times the limit of one array.
    """
    with refusing(f"{subject} is no array of NumPy"):
        shape, in_columns, dtype = read_header(file, subject)
        if dtype.kind not in KINDS or dtype.itemsize == 0 or len(shape) > MOST_AXES or any(n < 0 for n in shape):
            raise EndoctError(
                f"{subject} is no array that is read", found=f"{dtype} {shape}", expected="numbers or texts"
            )
        n_bytes = math.prod(shape) * dtype.itemsize
        if n_bytes > parts * largest_array_bytes():
            check_array_size(shape, dtype.itemsize, subject)
        data = bytearray()  # grows with what is there: the file may have less than it says
        while len(data) < n_bytes and (piece := file.read(min(n_bytes - len(data), _PIECE))):
            data += piece
        if len(data) < n_bytes:
            raise EndoctError(f"{subject} is cut off", found=f"{len(data)} bytes", expected=f"{n_bytes}")
        return np.frombuffer(data, dtype).reshape(shape, order="F" if in_columns else "C")


def read_npz(path: Path) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of a ``.npz`` file by name. Raises :class:`EndoctError` as :func:`read_npy`, for them all."""
    found: dict[str, NDArray[Any]] = {}
    with open_zip(path, MOST_MEMBERS, largest_array_bytes(), f"{path} cannot be read") as members:
        for member in members.infolist():
            with members.open(member) as inner:
                found[member.filename.removesuffix(".npy")] = read_npy(inner, f"{member.filename} in {path}")
    return found


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name as a ``.npz`` file, compressed a little: NumPy's own takes three times as long."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as members:
        for name, array in arrays.items():
            with members.open(f"{name}.npy", "w", force_zip64=True) as inner:
                np.lib.format.write_array(inner, array, allow_pickle=False)


def read_header(file: IO[bytes], subject: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return what the header of a ``.npy`` file says: shape, whether in Fortran order, dtype; read up to its end.

    Raises :class:`EndoctError`, naming ``subject``, or what NumPy raises, where it is damaged.
    """
    start = file.read(8)
    version = np.lib.format.read_magic(io.BytesIO(start))
    if version not in _HEADER_READERS:
        raise EndoctError(f"{subject} is no array that is read", found=f"version {version}", expected="1.0 or 2.0")
    length_bytes = file.read(2 if version == (1, 0) else 4)
    length = int.from_bytes(length_bytes, "little")
    if length > _MOST_HEADER:
        raise EndoctError(f"{subject} is no array of NumPy", found=f"a header of {length} bytes")
    try:
        shape, in_columns, dtype = _HEADER_READERS[version](io.BytesIO(length_bytes + file.read(length)))
    except MemoryError as error:  # what Python says of text nested too deeply
        raise EndoctError(f"{subject} is no array of NumPy", found="a damaged header") from error
    return shape, in_columns, dtype
