"""The dense volume on voxels in mm, written as NRRD and as NIfTI-1 while its voxels are made, slice by slice.

Voxels lie along x, y and z of the bore frame: right-handed, z inward, x right and y down as seen looking in. In a file
these axes are called left, posterior and superior (LPS), so that ITK gives the bore frame's coordinates as they are.
They are not the patient's directions.

NRRD, for 3D Slicer and ITK, is a text header, then voxels through gzip. NIfTI-1 is a header of 348 bytes, then
voxels, through gzip where the name ends in .gz. The gzip file is written as a stream, with a comment in its header,
where a mark can be put in when all is written.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import zarr
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size
from endoct.base.zarr.window import ChunkCache, StoredImage
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import DAMAGED, read_arrays
from endoct.fusion.geometry.placement import column_weights
from endoct.modalities.ct.nifti import nifti_header
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.formats import VOXEL_MM
from endoct.workbench.exporting.image_layers import NOWHERE, even_rows
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages

Voxels = NDArray[Any]
MOST_SIDE = 32_000
"""NIfTI counts voxels along an axis with 16 bits, and so does what samples them here."""
FASTEST = 1
_TYPES = {"u1": "uint8", "u2": "uint16", "u4": "uint32", "i1": "int8", "i2": "int16", "i4": "int32"}
_FLOATS = {"f4": "float", "f8": "double"}
_LPS = "left-posterior-superior"


@dataclass(frozen=True, eq=False)
class Volume:
    """A volume to be written: ``shape`` (n_x, n_y, n_z), ``step_mm`` and ``origin_mm`` (x, y, z) of its first voxel.

    Samples have ``dtype``, that of the recording; outside what was recorded they are 0 (NaN in a float recording).
    """

    shape: tuple[int, int, int]
    step_mm: tuple[float, float, float]
    origin_mm: tuple[float, float, float]
    dtype: np.dtype[Any]
    _array: StoredImage
    _zarr: Any
    _rows: NDArray[np.intp]
    _grid: SurfaceGrid
    _radii_mm: Coordinates

    def slices(self) -> Iterator[Voxels]:
        """Yield every slice by ascending z: (n_y, n_x) of ``dtype``. Two slices are in memory, polar and Cartesian.

        Raises :class:`EndoctError` where the store is damaged.
        """
        polar = _Polar(self.step_mm[0], self._grid, self._radii_mm)
        where = polar.places(self.shape[0] // 2)
        for row in self._rows:
            if row == NOWHERE:
                yield self._recorded(np.full(self.shape[1::-1], np.nan, np.float32))
            else:
                yield self._recorded(polar.sampled(self._stored(int(row)), *where))

    def _stored(self, row: int) -> Voxels:
        of = self._array.declared
        image = StoredImage(of, (row,), ChunkCache(0), self._zarr)
        return image.read(slice(0, of.shape[1]), slice(0, of.shape[2]))

    def _recorded(self, samples: NDArray[np.float32]) -> Voxels:
        if self.dtype.kind == "f":
            return samples.astype(self.dtype, copy=False)
        return np.rint(np.nan_to_num(samples)).astype(self.dtype)


def open_volume(store: Path, grid_mm: SurfaceGrid, voxel_mm: float | None) -> Volume:
    """Return the volume in ``store``, the group ``volume`` of a panorama on ``grid_mm``, on voxels of ``voxel_mm``.

    Along z voxels are as far apart as the slices: nothing is interpolated between them. Raises :class:`EndoctError`
    where the store is damaged, or there would be too many voxels.
    """
    voxel_mm = VOXEL_MM if voxel_mm is None else voxel_mm
    if not 1e-4 <= voxel_mm <= 10:
        raise EndoctError("voxels cannot have that size", found=f"{voxel_mm:g} mm", expected="0.0001 to 10 mm")
    of, arrays = declared(store / "intensity", OWN), read_arrays(store, ("z", "theta", "radius"))
    what = f"the volume {store}"
    lengths = [arrays[name].size if name in arrays else 0 for name in ("z", "theta", "radius")]
    if of.dtype is None or list(of.shape) != lengths or of.shape[1] != grid_mm.n_theta or of.chunk[0] != 1:
        found = f"shape {of.shape}, chunks {of.chunk}"
        raise EndoctError(f"{what} cannot be used", found=found, expected="(z, θ, radius)", remedy=DAMAGED)
    check_array_size(of.chunk, max(of.itemsize, 4), what)  # of the whole volume one slice at a time is read
    radii_mm, z_mm = arrays["radius"].astype(np.float64), arrays["z"].astype(np.float64)
    if radii_mm.size < 2 or not (np.diff(radii_mm) > 0).all() or not 0 <= radii_mm[0] < radii_mm[-1] < 1e3:
        raise EndoctError(f"the radii of {what} cannot be used", expected="ascending mm", remedy=DAMAGED)
    even, rows = even_rows(grid_mm.with_rows(z_mm) if z_mm.size == grid_mm.n_z else grid_mm)
    half = int(np.ceil(radii_mm[-1] / voxel_mm))
    if 2 * half + 1 > MOST_SIDE or even.n_z > MOST_SIDE:
        found = f"{2 * half + 1} × {2 * half + 1} × {even.n_z}"
        raise EndoctError("there would be too many voxels", found=found, remedy="choose a larger voxel_mm")
    check_array_size((2 * half + 1, 2 * half + 1), 4, "a slice of that voxel size")
    with refusing(f"{what} cannot be read", remedy=DAMAGED):
        opened = zarr.open_array(store / "intensity", mode="r", zarr_format=3)
    return Volume(
        shape=(2 * half + 1, 2 * half + 1, even.n_z),
        step_mm=(voxel_mm, voxel_mm, even.dz_mm),
        origin_mm=(-half * voxel_mm, -half * voxel_mm, even.z0_mm),
        dtype=of.dtype,
        _array=StoredImage(of, (0,), ChunkCache(0), opened),
        _zarr=opened,
        _rows=rows,
        _grid=grid_mm,
        _radii_mm=radii_mm,
    )


class _Polar:
    """Samples polar slices at voxels; samples finer than a voxel are averaged first, so that speckle does not alias."""

    def __init__(self, voxel_mm: float, grid: SurfaceGrid, radii_mm: Coordinates) -> None:
        self._voxel_mm = voxel_mm
        n_from = grid.n_theta
        # as fine as a voxel at the outermost radius, where the columns lie farthest apart
        self._n_theta = min(n_from, MOST_SIDE, max(8, int(np.ceil(2 * np.pi * radii_mm[-1] / voxel_mm))))
        share = n_from / self._n_theta
        centres: Coordinates = (np.arange(self._n_theta, dtype=np.float64) + 0.5) * share - 0.5
        self._columns = column_weights(n_from, centres, share)
        self._theta0_rad = grid.theta0_rad + grid.dtheta_rad * centres[0]
        self._together = max(1, int(voxel_mm / float(np.median(np.diff(radii_mm))) + 1e-6))
        self._n_radii = -(-radii_mm.size // self._together)
        beyond = self._n_radii * self._together - radii_mm.size
        step_mm = radii_mm[-1] - radii_mm[-2]
        longer = np.append(radii_mm, radii_mm[-1] + step_mm * np.arange(1, beyond + 1))
        self._beyond, self._radii_mm = beyond, longer.reshape(-1, self._together).mean(axis=1)

    def places(self, half: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the fractional (radius, column) indices of the voxels of a slice, y down and x across."""
        along = self._voxel_mm * np.arange(-half, half + 1)
        x_mm, y_mm = along[np.newaxis, :], along[:, np.newaxis]
        # one sample beyond either end is NaN, and what lies beyond that as well
        radius = np.interp(
            np.hypot(x_mm, y_mm), self._radii_mm, np.arange(self._n_radii), left=-10.0, right=self._n_radii + 10.0
        )
        turn = np.mod(np.arctan2(y_mm, x_mm) - self._theta0_rad, 2 * np.pi) / (2 * np.pi)
        return radius.astype(np.float32), (turn * self._n_theta).astype(np.float32)

    def sampled(self, polar: Voxels, radius: NDArray[np.float32], column: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a polar slice (n_theta, n_radii) at the places, float32, NaN beyond its radii."""
        samples = polar.astype(np.float32)
        if self._n_theta < samples.shape[0]:
            samples = np.asarray(self._columns @ samples, dtype=np.float32)
        if self._beyond:
            samples = np.concatenate([samples, np.repeat(samples[:, -1:], self._beyond, axis=1)], axis=1)
        samples = samples.reshape(samples.shape[0], -1, self._together).mean(axis=2)
        closed = np.concatenate([samples, samples[:1]])  # the circle: after the last column comes the first
        return np.asarray(
            cv2.remap(
                closed, radius, column, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan")
            )
        )


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


def volume_of(source: Exportable, request: ExportRequest) -> Volume:
    """Return the volume of a source. Raises :class:`EndoctError` where it has none."""
    if source.volume is None:
        raise EndoctError(
            f"{source.path} has no volume",
            expected="a panorama of OCT that was unrolled with its volume",
            remedy="unroll the recording with volume=True, and export that",
        )
    return open_volume(source.volume, source.grid, request.voxel_mm)


def volume_facts(volume: Volume) -> dict[str, object]:
    """Return what is to be known of a volume that was written."""
    return {
        "shape": list(volume.shape),
        "step_mm": list(volume.step_mm),
        "origin_mm": list(volume.origin_mm),
        "dtype": volume.dtype.name,
        "space": "LPS: x, y and z of the bore frame",
    }


def write_nrrd(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``: axes x, y, z in the space left-posterior-superior, mm. Returns what was written.

    Raises :class:`EndoctError` where there is none.
    """
    volume = volume_of(source, request)
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


def write_nifti(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the volume of ``source``; sform and qform place it. Returns what was written.

    World coordinates of NIfTI run right, anterior, superior (RAS): (−x, −y, z) of the bore frame, which is a half turn
    about z and no mirror image. Raises :class:`EndoctError` where there is no volume.
    """
    volume = volume_of(source, request)
    packed = path.suffix == ".gz"
    (dx, dy, dz), (x, y, z) = volume.step_mm, volume.origin_mm
    to_ras = np.array([[-dx, 0, 0, -x], [0, -dy, 0, -y], [0, 0, dz, z], [0, 0, 0, 1]], dtype=np.float64)
    header = nifti_header(volume.shape, volume.dtype, to_ras, "bore, RAS", "" if packed else BLANK)
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
