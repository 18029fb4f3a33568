"""Vectors with one value a sample, as a rig's programs write them next to its spectra."""

from pathlib import Path

import numpy as np

from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError
from endoct.stitching.files import read_small
from endoct.stitching.names import inside

TEXT_SUFFIXES = (".txt", ".csv")


def read_vector(folder: Path, name: str, key: str, n: int) -> Coordinates:
    """Return the ``n`` values in the file ``name`` of ``folder``, float64 (n,); ``key`` of the sidecar names it.

    The file holds little-endian float64 or float32, which its size tells apart, or text with a number a line.
    Raises :class:`EndoctError` where it is missing, has another length, or a value is not finite.
    """
    path = inside(folder, name, f"'{key}' in the sidecar")
    data = read_small(path)
    if path.suffix.lower() in TEXT_SUFFIXES:
        values = _numbers(data, path)
    else:
        kind = {8 * n: "<f8", 4 * n: "<f4"}.get(len(data))
        if kind is None:
            raise EndoctError(
                f"{path}, '{key}' in the sidecar, has the wrong length",
                found=f"{len(data)} bytes",
                expected=f"{8 * n} bytes (float64) or {4 * n} (float32) for {n} samples a spectrum",
                remedy="check 'samples' in the sidecar, and the file",
            )
        values = np.frombuffer(data, kind).astype(np.float64)
    if values.size != n:
        raise EndoctError(
            f"{path}, '{key}' in the sidecar, has the wrong length",
            found=f"{values.size} numbers",
            expected=f"{n}, one a sample",
            remedy="check 'samples' in the sidecar, and the file",
        )
    if not np.isfinite(values).all():
        raise EndoctError(
            f"{path}, '{key}' in the sidecar, is not finite",
            found=f"value {int(np.flatnonzero(~np.isfinite(values))[0])} is NaN or infinite",
            remedy="check that it holds little-endian float64 or float32",
        )
    return values


def _numbers(data: bytes, path: Path) -> Coordinates:
    try:
        return np.array([float(word) for word in data.decode("utf-8").replace(",", " ").split()], dtype=np.float64)
    except ValueError as error:
        raise EndoctError(f"{path} holds no numbers", found=str(error), expected="one number a line") from error
