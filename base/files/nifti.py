"""NIfTI-1: the header of 352 bytes that comes before a volume's voxels, i fastest."""

import struct

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError

DATA_AT = 352
"""Bytes before the voxels."""
_CODES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768}
_MM = 2
_SCANNER = 1
"""Coordinates of the instrument: not those of a template or another image."""


def nifti_header(
    shape: tuple[int, int, int], dtype: np.dtype[np.generic], to_ras: Coordinates, name: str, text: str = ""
) -> bytes:
    """Return the header of a volume of ``shape`` (i, j, k), whose index ``to_ras`` (4, 4) takes to RAS in mm.

    Its axes lie at right angles. ``name``: of the coordinates, 15 letters at most; ``text``: a description, 79. Raises
    :class:`EndoctError` for numbers that NIfTI does not hold.
    """
    kind = np.dtype(dtype).str[1:]
    if kind not in _CODES:
        raise EndoctError(f"NIfTI holds no {np.dtype(dtype)}", remedy="export NRRD")
    steps = np.linalg.norm(to_ras[:3, :3], axis=0)
    b, c, d, handed = _quaternion(to_ras[:3, :3] / steps)
    header = struct.pack("<i35xB", 348, 0)
    header += struct.pack("<8h", 3, *shape, 1, 1, 1, 1)
    header += struct.pack("<3f4h", 0, 0, 0, 0, _CODES[kind], np.dtype(dtype).itemsize * 8, 0)
    header += struct.pack("<8f", handed, *steps, 0, 0, 0, 0)
    header += struct.pack("<3fhBB4f2i", DATA_AT, 1, 0, 0, 0, _MM, 0, 0, 0, 0, 0, 0)
    header += struct.pack("<80s24s", text.encode("ascii"), b"")
    header += struct.pack("<2h6f", _SCANNER, _SCANNER, b, c, d, *to_ras[:3, 3])
    header += struct.pack("<12f", *to_ras[:3].ravel())
    header += struct.pack("<16s4s", name.encode("ascii"), b"n+1\0")
    return header + bytes(DATA_AT - len(header))


def _quaternion(rotation: Coordinates) -> tuple[float, float, float, float]:
    """Return b, c, d of the unit quaternion (a ≥ 0) of a rotation, and −1 where its third axis had to be reversed."""
    from scipy.spatial.transform import Rotation  # takes a while to load

    handed = 1.0 if np.linalg.det(rotation) > 0 else -1.0
    proper = rotation * np.array([1.0, 1.0, handed])
    b, c, d, a = Rotation.from_matrix(proper).as_quat()
    sign = -1.0 if a < 0 or (a == 0 and max((b, c, d), key=abs) < 0) else 1.0
    return sign * float(b), sign * float(c), sign * float(d), handed
