"""NRRD: header by pynrrd; a segmentation of 3D Slicer (.seg.nrrd) with the names of its segments and its layers."""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular, read_start
from endoct.modalities.ct.stored import (
    AXES,
    UNITS_MM,
    Convention,
    CtVolume,
    Segment,
    layers_as_one,
    named_file,
    read_voxels,
)

MAGIC = re.compile(rb"NRRD000\d\r?\n")
MOST_HEADER = 1_000_000
MOST_LAYERS = 64
WORDS = ("left-posterior-superior", "right-anterior-superior", "left-anterior-superior")
SPACES: Mapping[str, tuple[Convention | None, tuple[float, float, float]]] = {
    "lps": ("lps", (1.0, 1.0, 1.0)),
    "ras": ("ras", (-1.0, -1.0, 1.0)),
    "las": (None, (1.0, -1.0, 1.0)),
}
"""A space is one of these conventions. Its x, y and z times the numbers are those of LPS."""
TYPES = {
    name: dtype
    for dtype, names in {
        "i1": "signed char,int8,int8_t", "u1": "uchar,unsigned char,uint8,uint8_t",
        "i2": "short,short int,signed short,signed short int,int16,int16_t",
        "u2": "ushort,unsigned short,unsigned short int,uint16,uint16_t", "i4": "int,signed int,int32,int32_t",
        "u4": "uint,unsigned int,uint32,uint32_t",
        "i8": "longlong,long long,long long int,signed long long,int64,int64_t",
        "u8": "ulonglong,unsigned long long,unsigned long long int,uint64,uint64_t", "f4": "float", "f8": "double",
    }.items()
    for name in names.split(",")
}  # fmt: skip
PACKINGS = {"raw": "raw", "gzip": "zlib", "gz": "zlib", "bzip2": "bzip2", "bz2": "bzip2"}
_SEGMENT = re.compile(r"Segment(\d+)_(Name|LabelValue|Layer)")


def is_nrrd(path: Path) -> bool:
    """Say whether a file begins as NRRD does."""
    return MAGIC.match(read_start(path, 16)) is not None


def read_nrrd(path: Path) -> CtVolume:
    """Return the volume in an NRRD file, or in the file next to it that its header names.

    Without a ``space`` that is a patient's the axes are those of coordinates that the file does not name (``placed`` is
    False). Raises :class:`EndoctError` where it does not say where its voxels lie, and for what is no volume.
    """
    with refusing(f"{path} cannot be read", expected="NRRD that is whole"):
        header, start = _header(path)
        sizes = [int(n) for n in header["sizes"]]
        directions = _directions(header, len(sizes), path)
        axes = [axis for axis in range(len(sizes)) if directions[axis] is not None]
        others = [axis for axis in range(len(sizes)) if directions[axis] is None]
        if len(axes) != AXES or len(others) > 1 or min(sizes) < 1 or axes != list(range(axes[0], axes[0] + AXES)):
            raise EndoctError(
                f"{path} is no volume",
                found=f"{len(sizes)} dimensions, {len(axes)} of them in space",
                expected="three dimensions",
            )
        layers = math.prod(sizes[axis] for axis in others)
        shape = sizes[axes[2]], sizes[axes[1]], sizes[axes[0]]
        stored, files = _stored(header, start, path, sizes)
        voxels, segments = _as_volume(
            stored, shape, layers, first=bool(others) and others[0] == 0, header=header, path=path
        )
        steps = np.array([directions[axis] for axis in reversed(axes)], dtype=np.float64)
        origin = _origin(header, path)
        scale = _unit_mm(header, path)
        stated = str(header.get("space", "")).strip().lower()
        space = "".join(word[0] for word in stated.split("-")) if stated in WORDS else stated
        placed = space in SPACES
        convention, signs = SPACES.get(space, (None, (1.0, 1.0, 1.0)))
    kind = "NRRD" if segments is None else "NRRD, a segmentation of 3D Slicer"
    return CtVolume(
        voxels, scale * origin * signs, scale * steps * signs, convention, kind, files, segments, placed=placed
    )


def _header(path: Path) -> tuple[dict[str, Any], int]:
    """Return the fields of a header, and how many bytes it has."""
    from nrrd import read_header

    data = read_start(path, MOST_HEADER)
    end = re.search(rb"\n\r?\n", data)
    if end is None and len(data) == MOST_HEADER:
        raise EndoctError(f"{path} cannot be read", found=f"a header of more than {MOST_HEADER / 1e6:g} MB")
    text = (data if end is None else data[: end.start()]).decode("utf-8", "replace")
    if re.search(r"(?m)^data ?file:\s*(LIST|.*%)", text):
        named_file(path, "LIST")
    lines = [re.sub(r"\s*,\s*", ",", line) if line.startswith("space") else line for line in text.splitlines()]
    return dict(read_header(lines)), len(data) if end is None else end.end()


def _field(header: Mapping[str, Any], name: str) -> Any:
    """Return a field that may be written with a space in its name or without."""
    return header.get(name, header.get(name.replace(" ", "")))


def _stored(
    header: Mapping[str, Any], start: int, path: Path, sizes: list[int]
) -> tuple[NDArray[Any], tuple[Path, ...]]:
    """Return all numbers in the order of the file, and the files they are in."""
    kind, encoding = str(header["type"]).lower(), str(header["encoding"]).lower()
    if kind not in TYPES or encoding not in PACKINGS:
        raise EndoctError(
            f"{path} cannot be read",
            found=f"voxels of type {kind}, {encoding}",
            expected=f"numbers, {', '.join(PACKINGS)}",
        )
    dtype = np.dtype(TYPES[kind])
    if int(header["dimension"]) != len(sizes) or len(sizes) > AXES + 1:
        raise EndoctError(f"{path} is no volume", found=f"{header['dimension']} dimensions, {len(sizes)} sizes")
    if dtype.itemsize > 1:
        endian = str(header.get("endian", "")).lower()
        if endian not in ("little", "big"):
            raise EndoctError(f"{path} does not say in which order its bytes are", expected="endian: little or big")
        dtype = dtype.newbyteorder("<" if endian == "little" else ">")
    check_array_size(sizes, dtype.itemsize, str(path))
    line_skip, byte_skip = (int(_field(header, f"{unit} skip") or 0) for unit in ("line", "byte"))
    if not (0 <= line_skip <= 10_000 and -1 <= byte_skip <= MOST_HEADER):
        raise EndoctError(f"{path} cannot be read", found=f"line skip {line_skip}, byte skip {byte_skip}")
    name = _field(header, "data file")
    data_path = path if name is None else named_file(path, name)
    with open_regular(data_path) as file:
        file.seek(start if name is None else 0)
        for _ in range(line_skip):
            file.readline(MOST_HEADER)
        numbers = read_voxels(file, data_path, math.prod(sizes), dtype, PACKINGS[encoding], byte_skip)
    return numbers, (path,) if name is None else (path, data_path)


def _directions(header: Mapping[str, Any], count: int, path: Path) -> list[Coordinates | None]:
    """Return the step of each axis of the file in space; None for an axis that is none in space."""
    stated = header.get("space directions")
    if stated is None:
        raise EndoctError(
            f"{path} does not say where its voxels lie",
            found="spacings only" if header.get("spacings") is not None else "no space directions",
            expected="'space directions' and 'space origin', as 3D Slicer writes them",
            remedy="save it in 3D Slicer, where you placed it",
        )
    rows = [None if row is None or np.all(np.isnan(row)) else np.asarray(row, np.float64) for row in stated]
    if len(rows) != count or any(row is not None and row.shape != (AXES,) for row in rows):
        raise EndoctError(f"{path} does not say where its voxels lie", found=f"{len(rows)} space directions of {count}")
    units = header.get("units") or []
    if any(str(unit).strip().lower() not in ("", "mm", "none", "???") for unit in units):
        raise EndoctError(f"{path} says two things of its unit", found=f"units {units}"[:80], expected="mm")
    return rows


def _origin(header: Mapping[str, Any], path: Path) -> Coordinates:
    origin = header.get("space origin")
    if origin is None or np.shape(origin) != (AXES,):
        raise EndoctError(
            f"{path} does not say where its voxels lie", found="no space origin", expected="three numbers"
        )
    return np.asarray(origin, dtype=np.float64)


def _unit_mm(header: Mapping[str, Any], path: Path) -> float:
    stated = {str(unit).strip().lower() for unit in header.get("space units") or [""]}
    unit = stated.pop()
    one = unit.removesuffix("s").replace("metre", "meter") or "mm"
    if stated or one not in UNITS_MM:
        raise EndoctError(
            f"{path} has a unit of length that is not known", found=f"space units {unit!r}"[:60], expected="mm, um or m"
        )
    return UNITS_MM[one]


def _as_volume(
    stored: NDArray[Any],
    shape: tuple[int, int, int],
    layers: int,
    *,
    first: bool,
    header: Mapping[str, Any],
    path: Path,
) -> tuple[NDArray[Any], tuple[Segment, ...] | None]:
    """Return the voxels (k, j, i), layers put into one, and the segments that the header names."""
    named = _named(header)
    if not named:
        if layers > 1:
            raise EndoctError(f"{path} is no volume", found=f"{layers} numbers a voxel", expected="one")
        return stored.reshape(shape), None
    if layers > MOST_LAYERS or stored.dtype.kind not in "iu":
        raise EndoctError(f"{path} is no segmentation", found=f"{layers} layers of {stored.dtype}")
    of_layer = np.moveaxis(stored.reshape(*shape, layers), -1, 0) if first else stored.reshape(layers, *shape)
    parts: list[tuple[str, int, int]] = []
    for number, fields in sorted(named.items()):
        label, layer = fields.get("LabelValue"), fields.get("Layer", "0")
        if label is None or not (label.lstrip("-").isdigit() and layer.isdigit() and int(layer) < layers):
            raise EndoctError(f"{path} does not say which voxels are segment {number}", found=f"{fields}"[:80])
        parts.append((fields.get("Name", "").strip(), int(label), int(layer)))
    if len({(label, layer) for _, label, layer in parts}) < len(parts):
        raise EndoctError(f"{path} names one label twice", found=", ".join(name for name, _, _ in parts)[:120])
    if layers == 1:
        return of_layer[0], tuple(Segment(label, name, (label,)) for name, label, _ in parts if label != 0)
    distinct = len({label for _, label, _ in parts}) == len(parts)
    names = {label if distinct else at + 1: name for at, (name, label, _) in enumerate(parts)}
    masks = [of_layer[layer] == label for _, label, layer in parts]
    for at, numbers in enumerate(of_layer):  # what no name is for must not go lost
        known = [label for _, label, layer in parts if layer == at]
        rest = (numbers != 0) & ~np.isin(numbers, known)
        if rest.any():
            names[1 + max(names)] = ""
            masks.append(rest)
    return layers_as_one(
        names, ((label, ..., mask) for label, mask in zip(names, masks, strict=True)), shape, str(path)
    )


def _named(header: Mapping[str, Any]) -> dict[int, dict[str, str]]:
    found: dict[int, dict[str, str]] = {}
    for field, value in header.items():
        if match := _SEGMENT.fullmatch(field):
            found.setdefault(int(match[1]), {})[match[2]] = str(value)
    return found
