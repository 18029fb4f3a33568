"""MetaImage (.mha, .mhd): a header of lines "key = value", checked before anything of it is used.

ITK's own reader ends the process where a header states 999 dimensions, and opens any file that a header names.
"""

import math
import re
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular, read_start
from endoct.modalities.ct.stored import AXES, UNITS_MM, CtVolume, named_file, read_voxels

MOST_HEADER = 64_000
LAST_KEY = "elementdatafile"
KEY = re.compile(rb"\s*([A-Za-z]\w{1,40})\s*=")
TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
MATRICES, ORIGINS = ("transformmatrix", "rotation", "orientation"), ("offset", "position", "origin")


def is_metaimage(path: Path) -> bool:
    """Say whether a file begins with lines as MetaImage has them."""
    start = read_start(path, 4096)
    return KEY.match(start) is not None and re.search(rb"(?im)^\s*(NDims|ObjectType)\s*=", start) is not None


def read_metaimage(path: Path) -> CtVolume:
    """Return the volume in a MetaImage, or in the file next to it that its header names; LPS.

    Raises :class:`EndoctError` where it does not say where its voxels lie, and for what is no volume.
    """
    with refusing(f"{path} cannot be read", expected="MetaImage that is whole"):
        header, start = _header(path)
        if header.get("objecttype", "image").lower() != "image" or _whole(header, "ndims", path) != AXES:
            raise EndoctError(
                f"{path} is no volume",
                found=f"{header.get('objecttype', 'image')} of {header.get('ndims')} dimensions",
                expected="an image of three dimensions",
            )
        if _whole(header, "elementnumberofchannels", path, 1) != 1:
            raise EndoctError(f"{path} is no volume", found="several numbers a voxel", expected="one")
        sizes = [int(n) for n in _numbers(header, ("dimsize",), AXES, path)]
        kind = header.get("elementtype", "").upper()
        if kind not in TYPES or min(sizes) < 1:
            raise EndoctError(f"{path} is no volume", found=f"{' × '.join(map(str, sizes))} of {kind or 'no type'}")
        if not _says(header, "binarydata", True):
            raise EndoctError(f"{path} cannot be read", found="voxels as text", expected="BinaryData = True")
        slope = float(header.get("elementtointensityfunctionslope", 1))
        offset = float(header.get("elementtointensityfunctionoffset", 0))
        if (slope, offset) != (1.0, 0.0):
            raise EndoctError(
                f"{path} cannot be read", found=f"values by a slope of {slope:g} and an offset of {offset:g}"
            )
        big = _says(header, "elementbyteordermsb", _says(header, "binarydatabyteordermsb", False))
        dtype = np.dtype(TYPES[kind]).newbyteorder(">" if big else "<")
        check_array_size(sizes, dtype.itemsize, str(path))
        steps, origin = _place(header, path)
        name = header[LAST_KEY]
        local = name.upper() == "LOCAL"
        data_path = path if local else named_file(path, name)
        before = _whole(header, "headersize", path, 0)
        if not -1 <= before <= MOST_HEADER:
            raise EndoctError(f"{path} cannot be read", found=f"HeaderSize = {before}")
        packed = _says(header, "compresseddata", False)
        with open_regular(data_path) as file:
            file.seek(start if local else 0)
            skip = 0 if local else before
            voxels = read_voxels(file, data_path, math.prod(sizes), dtype, "zlib" if packed else "raw", skip)
    files = (path,) if local else (path, data_path)
    return CtVolume(voxels.reshape(sizes[::-1]), origin, steps, coordinates="lps", kind="MetaImage", files=files)


def _header(path: Path) -> tuple[dict[str, str], int]:
    """Return the values of a header by key in lower case, and how many bytes it has."""
    lines = BytesIO(read_start(path, MOST_HEADER))
    header: dict[str, str] = {}
    while LAST_KEY not in header:
        line = lines.readline()
        key, equals, value = line.decode("utf-8", "replace").partition("=")
        key = key.strip().lower()
        if not equals or not key or key in header:
            said = f"'{key[:40]}' twice" if key in header else f"the line '{line[:40].decode('ascii', 'replace')}'"
            raise EndoctError(
                f"{path} cannot be read",
                found=said if line else "a header without ElementDataFile",
                expected="lines 'key = value' up to ElementDataFile",
            )
        header[key] = value.strip()
    return header, lines.tell()


def _place(header: Mapping[str, str], path: Path) -> tuple[Coordinates, Coordinates]:
    """Return steps (k, j, i) and origin in mm."""
    unit = header.get("distanceunits", "mm").strip().lower()
    if unit not in UNITS_MM:
        raise EndoctError(f"{path} has a unit of length that is not known", found=f"DistanceUnits = {unit}")
    spacing = _numbers(header, ("elementspacing",), AXES, path)
    if not np.all(spacing > 0):
        raise EndoctError(f"{path} has voxels without a size", found=f"ElementSpacing = {header['elementspacing']}")
    rows = _numbers(header, MATRICES, AXES * AXES, path).reshape(AXES, AXES)  # a row for each axis of voxels: i, j, k
    origin = _numbers(header, ORIGINS, AXES, path)
    lengths = np.linalg.norm(rows, axis=1)
    if np.abs(lengths - 1).max() > 1e-3:
        raise EndoctError(f"{path} does not say where its voxels lie", found="directions that are not of length 1")
    scale = UNITS_MM[unit]
    return scale * (rows * spacing[:, None])[::-1].copy(), scale * origin


def _numbers(header: Mapping[str, str], keys: tuple[str, ...], count: int, path: Path) -> Coordinates:
    """Return the numbers under the one of ``keys`` that is there. Raises where these are not ``count`` finite ones."""
    there = [key for key in keys if key in header]
    if len(there) != 1:
        found = " and ".join(there) or f"no {' or '.join(keys)}"
        raise EndoctError(
            f"{path} does not say where its voxels lie", found=found, expected=f"one of {', '.join(keys)}"
        )
    values = [float(text) for text in header[there[0]].split()]
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise EndoctError(
            f"{path} cannot be read", found=f"{there[0]} = {header[there[0]]}"[:80], expected=f"{count} numbers"
        )
    return np.array(values)


def _whole(header: Mapping[str, str], key: str, path: Path, usual: int | None = None) -> int:
    text = header.get(key, "" if usual is None else str(usual))
    if not re.fullmatch(r"-?\d{1,9}", text):
        raise EndoctError(f"{path} cannot be read", found=f"{key} = {text}"[:60], expected="a whole number")
    return int(text)


def _says(header: Mapping[str, str], key: str, usual: bool) -> bool:
    text = header.get(key, str(usual)).strip().lower()
    if text not in ("true", "false", "1", "0"):
        raise ValueError(f"{key} = {text[:20]}")
    return text in ("true", "1")
