"""What a file says of a volume: its voxels, where they lie, what they are called. Every reader returns it.

Voxels lie after a header, or in a file that it names, plain or compressed; never more are read than were declared.
"""

import bz2
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.files import inside

Convention = Literal["ras", "lps"]
SIGNS: dict[Convention, tuple[float, float, float]] = {"lps": (1.0, 1.0, 1.0), "ras": (-1.0, -1.0, 1.0)}
"""Multiplied by these, x, y and z of LPS are those of a convention."""
SUFFIXES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd", ".dcm")
EXPECTED = f"a file {', '.join(SUFFIXES)}, or a folder with one DICOM series"
PLACE_MM = 0.01
"""A voxel may lie this far from where its file says."""
AXES = 3
UNITS_MM = {"mm": 1.0, "millimeter": 1.0, "cm": 10.0, "m": 1000.0, "meter": 1000.0} | dict.fromkeys(
    ("um", "µm", "μm", "micron", "micrometer"), 1e-3
)
MOST_SHEAR = 1e-3
"""Two axes of voxels with a cosine up to this count as at right angles."""
BLOCK_BYTES = 1 << 20
MEMBERS = b"\x1f\x8b", b"BZh"
"""Streams of gzip and bzip2 begin so, of which several may lie one behind the other."""


@dataclass(frozen=True)
class Segment:
    """A label with its name; ``values``: the numbers of its voxels, several where it overlaps others."""

    label: int
    name: str
    values: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class CtVolume:
    """Voxels (k, j, i) of any number type; voxel [k, j, i] lies at ``origin_mm`` + (k, j, i) · ``steps_mm``, LPS.

    Steps along i, j and k lie at right angles, except where a tilted gantry is known to have sheared the slices. Then k
    runs askew, and every voxel still lies where that says.

    Attributes
    ----------
    coordinates: what x, y and z mean in that file, or None where it does not say.
    kind: the format, and of what it is made ("DICOM, 30 slices").
    files: all that were read.
    segments: its labels by name; None where these have none.
    notes, doubts: what was mended, and what speaks against it.
    placed: False as long as places are along the axes of coordinates that the file does not name.
    tilted: whether its slices are known to lie askew.
    """

    voxels: NDArray[Any]
    origin_mm: Coordinates
    steps_mm: Coordinates
    coordinates: Convention | None
    kind: str = ""
    files: tuple[Path, ...] = ()
    segments: tuple[Segment, ...] | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    placed: bool = True
    tilted: bool = False

    @property
    def shear(self) -> float:
        """The largest cosine between two axes of voxels."""
        directions = self.steps_mm / np.linalg.norm(self.steps_mm, axis=1)[:, None]
        return float(np.abs(directions @ directions.T - np.eye(3)).max())

    @property
    def is_sheared(self) -> bool:
        """Whether its slices lie askew, as a tilted gantry has them."""
        return self.shear > MOST_SHEAR

    @property
    def to_lps(self) -> Coordinates:
        """The matrix (4, 4) that takes an index (k, j, i, 1) to its place, LPS, mm."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.asarray(self.steps_mm).T, self.origin_mm
        return matrix


def layers_as_one(
    names: Mapping[int, str], parts: Iterable[tuple[int, Any, NDArray[np.bool_]]], shape: tuple[int, ...], subject: str
) -> tuple[NDArray[np.uint16], tuple[Segment, ...]]:
    """Return segments that may overlap as one volume of numbers, and what these stand for.

    ``names`` by label; ``parts``: a label, an index of the volume, and where in that part the segment is. A number
    stands for a set of segments: a label where it is only one, a new number where several overlap. Raises
    :class:`EndoctError`, naming ``subject``, where there are more such sets than numbers, or a label is too large.
    """
    most = np.iinfo(np.uint16).max
    if any(not 0 < label <= most for label in names):
        raise EndoctError(f"a label of {subject} cannot be used", expected=f"whole numbers from 1 to {most}")
    voxels = np.zeros(shape, np.uint16)
    sets: dict[frozenset[int], int] = {frozenset(): 0} | {frozenset([label]): label for label in names}
    content = {number: some for some, number in sets.items()}
    following = max(names, default=0) + 1
    for label, index, mask in parts:
        part = voxels[index]
        for before in np.unique(part[mask]).tolist():
            together = content[before] | {label}
            if together not in sets:
                if following > most:
                    raise EndoctError(f"the segments of {subject} overlap in too many ways")
                sets[together], content[following] = following, together
                following += 1
            part[mask & (part == before)] = sets[together]
    there = set(np.unique(voxels).tolist())
    return voxels, tuple(
        Segment(label, name, tuple(number for number, some in content.items() if label in some and number in there))
        for label, name in names.items()
    )


def segments_of(names: Mapping[int, str]) -> tuple[Segment, ...]:
    """Return names by label as segments that do not overlap."""
    return tuple(Segment(label, name, (label,)) for label, name in sorted(names.items()))


def named_file(header: Path, name: object) -> Path:
    """Return the file of voxels that a header names, in its own folder.

    Raises :class:`EndoctError` for any other place, and for a list or a pattern of files.
    """
    several = not isinstance(name, str) or not name or name.split()[0].upper() == "LIST" or "%" in name
    one = str(name).removeprefix("./")
    if several or "/" in one or "\\" in one:
        raise EndoctError(
            f"{header} {'has its voxels in several files' if several else 'names a file that does not lie next to it'}",
            found=f"{name!r}"[:80],
            expected="the name of one file in its folder",
            remedy="save it as one file, .nrrd or .mha",
        )
    return inside(header.parent, one, str(header))


def read_voxels(
    file: BufferedReader, path: Path, count: int, dtype: np.dtype[Any], packing: str, skip: int = 0
) -> NDArray[Any]:
    """Return ``count`` numbers from where ``file`` stands, in the machine's order of bytes.

    ``packing``: raw, zlib (gzip's framing or zlib's), bzip2. ``skip``: bytes to leave out before them, after unpacking;
    −1: as many as there are too many in all. Raises :class:`EndoctError` where there are fewer, or more: then the
    header does not fit them.
    """
    wanted = count * dtype.itemsize
    if packing == "raw":
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - wanted) if skip == -1 else file.tell() + skip)
        data = memoryview(file.read(wanted + 1))
    else:
        unpacked = bytearray()
        for piece in _unpacked(file, packing, wanted + max(skip, 0)):  # all, so that a checksum at its end is compared
            unpacked += piece
        data = memoryview(unpacked)[-wanted:] if skip == -1 else memoryview(unpacked)[skip:]
    if len(data) != wanted:
        found = f"{len(data)} bytes of voxels" if len(data) < wanted else f"more than {wanted} bytes of voxels"
        what = "is cut off" if len(data) < wanted else "has other voxels than its header says"
        raise EndoctError(f"{path} {what}", found=found, expected=f"{wanted}", remedy="copy it again, or save it anew")
    return np.frombuffer(data, dtype).astype(dtype.newbyteorder("="), copy=False)


def _unpacked(file: BufferedReader, packing: str, most: int) -> Iterator[bytes]:
    """Yield what a compressed stream holds, or several one behind the other, up to one byte more than ``most``.

    Raises ``ValueError`` where one is not whole.
    """

    def begun() -> Any:
        return zlib.decompressobj(32 + zlib.MAX_WBITS) if packing == "zlib" else bz2.BZ2Decompressor()

    stream, left, rest = begun(), most + 1, b""
    while left > 0:
        if stream.eof:
            rest = stream.unused_data + file.read(BLOCK_BYTES)
            if not rest.startswith(MEMBERS):  # some writers fill up
                return
            stream = begun()
        piece = rest or file.read(BLOCK_BYTES)
        if not piece and getattr(stream, "needs_input", True):
            raise ValueError("compressed voxels that are cut off")
        data = stream.decompress(piece, min(left, BLOCK_BYTES))
        rest = getattr(stream, "unconsumed_tail", b"")
        left -= len(data)
        yield data
