"""NRRD of a volume, for 3D Slicer and ITK: a text header, then voxels through gzip as they are made."""

from pathlib import Path

from endoct.stitching.errors import EndoctError
from endoct.workbench.exporting.cartesian import Volume, open_volume
from endoct.workbench.exporting.gzip_stream import GzipStream
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.options import Options
from endoct.workbench.exporting.source import Source
from endoct.workbench.running.progress import Stages

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
