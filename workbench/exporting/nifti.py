"""NIfTI-1 of a volume: a header of 348 bytes, then voxels as they are made, through gzip where the name ends in .gz."""

import struct
from pathlib import Path

from endoct.stitching.errors import EndoctError
from endoct.workbench.exporting.cartesian import Volume
from endoct.workbench.exporting.gzip_stream import GzipStream
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.nrrd import volume_facts, volume_of
from endoct.workbench.exporting.options import Options
from endoct.workbench.exporting.source import Source
from endoct.workbench.running.progress import Stages

_CODES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768}
_DATA_AT = 352
_MM = 2
_SCANNER = 1
"""Coordinates of the instrument: not those of a patient, a template or another image."""


def write_nifti(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``; sform and qform place it. Returns what was written.

    World coordinates of NIfTI run right, anterior, superior (RAS): (−x, −y, z) of the bore frame, which is a half turn
    about z and no mirror image. Raises :class:`EndoctError` where there is no volume.
    """
    volume = volume_of(source, options)
    if volume.dtype.str[1:] not in _CODES:
        raise EndoctError(f"NIfTI holds no {volume.dtype}", remedy="export NRRD")
    packed = path.suffix == ".gz"
    with stages.stage("NIfTI") as advance, path.open("wb") as file:
        stream = GzipStream(file, BLANK) if packed else file
        stream.write(_header(volume, "" if packed else BLANK))
        for done, voxels in enumerate(volume.slices(), 1):
            stream.write(voxels.astype(voxels.dtype.newbyteorder("<"), copy=False).tobytes())
            advance(done / volume.shape[2])
        if isinstance(stream, GzipStream):
            stream.finish()
    mark(path)
    return volume_facts(volume) | {"space": "RAS: −x, −y and z of the bore frame"}


def _header(volume: Volume, text: str) -> bytes:
    (dx, dy, dz), (x, y, z) = volume.step_mm, volume.origin_mm
    half_turn_about_z = 0.0, 0.0, 1.0
    header = struct.pack("<i35xB", 348, 0)
    header += struct.pack("<8h", 3, *volume.shape, 1, 1, 1, 1)
    header += struct.pack("<3f4h", 0, 0, 0, 0, _CODES[volume.dtype.str[1:]], volume.dtype.itemsize * 8, 0)
    header += struct.pack("<8f", 1.0, dx, dy, dz, 0, 0, 0, 0)
    header += struct.pack("<3fhBB4f2i", _DATA_AT, 1, 0, 0, 0, _MM, 0, 0, 0, 0, 0, 0)
    header += struct.pack("<80s24s", text.encode("ascii"), b"")
    header += struct.pack("<2h6f", _SCANNER, _SCANNER, *half_turn_about_z, -x, -y, z)
    header += struct.pack("<12f", -dx, 0, 0, -x, 0, -dy, 0, -y, 0, 0, dz, z)
    header += struct.pack("<16s4s", b"bore, RAS", b"n+1\0")
    return header + bytes(_DATA_AT - len(header))
