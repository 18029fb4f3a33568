"""NIfTI: volumes read, with units, qform and sform taken for what they say, and the header of one to be written.

Headers are read and made by nibabel.
"""

import gzip
import math
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular, read_start
from endoct.modalities.ct.stored import AXES, PLACE_MM, Convention, CtVolume, read_voxels

GZIP = b"\x1f\x8b"
HEADER_BYTES = 540
SHORTEST, FARTHEST = 348, 1_000_000_000
"""Least and greatest number of bytes before the voxels."""
UNITS_MM = {1: 1000.0, 2: 1.0, 3: 1e-3}
"""The units of ``xyzt_units`` are m, mm and µm."""
APART_VOXELS = 0.1
"""An sform and a qform may lie this far apart with a doubt, in sizes of the smallest voxel."""
SINGLE, PAIR = (b"n+1\0", b"n+2\0"), (b"ni1\0", b"ni2\0")
OUR_LABELS = "1 bone 2 nerve 3 chorda 4 cochlea 5 sinus 6 antrum"
"""Label maps that the simulator writes have this description."""
DATA_AT = 352
"""The voxels begin at this byte, i fastest."""


def is_nifti(path: Path) -> bool:
    """Say whether a file, compressed or not, begins as NIfTI does."""
    return _kind(_start(path)) is not None


def read_nifti(path: Path) -> CtVolume:
    """Return the volume in a NIfTI-1 or -2 file, LPS.

    With neither qform nor sform the voxels lie along the axes of coordinates that the file does not name, from 0 on
    (``placed`` is False). Raises :class:`EndoctError` where these contradict each other, and for what is no volume.
    """
    from nibabel.nifti1 import Nifti1Header
    from nibabel.nifti2 import Nifti2Header

    start = _start(path)
    kind = _kind(start)
    with refusing(f"{path} cannot be read", expected="NIfTI that is whole"):
        if kind in PAIR:
            raise EndoctError(f"{path} has its voxels in another file", expected="one file, .nii or .nii.gz")
        of = Nifti1Header if kind == SINGLE[0] else Nifti2Header
        header: Any = of.from_fileobj(BytesIO(start), check=False)  # type: ignore[no-untyped-call]
        shape = _shape(header, path)
        dtype = header.get_data_dtype()
        if dtype.kind not in "iuf" or dtype.itemsize > 8:
            raise EndoctError(f"{path} is no volume", found=f"voxels of {dtype}", expected="one real number a voxel")
        check_array_size(shape, dtype.itemsize, str(path))
        to_ras, placed, notes, doubts = _affine(header, shape, path)
        stored = _voxels(path, int(header["vox_offset"]), shape, dtype)
        voxels = _scaled(header, stored)
    signs = np.diag([-1.0, -1.0, 1.0]) if placed else np.eye(3)
    origin, steps = signs @ to_ras[:3, 3], (signs @ to_ras[:3, :3]).T[::-1].copy()
    said: Convention | None = "ras" if placed else None
    form = f"NIfTI-{1 if kind == SINGLE[0] else 2}"
    return CtVolume(voxels, origin, steps, said, form, (path,), None, tuple(notes), tuple(doubts), placed)


def is_our_label_map(path: Path) -> bool:
    """Say whether a file is a label map that the simulator wrote."""
    start = _start(path)
    return _kind(start) == SINGLE[0] and start[148:228].rstrip(b"\0") == OUR_LABELS.encode()


def _start(path: Path) -> bytes:
    start = read_start(path, 4096)
    if not start.startswith(GZIP):
        return start[:HEADER_BYTES]
    try:
        with open_regular(path) as file, gzip.open(file) as stream:
            return stream.read(HEADER_BYTES)
    except Exception:  # noqa: BLE001  no gzip, or a damaged one: no NIfTI
        return b""


def _kind(start: bytes) -> bytes | None:
    of_first, of_second = start[344:348], start[4:8]  # where NIfTI-1 and NIfTI-2 have their magic
    if of_first in (SINGLE[0], PAIR[0]):
        return of_first
    return of_second if of_second in (SINGLE[1], PAIR[1]) else None


def _shape(header: Any, path: Path) -> tuple[int, int, int]:
    """Return how many voxels there are along i, j and k."""
    dims = [int(n) for n in header["dim"]]
    n_dims, sizes = dims[0], dims[1:]
    whole = AXES <= n_dims <= 7 and all(n >= 1 for n in sizes[:n_dims]) and all(n == 1 for n in sizes[AXES:n_dims])
    if not whole:
        said = " × ".join(map(str, sizes[: max(0, min(n_dims, 7))]))
        raise EndoctError(f"{path} is no volume", found=f"{n_dims} dimensions, {said}", expected="three dimensions")
    return sizes[0], sizes[1], sizes[2]


def _affine(header: Any, shape: tuple[int, int, int], path: Path) -> tuple[Coordinates, bool, list[str], list[Doubt]]:
    """Return the matrix (4, 4) of (i, j, k) to RAS in mm, whether the file has one, and notes and doubts on it."""
    unit = int(header["xyzt_units"]) & 7
    if unit not in (0, *UNITS_MM):
        raise EndoctError(f"{path} does not say its unit", found=f"code {unit}", expected="1 m, 2 mm or 3 µm")
    notes = [] if unit else ["It does not say its unit of length: taken for mm."]
    scale = np.diag([*[UNITS_MM.get(unit, 1.0)] * 3, 1.0])
    steps = np.abs(np.array(header["pixdim"][1:4], dtype=np.float64))
    coded = [form for form in ("sform", "qform") if int(header[f"{form}_code"]) > 0]
    if coded != ["sform"] and not (np.all(np.isfinite(steps)) and np.all(steps > 0)):
        raise EndoctError(f"{path} does not say how far its voxels lie apart", found=f"pixdim {steps.tolist()}")
    header["pixdim"][:4] = [-1.0 if float(header["pixdim"][0]) == -1 else 1.0, *steps]  # nibabel takes nothing else
    forms = [np.asarray(getattr(header, f"get_{form}")(), np.float64) for form in coded]
    if not np.isfinite(forms).all():
        found = f"{' or '.join(coded)} with numbers that are none"
        raise EndoctError(f"{path} does not say where its voxels lie", found=found)
    if not forms:
        return scale @ np.diag([*steps, 1.0]), False, notes, []
    chosen, *others = (scale @ form for form in forms)
    lengths = np.linalg.norm(chosen[:3, :3], axis=0)
    if not others:
        stated = scale[0, 0] * steps
        if np.all(stated > 0) and np.abs(lengths - stated).max() > 0.01 * stated.min():
            found = ", ".join(f"{own:.4g} and {size:.4g}" for own, size in zip(lengths, stated, strict=True))
            raise EndoctError(
                f"{path} says two things of how far its voxels lie apart",
                found=f"{found} mm",
                expected="the same in sform and pixdim",
                remedy="resample it, or save it anew",
            )
        return chosen, True, notes, []
    corners = np.array([[*np.multiply(corner, np.subtract(shape, 1)), 1.0] for corner in np.ndindex(2, 2, 2)]).T
    apart = float(np.linalg.norm((chosen - others[0])[:3] @ corners, axis=0).max())
    if not apart <= APART_VOXELS * float(lengths.min()):
        raise EndoctError(
            f"{path} does not say where its voxels lie",
            found=f"sform and qform {apart:.3g} mm apart, or sheared",
            expected="the same place in both",
            remedy="resample it, or give it one of them only",
        )
    if apart <= PLACE_MM:
        return chosen, True, notes, []
    said = f"The sform and the qform of {path.name} lie {apart:.3f} mm apart: the sform was taken."
    return chosen, True, notes, [Doubt("ct-forms-apart", said, value=apart, unit="mm", expected=(0.0, PLACE_MM))]


def _voxels(path: Path, offset: int, shape: tuple[int, int, int], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the stored voxels, (k, j, i), in the machine's order of bytes."""
    if not SHORTEST <= offset <= FARTHEST:
        raise EndoctError(f"{path} cannot be read", found=f"voxels at byte {offset}", expected=f"{SHORTEST} at least")
    with open_regular(path) as file:
        packing = "zlib" if file.read(2) == GZIP else "raw"
        file.seek(0)
        return read_voxels(file, path, math.prod(shape), dtype, packing, offset).reshape(shape[::-1])


def _scaled(header: Any, stored: NDArray[Any]) -> NDArray[Any]:
    """Return values: stored numbers times ``scl_slope`` plus ``scl_inter``, whole numbers where these are."""
    slope, inter = header.get_slope_inter()
    if slope is None or (slope == 1 and inter == 0):
        return stored
    if slope == 1 and inter == round(inter) and stored.dtype.kind in "iu" and stored.dtype.itemsize < 4:
        values = stored.astype(np.int32) + int(inter)
        limits = np.iinfo(np.int16)
        small = limits.min <= int(values.min()) and int(values.max()) <= limits.max
        return values.astype(np.int16) if small else values
    return (stored * np.float64(slope) + np.float64(inter)).astype(np.float32)


def nifti_header(
    shape: tuple[int, int, int], dtype: np.dtype[np.generic], to_ras: Coordinates, name: str, text: str = ""
) -> bytes:
    """Return the header of a volume of ``shape`` (i, j, k), whose index ``to_ras`` (4, 4) takes to RAS in mm.

    Its axes lie at right angles. ``name``: of the coordinates, 15 letters at most; ``text``: a description, 79. Raises
    :class:`EndoctError` for numbers that NIfTI does not hold.
    """
    from nibabel.nifti1 import Nifti1Header  # takes a while to load
    from nibabel.spatialimages import HeaderDataError

    header: Any = Nifti1Header(endianness="<")  # type: ignore[no-untyped-call]
    try:
        header.set_data_dtype(dtype)
    except HeaderDataError as error:
        raise EndoctError(f"NIfTI holds no {np.dtype(dtype)}", remedy="export NRRD") from error
    header.set_data_shape(shape)
    header.set_sform(to_ras, "scanner")
    header.set_qform(to_ras, "scanner")
    header.set_xyzt_units("mm")
    header["pixdim"][4:] = 0
    header["vox_offset"], header["magic"] = DATA_AT, b"n+1"
    header["intent_name"], header["descrip"] = name.encode("ascii"), text.encode("ascii")
    return bytes(header.binaryblock).ljust(DATA_AT, b"\0")
