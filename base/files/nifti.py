"""NIfTI-1: the header that comes before a volume's voxels, made by nibabel."""

from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError

DATA_AT = 352
"""The voxels begin at this byte, i fastest."""


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
