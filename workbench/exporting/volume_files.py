"""Volumes as NRRD and as NIfTI-1, written as their voxels are made.

NRRD, for 3D Slicer and ITK, is a text header, then voxels through gzip. NIfTI-1 is a header of 348 bytes, then
voxels, through gzip where the name ends in .gz. The gzip file is written as a stream, with a comment in its header,
where a mark can be put in when all is written.
"""

import struct
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.nifti import nifti_header
from endoct.workbench.exporting.cartesian import Volume, open_volume
from endoct.workbench.exporting.formats import Options
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Source
from endoct.workbench.running.progress import Stages

FASTEST = 1


class GzipStream:
    """Compresses what it is given into an open file."""

    def __init__(self, file: BinaryIO, comment: str = "") -> None:
        self._file = file
        self._deflate = zlib.compressobj(FASTEST, zlib.DEFLATED, -zlib.MAX_WBITS)
        self._crc, self._size = 0, 0
        has_comment, no_time, unknown_system = 0x10 if comment else 0, 0, 255
        file.write(struct.pack("<BBBBIBB", 0x1F, 0x8B, 8, has_comment, no_time, 0, unknown_system))
        if comment:
            file.write(comment.encode("latin-1") + b"\0")

    def write(self, data: bytes) -> None:
        """Compress ``data``."""
        self._crc, self._size = zlib.crc32(data, self._crc), self._size + len(data)
        self._file.write(self._deflate.compress(data))

    def finish(self) -> None:
        """Write what is left, and the sums."""
        self._file.write(self._deflate.flush() + struct.pack("<II", self._crc, self._size & 0xFFFFFFFF))


_TYPES = {"u1": "uint8", "u2": "uint16", "u4": "uint32", "i1": "int8", "i2": "int16", "i4": "int32"}
_FLOATS = {"f4": "float", "f8": "double"}
_LPS = "left-posterior-superior"


def volume_of(source: Source, options: Options) -> Volume:
    """Return the volume of a source. Raises :class:`EndoctError` where it has none."""
    if source.volume is None:
        raise EndoctError(
            f"{source.path} has no volume",
            expected="a panorama of OCT that was unrolled with its volume",
            remedy="unroll the recording with volume=True, and export that",
        )
    return open_volume(source.volume, source.grid, options.voxel_mm)


def volume_facts(volume: Volume) -> dict[str, object]:
    """Return what is to be known of a volume that was written."""
    return {
        "shape": list(volume.shape),
        "step_mm": list(volume.step_mm),
        "origin_mm": list(volume.origin_mm),
        "dtype": volume.dtype.name,
        "space": "LPS: x, y and z of the bore frame",
    }


def write_nrrd(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``: axes x, y, z in the space left-posterior-superior, mm. Returns what was written.

    Raises :class:`EndoctError` where there is none.
    """
    volume = volume_of(source, options)
    with stages.stage("NRRD") as advance, path.open("wb") as file:
        file.write(_header(volume).encode("ascii"))
        stream = GzipStream(file)
        for done, voxels in enumerate(volume.slices(), 1):
            stream.write(voxels.astype(voxels.dtype.newbyteorder("<"), copy=False).tobytes())
            advance(done / volume.shape[2])
        stream.finish()
    mark(path)
    return volume_facts(volume)


def _header(volume: Volume) -> str:
    kind = (_TYPES | _FLOATS)[volume.dtype.str[1:]]
    x, y, z = volume.step_mm
    lines = [
        "NRRD0005",
        f"# {BLANK}",
        "# The axes are those of a bore: right-handed, z inward, x right and y down as seen looking in.",
        "# They are named left, posterior and superior, but have nothing to do with a patient's.",
        f"type: {kind}",
        "dimension: 3",
        f"space: {_LPS}",
        f"sizes: {' '.join(map(str, volume.shape))}",
        f"space directions: ({x!r},0,0) (0,{y!r},0) (0,0,{z!r})",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: gzip",
        'space units: "mm" "mm" "mm"',
        f"space origin: ({','.join(map(repr, volume.origin_mm))})",
        "",
        "",
    ]
    return "\n".join(lines)


def write_nifti(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``; sform and qform place it. Returns what was written.

    World coordinates of NIfTI run right, anterior, superior (RAS): (−x, −y, z) of the bore frame, which is a half turn
    about z and no mirror image. Raises :class:`EndoctError` where there is no volume.
    """
    volume = volume_of(source, options)
    packed = path.suffix == ".gz"
    header = nifti_header(volume.shape, volume.dtype, _to_ras(volume), "bore, RAS", "" if packed else BLANK)
    with stages.stage("NIfTI") as advance, path.open("wb") as file:
        stream = GzipStream(file, BLANK) if packed else file
        stream.write(header)
        for done, voxels in enumerate(volume.slices(), 1):
            stream.write(voxels.astype(voxels.dtype.newbyteorder("<"), copy=False).tobytes())
            advance(done / volume.shape[2])
        if isinstance(stream, GzipStream):
            stream.finish()
    mark(path)
    return volume_facts(volume) | {"space": "RAS: −x, −y and z of the bore frame"}


def _to_ras(volume: Volume) -> Coordinates:
    (dx, dy, dz), (x, y, z) = volume.step_mm, volume.origin_mm
    return np.array([[-dx, 0, 0, -x], [0, -dy, 0, -y], [0, 0, dz, z], [0, 0, 0, 1]], dtype=np.float64)
